"""Pictures of a plan: references, samples, the tape, and the references in the lifted trees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from pirrht.control.plan import Plan
from sim.drawing import strokes
from sim.drawing.colors import DEAD_COLOR, ClassColors, Color, fade, mix, title
from sim.drawing.strokes import at_most, lift, packed
from sim.recording.static import FLOOR, Subject
from sim.recording.stream import Stream

PICTURE_BYTES = 60_000  # most that a picture may take
CHUNK_BYTES, POINT_BYTES = (
    1300,
    9,
)  # cost of an entity and of a point in the file; compression takes 3 of 12 off
MOVER_BYTES = 1000  # of each moving body between two pictures
REFERENCE_POINTS = 48
LIFTED, LIFTED_POINTS = 6, 32  # references drawn in a lifted tree, the cheapest first


class Pictures:
    """Logs pictures into one recording stream."""

    def __init__(self, stream: Stream, subject: Subject, colors: ClassColors) -> None:
        self._stream, self._subject, self._colors = stream, subject, colors
        self._fans: set[str] = set()
        self._now = (0, 0.0)

    def draw(self, plan: Plan, step: int, time: float) -> None:
        """Log a plan at a step and simulated time [s]."""
        self._now = step, time
        self._references(plan)
        tape = at_most(strokes.ahead(plan, self._subject.path_integral.problem), REFERENCE_POINTS)
        self._log("/world/tape", rr.LineStrips3D(lift(tape, 0.07)[None]))
        found: dict[str, strokes.Fan] = {}
        if plan.estimate is not None and self._subject.look.samples != "none":
            found = strokes.fans(
                self._subject.path_integral,
                plan.estimate,
                plan.classes,
                points=self._room(plan),
                everything=self._subject.look.samples == "all",
            )
        for name in sorted(self._fans - found.keys()):
            self._log(_fan_path(name), rr.LineStrips3D(np.zeros((0, 2, 3), np.float32)))
        for name, fan in found.items():
            dead = name == strokes.DEAD
            color = DEAD_COLOR if dead else self._colors[name]
            opacity = np.full(len(fan.strips), 0.5) if dead else 0.25 + 0.75 * fan.opacity
            look = {"colors": packed(fade(color, FLOOR, opacity)), "radii": 0.006}
            self._log(_fan_path(name), rr.LineStrips3D(fan.strips, **look))
        self._fans = set(found)

    def _room(self, plan: Plan) -> int:
        """Points that samples may have in a picture."""
        trees, K = len(self._subject.lifted), len(plan.references)
        chunks = 3 + 2 * trees + K + 2
        others = (K + 1) * REFERENCE_POINTS + trees * min(K, LIFTED) * LIFTED_POINTS
        left = PICTURE_BYTES - CHUNK_BYTES * chunks - MOVER_BYTES * len(self._subject.space.scene.movers)
        return max(0, left // POINT_BYTES - others)

    def _references(self, plan: Plan) -> None:
        weights = plan.estimate.class_weights if plan.estimate else {}
        share = np.array([weights.get(name, 0.0) for name in plan.ids])
        colors = [self._colors[name] for name in plan.ids]
        lines = [strokes.even(r.trajectory.points, LIFTED_POINTS) for r in plan.references]
        named = strokes.apart(lines)
        short = [title(name) for name in plan.ids]
        flat = [lift(at_most(r.trajectory.points, REFERENCE_POINTS), 0.05) for r in plan.references]
        radii = (0.012 + 0.02 * np.sqrt(share)).astype(np.float32)
        self._strips("/world/references", flat, colors, radii)
        told = [i for i, w in enumerate(share) if i < LIFTED or w >= 0.01]  # more names than that hide the scene
        self._names(
            "/world/names",
            [lift(lines[i][named[i]], 0.1) for i in told],
            [f"{short[i]}   {100 * share[i]:.0f} %" for i in told],
            [colors[i] for i in told],
        )
        homology, turn = self._subject.space.homology, self._subject.turn
        for obstacle, path, _ in self._subject.lifted:
            chosen = list(zip(plan.references, lines, strict=True))[:LIFTED]
            raised = [lift(line, turn * strokes.remaining(homology, r, line, obstacle)) for r, line in chosen]
            named = strokes.apart(raised)
            self._strips(f"{path}/references", raised, colors, np.full(len(raised), 0.04, np.float32))
            self._names(f"{path}/names", [line[i] for line, i in zip(raised, named, strict=True)], short, colors)

    def _strips(
        self, path: str, strips: Sequence[strokes.Floats], colors: Sequence[Color], radii: strokes.Floats
    ) -> None:
        self._log(path, rr.LineStrips3D(strips, colors=packed(colors[: len(strips)]), radii=radii))

    def _names(
        self, path: str, places: Sequence[strokes.Floats], texts: Sequence[str], colors: Sequence[Color]
    ) -> None:
        pale = packed([mix(color, (255, 255, 255), 0.4) for color in colors[: len(places)]])
        points = np.array(places, np.float32).reshape(-1, 3)
        labels = list(texts[: len(places)])
        self._log(path, rr.Points3D(points, radii=0.001, colors=pale, labels=labels, show_labels=True))

    def _log(self, path: str, archetype: rr.AsComponents) -> None:
        self._stream.log(path, *self._now, archetype)


def _fan_path(name: str) -> str:
    return str(rr.new_entity_path(["world", "samples", name]))
