"""Pictures of a plan: references, samples, their means, why, and the references in the lifted trees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from sim.drawing import strokes
from sim.drawing.colors import DEAD_COLOR, MOVER, ClassColors, Color, fade, mix, title
from sim.drawing.strokes import foreseen, lift, packed
from sim.recording import spacetime
from sim.recording.reasons import page, reasons, share, words_of
from sim.recording.static import CONTROL, FLOOR, all_named
from sim.recording.stream import Stream
from sim.recording.subject import Subject
from sim.recording.truth_view import VALUE, on_floor, shares_of

SAMPLE_POINTS, CLASS_POINTS = 3200, 300  # of all samples of a picture, less so many for each class: 50 kB together
REFERENCE_POINTS = 64
NAMED = 0.005  # share of psi from which a class bears its name on the map
MEANS, HEAVY = 6, 0.01  # classes whose mean path is drawn: at most, and from this share on
LIFTED, LIFTED_POINTS = 6, 32  # references drawn in a lifted tree, the cheapest first
NOTHING = np.zeros((0, 2, 3), np.float32)

Packed = NDArray[np.uint32]


class Pictures:
    """Logs pictures into one recording stream."""

    def __init__(self, stream: Stream, subject: Subject, colors: ClassColors) -> None:
        self._stream, self._subject, self._colors = stream, subject, colors
        self._fans: set[str] = set()
        self._now = (0, 0.0)
        self.in_time = spacetime.SpaceTime(stream, subject, colors) if subject.moves else None

    def draw(self, plan: Plan, step: int, time: float) -> None:
        """Log a plan at a step and simulated time [s]."""
        self._now = step, time
        subject, weights = self._subject, plan.estimate.class_weights if plan.estimate else {}
        lines = [strokes.at_most(r.trajectory.points[:, :2], REFERENCE_POINTS) for r in plan.references]
        soon = foreseen(plan.movers, plan.time) if subject.moves else []
        self._references(plan, lines, weights)
        self._means(plan, weights)
        fans = self._samples(plan)
        words = words_of(plan, subject.path_integral, subject.names)
        why = reasons(plan, subject.path_integral, subject.solids, words, self._exact(plan, time))
        self._log("/why/page", rr.TextDocument(page(plan, why, time), media_type=rr.MediaType.MARKDOWN))
        labels = {name: title(name) for name in plan.ids[:LIFTED]}
        if plan.estimate is not None:
            heavy = sorted((n for n in plan.ids if weights.get(n, 0.0) >= NAMED), key=lambda n: -weights[n])
            labels = {name: f"{title(name)}   {share(weights[name])}" for name in heavy}
        self._label_map(plan, labels, lines)
        if self.in_time is not None:
            later = [one for one in soon if one.after > 0.0]
            pale = packed(fade(MOVER, FLOOR, np.array([one.strength for one in later])))
            self._strips("/world/foreseen", [lift(one.ring, 0.03) for one in later], pale, 0.008)
            self.in_time.draw(plan, soon, fans, labels, self._now)

    def _label_map(self, plan: Plan, labels: Mapping[str, str], lines: Sequence[Array]) -> None:
        """Log the labels of classes on their lines, and those of moving obstacles."""
        even = [strokes.even(line, LIFTED_POINTS) for line in lines[: len(plan.ids)]]
        places = {name: line[i] for name, line, i in zip(plan.ids, even, strokes.apart(even), strict=True)}
        movers = plan.movers if all_named(self._subject) else ()
        at = [*(places[name] for name in labels), *(mover.motion.pose(plan.time)[:2] for mover in movers)]
        texts = [*labels.values(), *(mover.name.replace("_", " ") for mover in movers)]
        colors = [*(self._colors[name] for name in labels), *(MOVER for _ in movers)]
        self._names("/world/names", lift(np.array(at).reshape(-1, 2), 0.1), texts, colors)

    def _exact(self, plan: Plan, time: float) -> dict[str, float] | None:
        """Return each class's share by the grid, if there is one; where obstacles move, also draw the floor now."""
        grid = self._subject.grid
        if grid is not None and grid.moves:
            self._log(VALUE, on_floor(grid, self._subject.space, time))
        return None if grid is None else shares_of(grid, plan, time)

    def _samples(self, plan: Plan) -> dict[str, strokes.Fan]:
        """Log and return samples by class."""
        fans: dict[str, strokes.Fan] = {}
        if plan.estimate is not None and self._subject.look.samples != "none":
            most = max(0, SAMPLE_POINTS - CLASS_POINTS * len(plan.ids))
            everything = self._subject.look.samples == "all"
            integral = self._subject.path_integral
            fans = strokes.fans(integral, plan.estimate, plan.classes, points=most, everything=everything)
        for name in sorted(self._fans - fans.keys()):
            self._log(_fan_path(name), rr.LineStrips3D(NOTHING))
        for name, fan in fans.items():
            dead = name == strokes.DEAD
            opacity = np.full(len(fan.strips), 0.5) if dead else 0.25 + 0.75 * fan.opacity
            shades = packed(fade(DEAD_COLOR if dead else self._colors[name], FLOOR, opacity))
            self._strips(_fan_path(name), fan.strips, shades, 0.006)
        self._fans = set(fans)
        return fans

    def _means(self, plan: Plan, weights: Mapping[str, float]) -> None:
        """Log the mean paths of the samples of the heavy classes."""
        heavy = sorted((n for n in plan.ids if weights.get(n, 0.0) >= HEAVY), key=lambda n: -weights[n])[:MEANS]
        means: dict[str, Array] = {}
        if plan.estimate is not None:
            keys = {key: name for key, name in plan.classes.items() if name in heavy}
            means = strokes.mean_paths(self._subject.path_integral, plan.estimate, keys)
        names = [name for name in reversed(heavy) if name in means]  # the favourite on top
        colors = [CONTROL if name == plan.favourite else mix(self._colors[name], CONTROL, 0.45) for name in names]
        radii = [0.014 if name == plan.favourite else 0.008 for name in names]
        strips = [lift(means[name], 0.065 + 0.001 * k) for k, name in enumerate(names)]
        self._strips("/world/ways", strips, packed(colors), radii)

    def _references(self, plan: Plan, lines: Sequence[Array], weights: Mapping[str, float]) -> None:
        colors = [self._colors[name] for name in plan.ids]
        radii = [0.008 + 0.024 * weights.get(name, 0.0) ** 0.5 for name in plan.ids]
        self._strips("/world/references", [lift(line, 0.05) for line in lines], packed(colors), radii)
        few = plan.references[:LIFTED]
        chosen = [(r, strokes.even(line, LIFTED_POINTS)) for r, line in zip(few, lines, strict=False)]
        texts = [f"class {title(name)}: cost {r.cost:.2f}" for name, r in zip(plan.ids, few, strict=False)]
        homology, turn = self._subject.space.homology, self._subject.turn
        for obstacle, path, _ in self._subject.lifted:
            raised = [lift(line, turn * strokes.remaining(homology, r, line, obstacle)) for r, line in chosen]
            self._strips(f"{path}/references", raised, packed(colors[: len(few)]), 0.04)
            places = [line[i] for line, i in zip(raised, strokes.apart(raised), strict=True)]
            self._names(f"{path}/names", places, texts, colors[: len(few)])

    def _strips(
        self, path: str, strips: Sequence[strokes.Floats] | strokes.Floats, colors: Packed, radii: float | list[float]
    ) -> None:
        self._log(path, rr.LineStrips3D(strips, colors=colors, radii=radii))

    def _names(
        self, path: str, places: Sequence[Array] | strokes.Floats, texts: Sequence[str], colors: Sequence[Color]
    ) -> None:
        pale = packed([mix(color, (255, 255, 255), 0.4) for color in colors])
        points = np.array(places, np.float32).reshape(-1, 3)
        self._log(path, rr.Points3D(points, radii=0.0, colors=pale, labels=list(texts), show_labels=True))

    def _log(self, path: str, archetype: rr.AsComponents) -> None:
        self._stream.log(path, *self._now, archetype)


def _fan_path(name: str) -> str:
    return str(rr.new_entity_path(["world", "samples", name]))
