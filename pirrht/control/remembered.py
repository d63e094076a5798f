"""The tree's paths of a drive: those of one plan are where the next one's shortening begins."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.control.guides import Whole
from pirrht.steering.motion import Motions
from pirrht.topology.homology import Homology, integers
from pirrht.topology.in_time import TimedHomology
from pirrht.tree.homology_tree import HomologyTree
from pirrht.tree.reference import Reference


class Remembered:
    """Asks a tree for references, and remembers their paths by class.

    Args:
        polished: shorten references inside their class.
        threads: that do.

    Attributes:
        unseen: names of earlier classes by key, where the last plan has looked at some only.
    """

    def __init__(self, *, polished: bool, threads: int) -> None:
        self._polished, self._threads = polished, threads
        self._known: dict[Whole, Motions] = {}
        self.unseen: dict[int, str] = {}

    def references(
        self,
        tree: HomologyTree,
        homology: Homology | TimedHomology,
        x: Array,
        driven: Sequence[int],
        *,
        pressed: Callable[[], bool],
        most: int | None,
    ) -> list[Reference]:
        """The references at x (n,), cheapest first.

        Args:
            driven: class (M,) of the driven path [turns].
            pressed: whether time is short (`HomologyTree.references`).
            most: so many classes; None: all.

        Raises:
            NoReference: no allowed class reaches the goal from x.
        """
        self.unseen = {}
        before = {integers(np.subtract(whole, driven)): path for whole, path in self._known.items()}
        found = tree.references(
            x, polished=self._polished, before=before, pressed=pressed, threads=self._threads, most=most
        )
        left_out: dict[Whole, Motions] = {}
        if most is not None:
            left_out = self._known
            self.unseen = {homology.key(way): homology.name(whole) for way, whole in zip(before, left_out, strict=True)}
        self._known = left_out | {integers(np.add(driven, one.winding)): one.path for one in found}
        return found
