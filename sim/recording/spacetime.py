"""The tab Space-time: the map as floor, time upward; classes are braids around the tubes of moving obstacles.

/spacetime/bodies/NAME  the tube of a moving obstacle, to the latest time drawn so far; `name` below it
/spacetime/walls, /spacetime/goal    static obstacles and the goal, as high
/spacetime/axis         seconds
/spacetime/now          at the height of the time, with the robot below it
/spacetime/path         the driven path
/spacetime/braids, /spacetime/names   the reference of every class, and its label
/spacetime/samples      the heaviest samples of each class
/spacetime/foreseen     predicted outlines of moving obstacles
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.geometry.scene import Scene
from sim.drawing import strokes
from sim.drawing.colors import DRIVEN, MOVER, ClassColors, fade, mix
from sim.drawing.strokes import DEAD, Fan, Outline, Tube, at_most, lift, packed, tubes
from sim.plotting.ground import outline
from sim.recording.static import BORDER, CONTROL, FLOOR, GOAL, RADIUS, Log, all_named, outer
from sim.recording.step_row import Row
from sim.recording.stream import Stream
from sim.recording.subject import Subject

FOLDER = "/spacetime"
NOW, PATH, WALLS, ARRIVALS, AXIS = (f"{FOLDER}/{name}" for name in ("now", "path", "walls", "goal", "axis"))
KNOTS = 48  # of a braid at most
THREADS, BEADS = 24, 12  # samples drawn at most, and points of each
CORNERS = 20  # of what is round
BODY, WALL, ARRIVAL, SHEET = (*MOVER, 20), (*BORDER, 12), (*GOAL, 16), (*CONTROL, 4)  # see-through
TICKS = 8  # seconds that are named, at most

Now = tuple[int, float]  # step and simulated time [s]


def body_path(name: str) -> str:
    """The entity of a tube."""
    return f"{FOLDER}/bodies/{rr.escape_entity_path_part(name)}"


def growing(scene: Scene) -> list[str]:
    """Entities of which all is shown that was logged up to the time shown."""
    return [PATH, WALLS, ARRIVALS, AXIS, *(body_path(mover.name) for mover in scene.movers)]


def stage(subject: Subject, log: Log) -> None:
    """Log what stays as it is: names, the looks of path and of now."""
    scene = subject.space.scene
    for mover in scene.movers:
        where, name = lift(mover.motion.pose(np.zeros(1))[:, :2], 0.05), mover.name.replace("_", " ")
        look = {"labels": [name], "colors": [MOVER], "show_labels": all_named(subject)}
        log(f"{body_path(mover.name)}/name", rr.Points3D(where, radii=0.0, **look))
    log(PATH, rr.LineStrips3D.from_fields(colors=[DRIVEN], radii=[0.02]))
    border = lift(outer(scene), 0.0)
    log(NOW, rr.LineStrips3D(border[None], radii=0.008, colors=[mix(CONTROL, FLOOR, 0.4)]))
    sheet = {"vertex_positions": border[:4], "triangle_indices": [(0, 1, 2), (0, 2, 3)]}
    log(f"{NOW}/sheet", rr.Mesh3D(**sheet, albedo_factor=SHEET))
    log(f"{NOW}/robot", rr.Points3D([(0.0, 0.0, 0.0)], radii=rr.Radius.ui_points(RADIUS), colors=[DRIVEN]))


class SpaceTime:
    """Draws a run in space and time into one recording stream."""

    def __init__(self, stream: Stream, subject: Subject, colors: ClassColors) -> None:
        self._stream, self._subject, self._colors = stream, subject, colors
        self._drawn = 0.0  # until when there are tubes [s]

    def draw(
        self, plan: Plan, soon: Sequence[Outline], fans: Mapping[str, Fan], labels: Mapping[str, str], now: Now
    ) -> None:
        """Log a plan at a step and time [s].

        Args:
            soon: outlines of moving obstacles, now and predicted.
            fans: the samples drawn of each class.
            labels: of classes, by id.
        """
        lines = [at_most(strokes.timed(one, plan.time), KNOTS) for one in plan.references]
        self._reach(max([now[1], *(float(line[-1, 2]) for line in lines)]), now)
        braids, colors = [self._raised(line) for line in lines], [self._colors[name] for name in plan.ids]
        weights = plan.estimate.class_weights if plan.estimate else {}
        radii = [0.018 + 0.03 * weights.get(name, 0.0) ** 0.5 for name in plan.ids]
        self._stream.log(f"{FOLDER}/braids", *now, rr.LineStrips3D(braids, colors=packed(colors), radii=radii))
        self._samples(plan, fans, now)
        at = dict(zip(plan.ids, (line[i] for line, i in zip(braids, strokes.apart(braids), strict=True)), strict=True))
        pale = packed([mix(self._colors[name], (255, 255, 255), 0.4) for name in labels])
        places = np.array([at[name] for name in labels], np.float32).reshape(-1, 3)
        look = {"radii": 0.0, "colors": pale, "labels": list(labels.values()), "show_labels": True}
        self._stream.log(f"{FOLDER}/names", *now, rr.Points3D(places, **look))
        rings = [self._raised(_at(one.ring, plan.time + one.after)) for one in soon]
        shades = packed(fade(MOVER, FLOOR, np.array([one.strength for one in soon])))
        self._stream.log(f"{FOLDER}/foreseen", *now, rr.LineStrips3D(rings, colors=shades, radii=0.012))

    def follow(self, rows: Sequence[Row], steps: Sequence[int], at: Array) -> None:
        """Log what was driven in control steps, and places and times (k, 3) [m, m, s] at steps, to the run's end."""
        ends = [np.append(r.states[-1, :2], r.time + r.duration) for r in rows]
        strips = [self._raised(np.vstack([start, end])) for start, end in zip(at, ends, strict=False)]
        times = at[:, 2].tolist()
        self._stream.columns(PATH, steps[: len(rows)], times[: len(rows)], rr.LineStrips3D.columns(strips=strips))
        for path, scale in ((NOW, (0.0, 0.0, self._subject.rise)), (f"{NOW}/robot", (1.0, 1.0, 0.0))):
            self._stream.columns(path, steps, times, rr.Transform3D.columns(translation=at * scale))

    def _samples(self, plan: Plan, fans: Mapping[str, Fan], now: Now) -> None:
        """Log the heaviest of each class that arrived."""
        known = {name: fan for name, fan in fans.items() if name != DEAD}
        heavy = slice(-max(1, THREADS // max(1, len(known))), None)
        strips, shades = [], [np.zeros((0, 3), np.uint8)]
        for name, fan in known.items():
            at = np.rint(np.linspace(0, fan.strips.shape[1] - 1, min(BEADS, fan.strips.shape[1]))).astype(int)
            flat, moments = fan.strips[heavy][:, at, :2], fan.moments[heavy][:, at]
            strips += [self._raised(line) for line in np.dstack([flat, moments + plan.time])]
            shades.append(fade(self._colors[name], FLOOR, 0.15 + 0.5 * fan.opacity[heavy]))
        drawn = rr.LineStrips3D(strips, colors=packed(np.vstack(shades)), radii=0.006)
        self._stream.log(f"{FOLDER}/samples", *now, drawn)

    def _reach(self, time: float, now: Now) -> None:
        """Let tubes, walls and axis go on to a time [s]."""
        if time <= self._drawn:
            return
        begin, self._drawn = self._drawn, float(ceil(time))
        scene = self._subject.space.scene
        meshes = [(body_path(m.name), tubes(m, begin, self._drawn, CORNERS), BODY) for m in scene.movers]
        turn = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
        around = scene.goal.center + scene.goal.radius * np.column_stack([np.cos(turn), np.sin(turn)])
        ends = np.array([begin, self._drawn])
        for path, rings, color in ((WALLS, map(outline, scene.obstacles), WALL), (ARRIVALS, [around], ARRIVAL)):
            meshes.append((path, [Tube(times=ends, rings=np.stack([ring, ring])) for ring in rings], color))
        for path, parts, color in meshes:
            if parts:
                self._stream.log(path, *now, self._mesh(parts, color))
        seconds = np.arange(begin, self._drawn + 1e-9, max(1, ceil((self._drawn - begin) / TICKS)))
        marks = self._raised(np.column_stack([np.broadcast_to(scene.upper, (len(seconds), 2)), seconds]))
        look = {"labels": [f"{s:g} s" for s in seconds], "colors": [BORDER], "show_labels": True}
        self._stream.log(AXIS, *now, rr.Points3D(marks, radii=0.04, **look))

    def _mesh(self, parts: Sequence[Tube], color: tuple[int, ...]) -> rr.AsComponents:
        """Several tubes as one mesh."""
        places = [_at(ring, time) for part in parts for time, ring in zip(part.times, part.rings, strict=True)]
        first = np.cumsum([0, *(part.rings.shape[0] * part.rings.shape[1] for part in parts)])
        faces = np.vstack([part.faces + k for part, k in zip(parts, first, strict=False)]).astype(np.uint32)
        return rr.Mesh3D(vertex_positions=self._raised(np.vstack(places)), triangle_indices=faces, albedo_factor=color)

    def _raised(self, line: Array) -> strokes.Floats:
        """Places and times (k, 3) [m, m, s] as they are in the view, (k, 3) [m]."""
        return lift(line[:, :2], np.rint(256.0 * self._subject.rise * line[:, 2]) / 256.0)


def _at(points: Array, time: float) -> Array:
    """Points (k, 2) [m] at a time [s], (k, 3)."""
    return np.column_stack([points, np.full(len(points), time)])
