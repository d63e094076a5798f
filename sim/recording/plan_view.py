"""Pictures of a plan: references, samples, their means, why, and the references in the lifted trees and in time.

/spacetime, with the map as floor and time upward, has what moves in space and time:
/spacetime/bodies/NAME  the tube of a moving obstacle, to the latest time drawn so far; `name` below it
/spacetime/walls, /spacetime/goal, /spacetime/axis   static obstacles and the goal, as high; seconds
/spacetime/now, /spacetime/path   at the height of the time, with the robot below it; the driven path
/spacetime/braids, /spacetime/names, /spacetime/samples   references, their labels, the heaviest samples of each class
/spacetime/foreseen     predicted outlines of moving obstacles
"""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.estimation.sampler import PathIntegral
from pirrht.geometry.polyline import even
from pirrht.plotting.colors import ClassColors, Color, blend
from pirrht.plotting.strokes import outline
from sim.drawing import strokes
from sim.drawing.colors import DEAD_COLOR, MOVER, fade, packed, title
from sim.drawing.strokes import DEAD, ROUGH, Fan, Floats, Outline, Tube, at_most, foreseen, lift, placed, tubes
from sim.recording.geoms import on_floor
from sim.recording.reasons import page, reasons, share, shares_of, words_of
from sim.recording.stage import BORDER, CONTROL, FLOOR, GOAL, TIMES, VALUE, entity
from sim.recording.subject import Stream, Subject

SAMPLE_POINTS, CLASS_POINTS = 2500, 300  # of all samples of a picture, less so many for each class: 45 kB together
REFERENCE_POINTS, KNOTS = 64, 48  # of a reference on the map, and of a braid, at most
NAMED = 0.005  # share of psi from which a class bears its name on the map
MEANS, HEAVY = 6, 0.01  # classes whose mean path is drawn: at most, and from this share on
LIFTED, LIFTED_POINTS = 6, 32  # references drawn in a lifted tree, the cheapest first
THREADS, BEADS = 24, 12  # samples in space and time at most, and points of each
TICKS = 8  # seconds that are named, at most

# See-through:
BODY = (*MOVER, 20)
WALL = (*BORDER, 12)
ARRIVAL = (*GOAL, 16)

NO_FAN = Fan(
    strips=np.empty((0, 2, 3), np.float32), moments=np.empty((0, 2)), opacity=np.empty(0), ends=np.empty((0, 3))
)


class Pictures:
    """Logs pictures into one recording stream."""

    def __init__(self, stream: Stream, subject: Subject, colors: ClassColors) -> None:
        self._stream, self._subject, self._colors = stream, subject, colors
        self._first = subject
        self._fans: set[str] = set()
        self._now = (0, 0.0)  # moment of the plan drawn
        self._sizes = list[float]()  # square roots of its weights
        self._reached = 0.0  # until when there are tubes [s]
        self._words = dict[str, str]()  # of ways in space, by class

    def enter(self, path_integral: PathIntegral | None) -> Subject:
        """Return the context of the next plans, which a sampler made; None: the one before."""
        if path_integral is not None and path_integral is not self._subject.path_integral:
            self._subject = self._first.among(path_integral)
        return self._subject

    def draw(self, plan: Plan, step: int, time: float) -> None:
        """Log a plan at a step and simulated time [s]."""
        self._now = step, time
        subject, weights = self._subject, plan.estimate.class_weights if plan.estimate else {}
        lines = [
            at_most(r.trajectory.points[:, : subject.space.scene.dimension], REFERENCE_POINTS) for r in plan.references
        ]
        heaviest = sorted(plan.ids, key=lambda n: -weights.get(n, 0.0))
        words, grid = words_of(plan, subject.path_integral, subject.names), subject.grid
        called = {name: title(name) for name in plan.ids}
        if subject.in_space:  # from the start on a class keeps its words, whatever is left of its path
            called = words = self._words = words | self._words
        labels = {name: called[name] for name in plan.ids[:LIFTED]}
        if plan.estimate is not None:
            heavy = [name for name in heaviest if weights.get(name, 0.0) >= NAMED]
            labels = {name: f"{called[name]}   {share(weights[name])}" for name in heavy}
        self._sizes = [weights.get(name, 0.0) ** 0.5 for name in plan.ids]
        self._references(plan, lines)
        self._label("/world/names", labels, plan, [even(line, LIFTED_POINTS) for line in lines])
        self._means(plan, [name for name in heaviest if weights.get(name, 0.0) >= HEAVY][:MEANS])
        fans = self._samples(plan)
        if grid is not None and grid.moves:
            self._log(VALUE, on_floor(grid, subject.space, time))
        exact = None if grid is None else shares_of(grid, plan, time)
        why = reasons(plan, subject.path_integral, subject.solids, words, exact)
        self._log("/why/page", rr.TextDocument(page(plan, why, time), media_type=rr.MediaType.MARKDOWN))
        if subject.moves:
            soon = foreseen(plan.movers, plan.time)
            later = [one for one in soon if one.after > 0.0]
            self._strips("/world/foreseen", [placed(one.ring, 0.03) for one in later], _paler(later), 0.008)
        if subject.in_time:
            self._draw_in_time(plan, fans, labels)

    def _label(self, path: str, labels: Mapping[str, str], plan: Plan, lines: Sequence[Array | Floats]) -> None:
        """Log the labels of classes on their lines (k, 2) or (k, 3) [m]."""
        places = {name: line[i] for name, line, i in zip(plan.ids, lines, strokes.apart(lines), strict=False)}
        at = np.array([places[name] for name in labels]).reshape(len(labels), lines[0].shape[1] if lines else 3)
        points = placed(at, 0.1)
        self._names(path, points, list(labels.values()), [self._colors[name] for name in labels])

    def _samples(self, plan: Plan) -> dict[str, Fan]:
        """Log and return samples by class."""
        fans: dict[str, Fan] = {}
        if plan.estimate is not None and self._subject.look.samples != "none":
            most = max(0, SAMPLE_POINTS - CLASS_POINTS * len(plan.ids))
            everything = self._subject.look.samples == "all"
            integral = self._subject.path_integral
            fans = strokes.fans(integral, plan.estimate, plan.classes, points=most, everything=everything)
        body = self._subject.space.scene.body
        for name in [*sorted(self._fans - fans.keys()), *fans]:
            fan = fans.get(name, NO_FAN)
            dead = name == DEAD
            opacity = np.full(len(fan.strips), 0.5) if dead else 0.25 + 0.75 * fan.opacity
            shades = fade(DEAD_COLOR if dead else self._colors[name], FLOOR, opacity)
            self._strips(str(rr.new_entity_path(["world", "samples", name])), fan.strips, shades, 0.006)
            if not body.is_disc:
                robots = lift(strokes.heavy_ends(body, fan), 0.015)
                self._strips(str(rr.new_entity_path(["world", "ends", name])), robots, shades[-len(robots) :], 0.008)
        self._fans = set(fans)
        return fans

    def _means(self, plan: Plan, heavy: Sequence[str]) -> None:
        """Log the mean paths of the samples of the heavy classes."""
        means: dict[str, Array] = {}
        if plan.estimate is not None:
            keys = {key: name for key, name in plan.classes.items() if name in heavy}
            means = strokes.mean_paths(self._subject.path_integral, plan.estimate, keys)
        names = [name for name in reversed(heavy) if name in means]  # the favourite on top
        colors = [CONTROL if name == plan.favourite else blend(self._colors[name], CONTROL, 0.45) for name in names]
        radii = [0.014 if name == plan.favourite else 0.008 for name in names]
        strips = [placed(means[name], 0.065 + 0.001 * k) for k, name in enumerate(names)]
        self._strips("/world/ways", strips, colors, radii)

    def _references(self, plan: Plan, lines: Sequence[Array]) -> None:
        colors = [self._colors[name] for name in plan.ids]
        radii = [0.008 + 0.024 * size for size in self._sizes]
        self._strips("/world/references", [placed(line, 0.05) for line in lines], colors, radii)
        few = plan.references[:LIFTED]
        chosen = [(r, even(line, LIFTED_POINTS)) for r, line in zip(few, lines, strict=False)]
        texts = [f"class {title(name)}: cost {r.cost:.2f}" for name, r in zip(plan.ids, few, strict=False)]
        homology, turn = self._subject.space.homology, self._subject.turn
        for obstacle, path, _ in self._subject.lifted:
            raised = [lift(line, turn * strokes.remaining(homology, r, line, obstacle)) for r, line in chosen]
            self._strips(f"{path}/references", raised, colors[: len(few)], 0.04)
            places = [line[i] for line, i in zip(raised, strokes.apart(raised), strict=True)]
            self._names(f"{path}/names", places, texts, colors[: len(few)])

    def _draw_in_time(self, plan: Plan, fans: Mapping[str, Fan], labels: Mapping[str, str]) -> None:
        """Log moving obstacles as predicted, and the plan with time upward."""
        lines = [at_most(strokes.timed(one, plan.time), KNOTS) for one in plan.references]
        self.reach(max([self._now[1], *(float(line[-1, 2]) for line in lines)]))
        braids = [self.raised(line) for line in lines]
        colors = [self._colors[name] for name in plan.ids]
        radii = [0.018 + 0.03 * size for size in self._sizes]
        self._strips(f"{TIMES}/braids", braids, colors, radii)
        self._label(f"{TIMES}/names", labels, plan, braids)
        alive = {name: fan for name, fan in fans.items() if name != DEAD}
        heavy = slice(-max(1, THREADS // max(1, len(alive))), None)
        threads = [
            self.raised(at_most(np.column_stack([strip[:, :2], moments + plan.time]), BEADS))
            for fan in alive.values()
            for strip, moments in zip(fan.strips[heavy], fan.moments[heavy], strict=True)
        ]
        pale = [fade(self._colors[name], FLOOR, 0.15 + 0.5 * fan.opacity[heavy]) for name, fan in alive.items()]
        self._strips(f"{TIMES}/samples", threads, np.vstack(pale) if pale else [], 0.006)
        soon = foreseen(plan.movers, plan.time)
        rings = [self.raised(_at(one.ring, plan.time + one.after)) for one in soon]
        self._strips(f"{TIMES}/foreseen", rings, _paler(soon), 0.012)

    def reach(self, time: float) -> None:
        """Let tubes, walls and axis go on to a time [s]."""
        if time <= self._reached:
            return
        begin, self._reached = self._reached, float(ceil(time))
        scene, ends = self._subject.space.scene, np.array([begin, self._reached])
        turn = np.linspace(0.0, 2.0 * np.pi, ROUGH, endpoint=False)
        around = scene.goal.center + scene.goal.radius * np.column_stack([np.cos(turn), np.sin(turn)])
        meshes = [
            (entity(f"{TIMES}/bodies", m.name), tubes(m, begin, self._reached, ROUGH), BODY) for m in scene.movers
        ]
        for name, outlines, color in (("walls", map(outline, scene.obstacles), WALL), ("goal", [around], ARRIVAL)):
            still = [Tube(times=ends, rings=np.stack([ring, ring])) for ring in outlines]
            meshes.append((f"{TIMES}/{name}", still, color))
        for path, parts, color in meshes:
            if parts:
                places = [_at(ring, at) for part in parts for at, ring in zip(part.times, part.rings, strict=True)]
                first = np.cumsum([0, *(part.rings.shape[0] * part.rings.shape[1] for part in parts)])
                faces = np.vstack([part.faces + k for part, k in zip(parts, first, strict=False)]).astype(np.uint32)
                corners = self.raised(np.vstack(places))
                self._log(path, rr.Mesh3D(vertex_positions=corners, triangle_indices=faces, albedo_factor=color))
        seconds = np.arange(begin, self._reached + 1e-9, max(1, ceil((self._reached - begin) / TICKS)))
        marks = self.raised(np.column_stack([np.broadcast_to(scene.upper, (len(seconds), 2)), seconds]))
        look = {"labels": [f"{s:g} s" for s in seconds], "colors": [BORDER], "show_labels": True}
        self._log(f"{TIMES}/axis", rr.Points3D(marks, radii=0.04, **look))

    def raised(self, line: Array) -> Floats:
        """Places and times (k, 3) [m, m, s] as they are with time upward, (k, 3) [m]."""
        return lift(line[:, :2], np.rint(256.0 * self._subject.rise * line[:, 2]) / 256.0)

    def _strips(self, path: str, strips: Sequence[Floats] | Floats, colors: Any, radii: float | list[float]) -> None:
        self._log(path, rr.LineStrips3D(strips, colors=packed(colors), radii=radii))

    def _names(
        self, path: str, places: Sequence[Array] | Floats, texts: Sequence[str], colors: Sequence[Color]
    ) -> None:
        pale = packed([blend(color, (255, 255, 255), 0.4) for color in colors])
        points = np.array(places, np.float32).reshape(-1, 3)
        self._log(path, rr.Points3D(points, radii=0.0, colors=pale, labels=list(texts), show_labels=True))

    def _log(self, path: str, archetype: rr.AsComponents) -> None:
        self._stream.log(path, *self._now, archetype)


def _at(points: Array, time: float) -> Array:
    """Points (k, 2) [m] at a time [s], (k, 3)."""
    return np.column_stack([points, np.full(len(points), time)])


def _paler(outlines: Sequence[Outline]) -> Any:
    """Colours of predicted outlines, the paler the later."""
    return fade(MOVER, FLOOR, np.array([one.strength for one in outlines]))
