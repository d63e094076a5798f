"""How the best path of every class gets shorter while the tree grows (the paper's Fig. 3a)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.planner.tree import HomologyTree
from pirrht.topology.signature import class_id


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Convergence:
    """Lengths of the best paths found so far from one state, per class, against the iterations of Algorithm 1."""

    iterations: NDArray[np.int64]  # (k,) random states drawn so far
    vertices: NDArray[np.int64]  # (k,) vertices of the tree after them
    ids: tuple[str, ...]  # (C,) public names of the classes, shortest first
    lengths: Array  # (k, C) [m], never rising; inf before a class is found


def grow(
    tree: HomologyTree, x: Array, vertices: int, *, every: int = 10, progress: Callable[[int], None] | None = None
) -> Convergence:
    """Grow a tree to so many vertices; note the best length [m] of each class from x (n,) every so often.

    Lengths are not shortened, and the tree is the same whatever the number of notes.

    Raises:
        OptionError: every is less than 1.
    """
    if every < 1:
        raise OptionError(f"every is {every}; it must be at least 1 vertex")
    counts, notes = [(tree.draws, tree.size)], [tree.lengths(x)]
    while tree.size < vertices:
        before = tree.size
        tree.grow(min(vertices, before + every), progress=progress)
        if tree.size == before:
            break
        counts.append((tree.draws, tree.size))
        notes.append(tree.lengths(x))
    windings = sorted({winding for note in notes for winding in note})
    table = np.array([[note.get(winding, np.inf) for winding in windings] for note in notes]).reshape(len(notes), -1)
    # A path once found stays one, also when the state's nearest vertices or the K cheapest classes become others.
    lengths = np.minimum.accumulate(table, axis=0)
    order = np.argsort(lengths[-1], kind="stable")
    iterations, sizes = np.array(counts).T
    ids = tuple(class_id(windings[c]) for c in order)
    return Convergence(iterations=iterations, vertices=sizes, ids=ids, lengths=lengths[:, order])
