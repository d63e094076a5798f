"""The tree's paths of a drive: those of one plan are where the next one's shortening begins."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.control.proposals import Whole, kept
from pirrht.errors import NoReference
from pirrht.steering.motion import Motions
from pirrht.steering.trajectory import SPACING, Trajectory
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

    def lines(self) -> dict[Whole, Array]:
        """Return the paths of the last plan, (k, 2) [m] each, by class."""
        return {whole: np.vstack(path.points(SPACING)) for whole, path in self._known.items()}

    def inherit(self, heirs: Mapping[Whole, Whole]) -> None:
        """Keep them by the classes that theirs are now."""
        self._known = kept(self._known, heirs)

    def reversed(self, tree: HomologyTree | None, x: Array) -> dict[Whole, Trajectory]:
        """Paths from x (n,) that are driven backwards, by winding; none of a system that does not reverse."""
        turned = None if tree is None else tree.steering.backwards(x)
        if tree is None or turned is None:
            return {}
        try:
            found = tree.references(turned, polished=self._polished, threads=self._threads)
        except NoReference:
            return {}
        return {one.winding: tree.steering.reversing(one.trajectory) for one in found}

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
