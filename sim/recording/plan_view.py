"""Pictures of a plan: references, samples, their means, why, and the references in the lifted trees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.exact.desirability import Desirability
from sim.drawing import strokes
from sim.drawing.colors import DEAD_COLOR, MOVER, ClassColors, Color, fade, mix, title
from sim.drawing.strokes import lift, packed
from sim.drawing.tubes import foreseen
from sim.recording import spacetime
from sim.recording.reasons import page, reasons, share, words_of
from sim.recording.static import CONTROL, FLOOR, all_named
from sim.recording.stream import Stream
from sim.recording.subject import Subject
from sim.recording.truth_view import on_floor, shares_of

PICTURE_BYTES = 50_000  # most that a picture may take
CHUNK_BYTES, POINT_BYTES = (1300, 9)  # cost of an entity and of a point in the file; compression takes 3 of 12 off
MOVER_BYTES = 1000  # of each moving obstacle between two pictures
REFERENCE_POINTS = 64
NAMED = 0.005  # share of psi from which a class bears its name on the map
MEANS, HEAVY = 6, 0.01  # classes whose mean path is drawn: at most, and from this share on
LONG = 24  # letters that a label may have for the words of a class
LIFTED, LIFTED_POINTS = 6, 32  # references drawn in a lifted tree, the cheapest first


class Pictures:
    """Logs pictures into one recording stream."""

    def __init__(self, stream: Stream, subject: Subject, colors: ClassColors) -> None:
        self._stream, self._subject, self._colors = stream, subject, colors
        self._fans: set[str] = set()
        self._words: dict[str, str] = {}  # of classes
        self._now = (0, 0.0)
        self.in_time = spacetime.SpaceTime(stream, subject, colors) if subject.moves else None

    def said(self, name: str) -> str:
        """Return the last words for a class; empty if it was never drawn."""
        return self._words.get(name, "")

    def draw(self, plan: Plan, step: int, time: float) -> None:
        """Log a plan at a step and simulated time [s]."""
        self._now = step, time
        subject, estimate = self._subject, plan.estimate
        self._words |= words_of(plan, subject.path_integral, subject.names)
        lines = [strokes.at_most(r.trajectory.points[:, :2], REFERENCE_POINTS) for r in plan.references]
        soon = foreseen(plan.movers, plan.time) if subject.moves else []
        self._references(plan, lines)
        self._means(plan)
        fans: dict[str, strokes.Fan] = {}
        if estimate is not None and subject.look.samples != "none":
            fans = strokes.fans(
                subject.path_integral, estimate, plan.classes, points=self._points(plan, sum(map(len, lines))),
                everything=subject.look.samples == "all",
            )  # fmt: skip
        exact = None if subject.grid is None else self._truth(subject.grid, plan, time)
        why = reasons(plan, subject.path_integral, subject.surroundings, self._words, exact)
        self._log("/why/page", rr.TextDocument(page(plan, why, time), media_type=rr.MediaType.MARKDOWN))
        for name in sorted(self._fans - fans.keys()):
            self._log(_fan_path(name), rr.LineStrips3D(np.zeros((0, 2, 3), np.float32)))
        for name, fan in fans.items():
            dead = name == strokes.DEAD
            opacity = np.full(len(fan.strips), 0.5) if dead else 0.25 + 0.75 * fan.opacity
            shades = packed(fade(DEAD_COLOR if dead else self._colors[name], FLOOR, opacity))
            self._log(_fan_path(name), rr.LineStrips3D(fan.strips, colors=shades, radii=0.006))
        self._fans = set(fans)
        labels = self._labels(plan)
        self._label_map(plan, labels, lines)
        if self.in_time is not None:
            later = [one for one in soon if one.after > 0.0]
            pale = packed(fade(MOVER, FLOOR, np.array([one.strength for one in later]))) if later else None
            rings = [lift(one.ring, 0.03) for one in later]
            self._log("/world/foreseen", rr.LineStrips3D(rings, colors=pale, radii=0.008))
            self.in_time.draw(plan, soon, fans, labels, self._now)

    def _labels(self, plan: Plan) -> dict[str, str]:
        """Labels of the classes that weigh something, or where nothing is weighed of the cheapest, heaviest first."""
        if plan.estimate is None:
            return {name: title(name) for name in plan.ids[:LIFTED]}
        weights = plan.estimate.class_weights
        told = sorted((n for n in plan.ids if weights.get(n, 0.0) >= NAMED), key=lambda n: -weights[n])
        labels = {name: f"{title(name)}   {share(weights[name])}" for name in told}
        words = self.said(plan.favourite or "")
        if plan.favourite in labels and len(words) <= LONG:
            labels[plan.favourite] += f"   {words}"
        return labels

    def _label_map(self, plan: Plan, labels: Mapping[str, str], lines: Sequence[Array]) -> None:
        """Log the labels of classes on their lines, and those of moving obstacles."""
        even = [strokes.even(line, LIFTED_POINTS) for line in lines[: len(plan.ids)]]
        places = {name: line[i] for name, line, i in zip(plan.ids, even, strokes.apart(even), strict=True)}
        movers = plan.movers if all_named(self._subject) else ()
        at = [*(places[name] for name in labels), *(mover.motion.pose(plan.time)[:2] for mover in movers)]
        texts = [*labels.values(), *(mover.name.replace("_", " ") for mover in movers)]
        colors = [*(self._colors[name] for name in labels), *(MOVER for _ in movers)]
        self._names("/world/names", lift(np.array(at).reshape(-1, 2), 0.1), texts, colors)

    def _truth(self, grid: Desirability, plan: Plan, time: float) -> dict[str, float]:
        """Return each class's share by the grid; where obstacles move, also draw the floor now."""
        if grid.moves:
            for path, picture in on_floor(grid, self._subject.space, time):
                self._log(path, picture)
        return shares_of(grid, plan, time)

    def _points(self, plan: Plan, points: int) -> int:
        """Points that samples may have in a picture, in addition to those of the references."""
        trees, K, moves = len(self._subject.lifted), len(plan.references), self._subject.moves
        chunks = 5 + 3 * trees + K + 2 + 5 * moves
        others = points + MEANS * strokes.POINTS + 2 * trees * min(K, LIFTED) * LIFTED_POINTS
        others += spacetime.points(self._subject, K) if moves else 0
        left = PICTURE_BYTES - CHUNK_BYTES * chunks - MOVER_BYTES * len(self._subject.space.scene.movers)
        return max(0, left // POINT_BYTES - others)

    def _means(self, plan: Plan) -> None:
        """Log the mean paths of the samples of the heavy classes."""
        if plan.estimate is None:
            return self._strips("/world/ways", [], [], np.zeros(0, np.float32))
        weights = plan.estimate.class_weights
        heavy = sorted((n for n in plan.ids if weights.get(n, 0.0) >= HEAVY), key=lambda n: -weights[n])[:MEANS]
        keys = {key: name for key, name in plan.classes.items() if name in heavy}
        means = strokes.mean_paths(self._subject.path_integral, plan.estimate, keys)
        names = [name for name in reversed(heavy) if name in means]  # the favourite on top
        colors = [CONTROL if name == plan.favourite else mix(self._colors[name], CONTROL, 0.45) for name in names]
        radii = [0.014 if name == plan.favourite else 0.008 for name in names]
        strips = [lift(means[name], 0.065 + 0.001 * k) for k, name in enumerate(names)]
        return self._strips("/world/ways", strips, colors, np.array(radii, np.float32))

    def _references(self, plan: Plan, lines: Sequence[Array]) -> None:
        weights = plan.estimate.class_weights if plan.estimate else {}
        weight = np.array([weights.get(name, 0.0) for name in plan.ids])
        colors = [self._colors[name] for name in plan.ids]
        radii = (0.008 + 0.024 * np.sqrt(weight)).astype(np.float32)
        self._strips("/world/references", [lift(line, 0.05) for line in lines], colors, radii)
        pairs = zip(plan.references[:LIFTED], lines, strict=False)
        chosen = [(r, strokes.even(line, LIFTED_POINTS)) for r, line in pairs]
        texts = [f"class {title(n)}: cost {r.cost:.2f}" for n, (r, _) in zip(plan.ids, chosen, strict=False)]
        homology, turn = self._subject.space.homology, self._subject.turn
        for obstacle, path, _ in self._subject.lifted:
            raised = [lift(line, turn * strokes.remaining(homology, r, line, obstacle)) for r, line in chosen]
            self._strips(f"{path}/references", raised, colors, np.full(len(raised), 0.04, np.float32))
            beads = [line[::4] for line in raised]
            shades = packed([mix(c, CONTROL, 0.6) for c, line in zip(colors, beads, strict=False) for _ in line])
            at = np.concatenate([np.zeros((0, 3), np.float32), *beads])
            self._log(f"{path}/dots", rr.Points3D(at, radii=0.06, colors=shades))
            places = [line[i] for line, i in zip(raised, strokes.apart(raised), strict=True)]
            self._names(f"{path}/names", places, texts, colors)

    def _strips(
        self, path: str, strips: Sequence[strokes.Floats], colors: Sequence[Color], radii: strokes.Floats
    ) -> None:
        self._log(path, rr.LineStrips3D(strips, colors=packed(colors[: len(strips)]), radii=radii))

    def _names(
        self, path: str, places: Sequence[Array] | strokes.Floats, texts: Sequence[str], colors: Sequence[Color]
    ) -> None:
        pale = packed([mix(color, (255, 255, 255), 0.4) for color in colors[: len(places)]])
        points = np.array(places, np.float32).reshape(-1, 3)
        self._log(path, rr.Points3D(points, radii=0.0, colors=pale, labels=list(texts), show_labels=True))

    def _log(self, path: str, archetype: rr.AsComponents) -> None:
        self._stream.log(path, *self._now, archetype)


def _fan_path(name: str) -> str:
    return str(rr.new_entity_path(["world", "samples", name]))
