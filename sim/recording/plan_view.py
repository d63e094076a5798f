"""Pictures of a plan: references, samples, how they went on average, why, and the references in the lifted trees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.exact.desirability import Desirability
from sim.drawing import strokes
from sim.drawing.colors import DEAD_COLOR, MOVER, ClassColors, Color, fade, mix, title
from sim.drawing.strokes import at_most, lift, packed
from sim.drawing.tubes import Outline, foreseen
from sim.recording import camera, spacetime
from sim.recording.reasons import page, reasons, share, words_of
from sim.recording.static import CONTROL, FLOOR, all_named, levels_of
from sim.recording.stream import Stream
from sim.recording.subject import Subject
from sim.recording.truth_view import on_floor, shares_of

PICTURE_BYTES = 50_000  # most that a picture may take
CHUNK_BYTES, POINT_BYTES = (1300, 9)  # cost of an entity and of a point in the file; compression takes 3 of 12 off
MOVER_BYTES = 1000  # of each moving body between two pictures
REFERENCE_POINTS = 64
TOLD = 0.005  # share of psi from which a class bears its name on the map
WAYS, HEAVY = 6, 0.01  # classes whose average way is drawn: at most, and from this share on
BY = 4  # points of a line before and after its label
LONG = 36  # letters that a label may have for the way
LIFTED, LIFTED_POINTS = 6, 32  # references drawn in a lifted tree, the cheapest first


class Pictures:
    """Logs pictures into one recording stream."""

    def __init__(self, stream: Stream, subject: Subject, colors: ClassColors) -> None:
        self._stream, self._subject, self._colors = stream, subject, colors
        self._fans: set[str] = set()
        self._ways: dict[str, str] = {}  # classes in words
        self._now = (0, 0.0)
        self._map = camera.map_labels(subject.space.scene)
        self._trees = [camera.tree_labels(subject, k, levels_of(subject)) for k, _, _ in subject.lifted]
        self._driven: list[Array] = []
        self.in_time = spacetime.SpaceTime(stream, subject, colors) if subject.moves else None

    def said(self, name: str) -> str:
        """Return the last words for a class; empty if it was never drawn."""
        return self._ways.get(name, "")

    def draw(self, plan: Plan, step: int, time: float) -> None:
        """Log a plan at a step and simulated time [s]."""
        self._now = step, time
        subject, estimate = self._subject, plan.estimate
        self._ways |= words_of(plan, subject.path_integral, subject.names)
        fine = [strokes.fine(r) for r in plan.references]
        lines = [strokes.rounded(line, REFERENCE_POINTS) for line in fine]
        soon = foreseen(plan.movers, plan.time) if subject.moves else []
        self._references(plan, fine, lines)
        ways = self._average(plan)
        found: dict[str, strokes.Fan] = {}
        if estimate is not None and subject.look.samples != "none":
            found = strokes.fans(
                subject.path_integral,
                estimate,
                plan.classes,
                points=self._room(plan, sum(map(len, lines))),
                everything=subject.look.samples == "all",
            )
        exact = None if subject.grid is None else self._truth(subject.grid, plan, time)
        why = reasons(plan, subject.path_integral, subject.solids, self._ways, exact, subject.bystanders)
        self._log("/why/page", rr.TextDocument(page(plan, why, time), media_type=rr.MediaType.MARKDOWN))
        for name in sorted(self._fans - found.keys()):
            self._log(_fan_path(name), rr.LineStrips3D(np.zeros((0, 2, 3), np.float32)))
        for name, fan in found.items():
            dead = name == strokes.DEAD
            color = DEAD_COLOR if dead else self._colors[name]
            opacity = np.full(len(fan.strips), 0.5) if dead else 0.25 + 0.75 * fan.opacity
            look = {"colors": packed(fade(color, FLOOR, opacity)), "radii": 0.006}
            self._log(_fan_path(name), rr.LineStrips3D(fan.strips, **look))
        self._fans = set(found)
        labels = self._labels(plan)
        self._label_map(plan, labels, lines, ways, found, soon)
        if self.in_time is not None:
            self._foreseen(self.in_time, plan, soon, found, labels)

    def _labels(self, plan: Plan) -> dict[str, str]:
        """Labels of the classes that weigh something, or where nothing is weighed of the cheapest, heaviest first."""
        weights = plan.estimate.class_weights if plan.estimate else {}
        told = [n for i, n in enumerate(plan.ids) if (weights.get(n, 0.0) >= TOLD if weights else i < LIFTED)]
        told.sort(key=lambda name: -weights.get(name, 0.0))
        return {name: self._label(plan, plan.ids.index(name), weights.get(name, 0.0)) for name in told}

    def _label_map(
        self,
        plan: Plan,
        labels: Mapping[str, str],
        lines: Sequence[Array],
        ways: Sequence[Array],
        fans: Mapping[str, strokes.Fan],
        soon: Sequence[Outline],
    ) -> None:
        """Log the labels of the map: those of classes and moving obstacles, and once those that stay."""
        subject, scene = self._subject, self._subject.space.scene
        self._driven.append(plan.state[:2])
        here = plan.state[:2] + 1.5 * scene.robot_radius * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        now = [one.ring for one in soon if one.after == 0.0]
        drawn = [lift(line, 0.0) for line in (*lines, *ways, *now, here, np.array(self._driven))]
        if len(self._driven) == 1:
            about = lift(np.vstack([scene.goal.center, *(mark.place for mark in subject.marks)]), 0.02)
            texts = ["goal", *subject.labels]
            at = np.array(self._map.fixed(texts, about, drawn), np.float32)
            names = rr.Points3D(at, radii=0.0, labels=texts, colors=[CONTROL], show_labels=True)
            self._stream.static("/world/scene/names", names)
        samples = np.vstack([np.zeros((0, 3)), *(fan.strips.reshape(-1, 3) for fan in fans.values())])
        even = [strokes.even(line, LIFTED_POINTS) for line in lines]
        named = strokes.apart(even)
        near = {n: _around(lift(line, 0.1), i) for n, line, i in zip(plan.ids, even, named, strict=True)}
        shown, colors = dict(labels), {name: self._colors[name] for name in labels}
        for mover in plan.movers if all_named(subject) else ():
            name = mover.name.replace("_", " ")
            shown[name], colors[name] = name, MOVER
            near[name] = lift(mover.motion.pose(np.array([plan.time]))[:, :2], 0.1)
        places = self._map.placed(shown, near, drawn, samples)
        self._names("/world/names", places, list(shown.values()), list(colors.values()))

    def _foreseen(
        self,
        in_time: spacetime.SpaceTime,
        plan: Plan,
        soon: Sequence[Outline],
        fans: dict[str, strokes.Fan],
        labels: Mapping[str, str],
    ) -> None:
        """Draw predicted outlines of moving obstacles, on the map and in space and time."""
        later = [one for one in soon if one.after > 0.0]
        shades = packed(fade(MOVER, FLOOR, np.array([one.strength for one in later]))) if later else None
        rings = [lift(one.ring, 0.03) for one in later]
        self._log("/world/foreseen", rr.LineStrips3D(rings, colors=shades, radii=0.008))
        in_time.draw(plan, soon, fans, labels, self._now)

    def _truth(self, grid: Desirability, plan: Plan, time: float) -> dict[str, float]:
        """Return each class's share by the grid; where obstacles move, also draw the floor now."""
        if grid.moves:
            for path, picture in on_floor(grid, self._subject.space, time):
                self._log(path, picture)
        return shares_of(grid, plan, time)

    def _room(self, plan: Plan, points: int) -> int:
        """Points that samples may have in a picture, beside those of the references."""
        trees, K = len(self._subject.lifted), len(plan.references)
        chunks = 5 + 3 * trees + K + 2 + (5 if self._subject.moves else 0)
        others = points + WAYS * strokes.POINTS + 2 * trees * min(K, LIFTED) * LIFTED_POINTS
        others += spacetime.points(self._subject, K)
        left = PICTURE_BYTES - CHUNK_BYTES * chunks - MOVER_BYTES * len(self._subject.space.scene.movers)
        return max(0, left // POINT_BYTES - others)

    def _average(self, plan: Plan) -> Sequence[Array]:
        """Log and return how the samples of the heavy classes went on average, (k, 2) [m] each.

        In a fallback that is what is followed instead.
        """
        estimate = plan.estimate
        if estimate is None:
            ahead = at_most(strokes.ahead(plan, self._subject.path_integral.problem), REFERENCE_POINTS)
            found, colors, radii = [ahead], [CONTROL], [0.014]
        else:
            weights = estimate.class_weights
            heavy = sorted((n for n in plan.ids if weights.get(n, 0.0) >= HEAVY), key=lambda n: -weights[n])[:WAYS]
            keys = {key: name for key, name in plan.classes.items() if name in heavy}
            ways = strokes.ways(self._subject.path_integral, estimate, keys)
            names = [name for name in reversed(heavy) if name in ways]  # the favourite on top
            found = [ways[name] for name in names]
            colors = [CONTROL if name == plan.favourite else mix(self._colors[name], CONTROL, 0.45) for name in names]
            radii = [0.014 if name == plan.favourite else 0.008 for name in names]
        strips = [lift(line, 0.065 + 0.001 * k) for k, line in enumerate(found)]
        self._strips("/world/ways", strips, colors, np.array(radii, np.float32))
        return found

    def _references(self, plan: Plan, fine: Sequence[Array], flat: Sequence[Array]) -> None:
        weights = plan.estimate.class_weights if plan.estimate else {}
        weight = np.array([weights.get(name, 0.0) for name in plan.ids])
        colors = [self._colors[name] for name in plan.ids]
        lines = [strokes.even(line, LIFTED_POINTS) for line in fine]
        radii = (0.008 + 0.024 * np.sqrt(weight)).astype(np.float32)
        self._strips("/world/references", [lift(line, 0.05) for line in flat], colors, radii)
        pairs = list(zip(plan.ids, plan.references, strict=True))[:LIFTED]
        short = {name: f"class {title(name)}: cost {r.cost:.2f}" for name, r in pairs}
        homology, turn = self._subject.space.homology, self._subject.turn
        for (obstacle, path, _), labels in zip(self._subject.lifted, self._trees, strict=True):
            chosen = list(zip(plan.references, lines, strict=True))[:LIFTED]
            raised = [lift(line, turn * strokes.remaining(homology, r, line, obstacle)) for r, line in chosen]
            named = strokes.apart(raised)
            self._strips(f"{path}/references", raised, colors, np.full(len(raised), 0.04, np.float32))
            dots = rr.Points3D(
                np.concatenate(raised)[::4] if raised else np.zeros((0, 3), np.float32),
                radii=0.06,
                colors=packed([mix(c, CONTROL, 0.6) for c, line in zip(colors, raised, strict=False) for _ in line])[
                    ::4
                ],
            )
            self._log(f"{path}/dots", dots)
            near = {name: _around(line, i) for name, line, i in zip(short, raised, named, strict=True)}
            places = labels.placed(short, near, raised)
            self._names(f"{path}/names", places, list(short.values()), colors)

    def _label(self, plan: Plan, i: int, weight: float) -> str:
        """Id and share, and of the favourite also in words where they are few."""
        name = plan.ids[i]
        way = self._ways.get(name, "")
        words = f"   {way}" if name == plan.favourite and len(way) <= LONG else ""
        return f"{title(name)}   {share(weight)}{words}" if plan.estimate else title(name)

    def _strips(
        self, path: str, strips: Sequence[strokes.Floats], colors: Sequence[Color], radii: strokes.Floats
    ) -> None:
        self._log(path, rr.LineStrips3D(strips, colors=packed(colors[: len(strips)]), radii=radii))

    def _names(self, path: str, places: Sequence[Array], texts: Sequence[str], colors: Sequence[Color]) -> None:
        pale = packed([mix(color, (255, 255, 255), 0.4) for color in colors[: len(places)]])
        points = np.array(places, np.float32).reshape(-1, 3)
        labels = list(texts[: len(places)])
        self._log(path, rr.Points3D(points, radii=0.0, colors=pale, labels=labels, show_labels=True))

    def _log(self, path: str, archetype: rr.AsComponents) -> None:
        self._stream.log(path, *self._now, archetype)


def _around(line: strokes.Floats, i: int) -> strokes.Floats:
    """The part of a line about its point i, where its label is to be."""
    return line[max(0, i - BY) : i + BY + 1]


def _fan_path(name: str) -> str:
    return str(rr.new_entity_path(["world", "samples", name]))
