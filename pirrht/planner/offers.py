"""Draws in passages: states that are offered to a growing tree until they are vertices, between uniform draws.

Which state is offered at which draw follows from the number of the draw and the vertices that there are: a tree that is
grown in several steps, or read from a file in between, is the tree that is grown at once. At least every second draw is
uniform, so the tree's paths still converge to the optimum.
"""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array

AT_ONCE = 256  # draws that are made and dealt with together
LEAST = 64  # draws between two offers of one state; early ones are often in vain


class PassageSampler:
    """States (k, n) that ought to become vertices; `waiting` says where those are that have not become any."""

    def __init__(self, states: Array) -> None:
        self.states = states
        self.waiting = {state.tobytes(): k for k, state in enumerate(states)}
        self._open = np.ones(len(states), dtype=bool)
        self._seen = 0
        self._period = max(LEAST, 2 * len(states))

    def note(self, states: Array) -> None:
        """Take the states (V, n) of all vertices from the list of those that are waited for."""
        if self.waiting:
            for state in states[self._seen :]:
                k = self.waiting.pop(state.tobytes(), None)
                if k is not None:
                    self._open[k] = False
        self._seen = len(states)

    def at(self, draw: int) -> Array | None:
        """The state (n,) that is offered as a draw of some number; None: this draw is uniform."""
        place, uniform = divmod(draw % self._period, 2)
        if uniform or place >= len(self.states) or not self._open[place]:
            return None
        offered: Array = self.states[place]
        return offered

    def together(self, draw: int) -> int:
        """How many draws from this number on may be dealt with before `note` is asked for: none is offered twice."""
        return self._period - draw % self._period if self.waiting else AT_ONCE
