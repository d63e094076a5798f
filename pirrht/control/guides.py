"""Guides from plan to plan: each goes on from what is left of the last one of its class."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from pirrht.arrays import Array
from pirrht.compiled.threads import mapped
from pirrht.guidance.any_guide import AnyGuide
from pirrht.guidance.any_guides import AnyGuidance
from pirrht.guidance.tracking import FEW
from pirrht.steering.trajectory import Trajectory

THOROUGH = 4  # cheapest classes for whose first guides all ways to begin are looked at

Whole = tuple[int, ...]  # class of the driven path and the rest together
K = TypeVar("K")
V = TypeVar("V")


def kept(known: Mapping[K, V], heirs: Mapping[K, K]) -> dict[K, V]:
    """Return what is known of classes by what each is now; of several that became one, what came first."""
    return {heirs[one]: value for one, value in reversed([*known.items()]) if one in heirs}


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A class that a guide is wanted of."""

    whole: Whole
    key: int  # of the rest alone, as kernels carry it
    winding: tuple[int, ...]  # the same
    trajectory: Trajectory  # its reference
    others: tuple[Trajectory, ...]  # of other valleys


@dataclass(slots=True)
class Guides:
    """The guides of the last plan, for the next one."""

    last: dict[Whole, Any] = field(default_factory=dict)
    rivals: dict[Whole, AnyGuide] = field(default_factory=dict)  # of another valley of the same class
    strong: set[Whole] = field(default_factory=set)  # classes that were worth all N samples

    def improve(
        self,
        guidance: Any,
        x: Array,
        times: Array,
        wanted: Sequence[Wanted],
        *,
        samples: int,
        elapsed: float,
        pressed: Callable[[], bool],
        reversed: Callable[[], Mapping[tuple[int, ...], Trajectory]],
        threads: int,
        **clock: float,
    ) -> tuple[list[Any], list[int]]:
        """Guides from x (n,), None where there is none, and samples around each; what else to sample is in `rivals`.

        The first of a drive are looked for thoroughly. If time is short there are none of new classes, the
        first aside, which is improved as long as there is time.

        Args:
            times: ends of the steps (T+1,) [s].
            elapsed: since the last plan [s].
            pressed: whether time is short.
            reversed: paths that are driven backwards, by winding; asked where a drive begins.
            clock: `time` now, where that matters [s].
        """

        anew = isinstance(guidance, AnyGuidance) and not self.last and not pressed()
        thorough = {one.whole for one in wanted[:THOROUGH]} if anew else set()
        backwards = reversed() if anew else {}

        def improved(one: Wanted) -> tuple[Any, Any]:
            last, rival = self.last.get(one.whole), self.rivals.get(one.whole)
            if one.whole in thorough and (one is wanted[0] or not pressed()):
                also = [*one.others, *([backwards[one.winding]] if one.winding in backwards else [])]
                found: tuple[Any, Any] = guidance.first(
                    x, times, one.key, one.trajectory, also, pressed=pressed, **clock
                )
                return found
            if last is None and one is not wanted[0] and pressed():
                return None, None  # made from nothing it takes ten times as long
            guide = guidance.improve(x, times, one.key, one.trajectory, last, elapsed, pressed=pressed, **clock)
            if rival is None:
                return guide, None
            rival = guidance.onward(x, times, one.key, rival, elapsed, **clock)
            if _cheaper(rival, guide):
                guide, rival = rival, guide
            return guide, guidance.rival(guide, [rival])

        both = mapped(improved, wanted, threads)
        guides = [guide for guide, _ in both]
        self.rivals = {one.whole: rival for one, (_, rival) in zip(wanted, both, strict=True) if rival is not None}
        counts: list[int] = guidance.counts(guides, samples)
        self.last = {one.whole: guide for one, guide in zip(wanted, guides, strict=True) if guide and guide.valid}
        self.strong = {one.whole for one, count in zip(wanted, counts, strict=True) if count > FEW}
        return guides, counts

    def lines(self, elapsed: float, goal: Array) -> dict[Whole, Array]:
        """Return what is left of paths after a time [s], (k, 2) [m] each, of those that have not arrived."""
        rests = {whole: guide.rest(elapsed, goal) for whole, guide in self.last.items()}
        return {whole: rest.points for whole, rest in rests.items() if rest is not None}

    def inherit(self, before: Guides, heirs: Mapping[Whole, Whole]) -> None:
        """Take over earlier guides, by the classes that theirs are now."""
        self.last, self.rivals = kept(before.last, heirs), kept(before.rivals, heirs)
        self.strong = {heirs[whole] for whole in before.strong if whole in heirs}

    def left(self, elapsed: float, goal: Array) -> Iterator[tuple[Whole, Trajectory]]:
        """What is left of the strong ones after a time [s], for those that have not arrived."""
        for whole, guide in self.last.items():
            rest = guide.rest(elapsed, goal) if whole in self.strong else None
            if rest is not None:
                yield whole, rest


def _cheaper(one: AnyGuide | None, other: AnyGuide | None) -> bool:
    """Whether a guide is sound, and another is not or is dearer."""
    if one is None or not one.valid:
        return False
    return other is None or not other.valid or one.priced < other.priced
