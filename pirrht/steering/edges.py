"""Judge proposed motions: whether they are free, end in the goal, change the class."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.space import BLOCKED, FREE, UNSURE
from pirrht.jit.jit import kernel
from pirrht.steering.motion import ARCS, MotionKernels, MotionKind, Motions, Surroundings, copied
from pirrht.topology.pairs import Turns, summed


class Edges(NamedTuple):
    """Judgements of k proposed motions."""

    near: NDArray[np.int64]  # (k,) vertices at their other ends
    status: NDArray[np.int8]  # (k,) FREE, BLOCKED or UNSURE; what is free is an edge
    cost: Array  # (k,) steering cost up to the goal's disc [cost]
    turns: Turns  # whole turns that each of the k adds to the class of its head [turns]

    @property
    def free(self) -> NDArray[np.bool_]:
        """Mask of the edges, (k,)."""
        return np.asarray(self.status == FREE)


_NO_TURNS = Turns(np.zeros(1, np.int64), np.empty(0, np.int32), np.empty(0, np.int16))
NO_EDGES = Edges(np.empty(0, np.int64), np.empty(0, np.int8), np.empty(0), _NO_TURNS)


def concatenated(parts: Sequence[Edges]) -> Edges:
    """Join several judgements in order."""
    near, status, cost, turns = zip(*parts, strict=True)
    first, marker, turn = zip(*turns, strict=True)
    counts = np.cumsum([0, *map(len, marker)])
    starts = [one[:-1] + count for one, count in zip(first, counts, strict=False)]
    joined = Turns(np.concatenate([*starts, counts[-1:]]), np.concatenate(marker), np.concatenate(turn))
    return Edges(np.concatenate(near), np.concatenate(status), np.concatenate(cost), joined)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeChecker:
    """Judges motions by certified clearances, and asks FCL where these cannot tell."""

    space: FreeSpace
    around: Surroundings
    motion: MotionKind = ARCS

    @property
    def kernels(self) -> MotionKernels:
        """Kernels of its kind of motions, for the robot's footprint and the classes of paths."""
        return self.motion.kernels(self.around)

    def inspect(self, motions: Motions, into_goal: NDArray[np.bool_], near: NDArray[np.int64] | None = None) -> Edges:
        """Judge k motions, which lead from a state to vertices `near` (k,) or back (the paper's ObstacleFree).

        A motion that enters the goal is an edge only if its head is a root (`into_goal`, (k,)); it ends, and is paid
        for, where it first enters the disc. From there its class counts along the straight line to the goal.
        """
        cut = copied(motions)
        near = np.arange(len(into_goal)) if near is None else near
        edges, unsure = judge_with(self.kernels)(self.around, cut, into_goal, near)
        for i in np.flatnonzero(edges.status == UNSURE).tolist() if unsure else ():
            if self.resolved(cut, i):
                edges.status[i] = FREE
        return edges

    def resolved(self, motions: Motions, i: int) -> bool:
        """Return whether the i-th motion, of which certificates cannot tell, is free; none is in a coarse map."""
        return self.space.grain is None and self.motion.free(motions, i, self.space)

    def until_goal(self, path: Any) -> Any:
        """Cut a path of consecutive motions where the last first enters the goal's disc."""
        last = len(path.cost) - 1
        s = self.kernels.entry(path, last, self.around)
        if s < np.inf:
            path = copied(path)
            self.kernels.cut(path, last, s)
        return path


@cache
def judge_with(kernels: MotionKernels) -> Callable[..., tuple[Edges, int]]:
    """Build the kernel (around, motions, into_goal (k,), near (k,)) -> (`Edges`, unsure) of one kind of motions."""
    entry, cut, certify, pairs, most, _ = kernels

    @kernel
    def judged(around, motions, into_goal, near):  # type: ignore[no-untyped-def]
        """Judge k motions without FCL, count unsure ones, cut them at the goal; `into_goal` and `near` are (k,)."""
        k = into_goal.shape[0]
        M = around.weights.shape[0]

        status = np.empty(k, np.int8)
        first = np.empty(k + 1, np.int64)
        unsure = 0

        room = most(motions) * M  # pairs that one motion can have
        marker = np.empty(2 * room + 256, np.int32)
        turn = np.empty(2 * room + 256, np.int16)
        total, used = np.zeros(M, np.int16), 0
        for i in range(k):
            first[i], status[i] = used, BLOCKED
            if not motions.cost[i] < np.inf:
                continue
            s = entry(motions, i, around)
            enters = s < np.inf
            if enters:
                if not into_goal[i]:
                    continue
                cut(motions, i, s)
            status[i] = certify(motions, i, around, True)
            unsure += status[i] == UNSURE
            if status[i] == BLOCKED:
                continue
            if used + room > marker.shape[0]:
                marker = np.concatenate((marker, np.empty_like(marker)))
                turn = np.concatenate((turn, np.empty_like(turn)))
            used = summed(total, marker, turn, used, pairs(motions, i, around, enters, marker, turn, used))
        first[k] = used
        return Edges(near, status, motions.cost, Turns(first, marker[:used].copy(), turn[:used].copy())), unsure

    return cast(Callable[..., tuple[Edges, int]], judged)
