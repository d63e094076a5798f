"""What a kernel of the tree answers: that it is done, or what it needs first."""

from __future__ import annotations

DONE = 0
NODES_FULL, QUEUE_FULL, PAIRS_FULL = 1, 2, 3  # what must be given more room before costs can settle
NEW = 4  # a node has been added
ASK = 5  # what comes next takes FCL, a root or more room
