"""Names of machine code that no other process gives to other code.

Numba counts the functions that it compiles and puts the count into the name of their code, and the linker takes the
first code of a name that it has seen. Processes that compile kernels of different systems count alike, so one that
loaded both from disk would run one system's code for the other's.
"""

from __future__ import annotations

import os
from itertools import count
from secrets import randbits

from numba.core.bytecode import FunctionIdentity

BITS = 48  # among a thousand processes two share a count with a chance of one in a million


def count_from_chance() -> None:
    """Let this process count what it compiles from a number of its own."""
    FunctionIdentity._unique_ids = count(randbits(BITS))


count_from_chance()
if hasattr(os, "register_at_fork"):  # not on Windows, where there is no fork
    os.register_at_fork(after_in_child=count_from_chance)
