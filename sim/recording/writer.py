"""Contents of a recording, batch by batch: numbers at every step, pictures where they are due.

/steps        a row per control step, described in `columns.py`
/world/robot  pose of its root; arrows where the control would take it and, if known, the optimal control
/world/eyes/following    an eye that follows the robot
/world/scene/movers/NAME  pose of a moving obstacle, as long as it moves; `/world/foreseen` its predicted outlines
/world/path   position after every physics step
/spacetime    the run with time upward, where obstacles move; described in `plan_view.py`
/why/weight, /why/ess, /why/arriving   shares, effective samples, and share of samples that arrive: of all other classes
              and of each of a few
/why/risk     predicted probability of a collision: of all paths, and of each of those classes
/why/value    v of all paths, one standard error below and above, of each of those classes, and if known the exact one
/why/clearance, /why/control, /why/cost   clearance, u, and the cost so far without and with the value
/why/optimum  control: standard error of u, and |u - u*|; value: the error with its standard error around it
/why/page     the argument of the plan in words, where a picture is due
/tree/K       tree lifted by the H of obstacle K: references from the state
/log          what happened
/map, /world/map   what a robot with a lidar knows; described in `known.py`
/timing/plan  wall time of a plan [ms]; rows of `/steps` a second time where their batch took long to fill
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from itertools import chain
from math import inf, log
from textwrap import wrap
from typing import Any

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.plotting.colors import ClassColors, Color
from pirrht.topology.signature import OTHER
from sim.drawing.colors import DRIVEN, title
from sim.drawing.strokes import single
from sim.drive.metrics import Frame
from sim.mjcf.obstacles import Mocap
from sim.recording.columns import COMPONENTS, cells
from sim.recording.geoms import RobotPoses
from sim.recording.known import Known
from sim.recording.plan_view import Pictures
from sim.recording.reasons import arriving
from sim.recording.stage import FOLLOWING, MOVERS, OPTIMUM, TIMES, Following, entity, properties, stage
from sim.recording.subject import Moments, Stream, Subject

WAIT = 0.15  # how long a step may wait for its batch before it is written ahead of it [s]
BATCH_STEPS, BATCH_TIME = 8, 0.36  # rows per chunk at least, and the time they span [s]: a chunk costs 1 to 3 kB
LINE = 56  # letters of a line of the log, which the viewer does not wrap
AHEAD = 0.5  # the arrow reaches where the control would take the robot in this time [s]
PIECES = 5  # in which that is computed
LINES, CHEAPEST, HEAVY = 8, 6, 0.01  # classes in the plots: at most, from the start, from this weight on
BAND = "one standard error"
BEGIN = [(0, 0.0)]
# Seen on any ground:
DIM = (120, 122, 128)  # of errors
PLAIN = (164, 128, 230)  # of what belongs to no class


class Row:
    """One control step; it holds on to samples, of which there may be many, only where they are drawn."""

    def __init__(self, frame: Frame, drawn: bool) -> None:
        plan, estimate = frame.plan, frame.plan.estimate
        self.moment = frame.step, frame.time  # at its start, simulated time [s]
        self.end = frame.end_time  # [s]
        self.states = np.vstack([plan.state, frame.advance.states])  # at its start and after each physics step
        attitudes = frame.advance.attitudes[[0, -1]]
        self.posed = np.hstack([self.states[[0, -1]], attitudes])  # at its start and end, with attitudes if it flies
        self.cells = cells(frame)  # its values at `/steps`, by component
        self.arriving = arriving(estimate, plan.ids) if estimate else {}  # share of the samples of each class
        self.risks = frame.collision.classes if frame.collision else {}  # given the class
        self.ids, self.plan_seconds = plan.ids, frame.plan_seconds
        self.outcome, self.news = frame.outcome, frame.news
        self.plan = plan if drawn else None
        self.path_integral, self.believed = frame.path_integral, frame.believed

    def __getitem__(self, component: str) -> float:
        return float(self.cells[component][0])


class Writer:
    """Writes one recording into a stream, at once all that stays as it is; runs on one thread."""

    def __init__(self, stream: Stream, subject: Subject) -> None:
        self.stream, self._subject = stream, subject
        scene, colors = subject.space.scene, ClassColors()
        self._dynamics, self._adapter = subject.path_integral.problem.dynamics, subject.loaded.adapter
        self._pictures = Pictures(stream, subject, colors)
        self._batch: list[Row] = []
        self._secured, self._waiting_since = 0, inf  # rows of the batch written ahead, when the next one came [s]
        self._robot = RobotPoses(subject.loaded)
        self._eye = Following(scene, self._adapter.drawn(scene.start, 0.0))
        self._known = Known(stream, subject)
        self._mocap = Mocap(subject.loaded.model, subject.movers) if subject.movers else None
        self._shown = [np.full(7, np.nan) for _ in subject.movers]  # the last pose that was written of each
        name = (scene.name, subject.settings.get("method"), subject.settings.get("seed"))
        stream.native.send_recording_name(" ".join(str(part) for part in name if part is not None))
        stream.cut()
        stream.native.send_property("run", rr.AnyValues(**properties(subject.settings)))
        stream.cut()
        # Places before there is anything to see: what has none yet would be at the origin.
        start = np.asarray(self._dynamics.state_of(scene.start))[None]
        self._transforms("/world/robot", BEGIN, self._robot.at(start))
        self._transforms(FOLLOWING, BEGIN, self._eye.poses(self._adapter.drawn(start, 0.0), np.zeros(1)))
        self._movers(BEGIN)
        stage(subject, stream.static)
        self._plots = Plots(stream, subject, colors)

    def add(self, row: Row) -> bool:
        """Take in a step; whether its batch was written, which depends on steps and simulated time alone."""
        self._batch.append(row)
        self._waiting_since = min(self._waiting_since, time.monotonic())
        span = row.end - self._batch[0].moment[1]
        full = row.outcome is not None or (len(self._batch) >= BATCH_STEPS and span >= BATCH_TIME - 1e-9)
        if full:
            self.end()
        return full

    def secure(self) -> bool:
        """Write the steps ahead that have waited too long, lest a crash lose them; whether there were any."""
        if time.monotonic() - self._waiting_since < WAIT:
            return False
        rows = self._batch[self._secured :]
        self.stream.columns("/timing/plan", [r.moment for r in rows], _values(rows))
        self._secured, self._waiting_since = len(self._batch), inf
        return True

    def end(self) -> None:
        """Write all that is not written yet."""
        rows, self._batch = self._batch, []
        self._secured, self._waiting_since = 0, inf
        if not rows:
            return
        moments = [r.moment for r in rows]
        self.stream.columns("/steps", moments, _values(rows))
        self._poses(rows, moments)
        self._plots.draw(rows, moments)
        self.stream.columns("/timing/plan", moments, rr.Scalars.columns(scalars=[1e3 * r.plan_seconds for r in rows]))
        for row in rows:
            for line in wrap(row.news or "", LINE):
                self.stream.log("/log", *row.moment, rr.TextLog(line, level="INFO"))
            if row.plan is None:
                continue
            subject = self._pictures.enter(row.path_integral)
            self._pictures.draw(row.plan, *row.moment)
            if row.believed is not None:
                self._known.draw(row.believed, subject, self._adapter.poses(row.states[:1])[0], row.moment)

    def _poses(self, rows: Sequence[Row], moments: Moments) -> None:
        """Log robot, control, eye, driven path and moving obstacles, after the last step of a run also at its end."""
        states = [r.states[0] for r in rows]
        last = rows[-1]
        controls = [[np.array(u) for u in (r.cells["control"], r.cells["exact_control"]) if u] for r in rows]
        vectors = [self._ahead(x, u) for x, known in zip(states, controls, strict=True) for u in known]
        lengths = [len(known) for known in controls]
        eyes = self._eye.poses(self._adapter.drawn(np.array(states), 0.0), np.array([r["duration"] for r in rows]))
        self._transforms(FOLLOWING, moments, eyes)
        pieces = [single(self._adapter.drawn(r.states, 0.06)) for r in rows]
        self.stream.columns("/world/path", moments, rr.LineStrips3D.columns(strips=pieces))
        every = moments
        if last.outcome is not None:
            states = [*states, last.states[-1]]
            lengths = [*lengths, 0]
            every = [*moments, (last.moment[0] + 1, last.end)]
        arrows = rr.Arrows3D.columns(vectors=vectors).partition(lengths)
        posed = [r.posed[0] for r in rows] + [last.posed[1]] * (last.outcome is not None)
        self._transforms("/world/robot", every, self._robot.at(np.array(posed)), arrows)
        self._movers(every)
        if not self._subject.in_time:
            return
        at = np.column_stack([self._adapter.above(np.array(states)), [time for _, time in every]])
        ends = [np.append(self._adapter.above(r.states[-1]), r.end) for r in rows]
        strips = [self._pictures.raised(np.vstack(both)) for both in zip(at, ends, strict=False)]
        self.stream.columns(f"{TIMES}/path", moments, rr.LineStrips3D.columns(strips=strips))
        for path, scale in ((f"{TIMES}/now", (0.0, 0.0, self._subject.rise)), (f"{TIMES}/now/robot", (1.0, 1.0, 0.0))):
            self.stream.columns(path, every, rr.Transform3D.columns(translation=at * scale))

    def _movers(self, moments: Moments) -> None:
        if self._mocap is None:
            return
        places, turns = self._mocap.poses(np.array([time for _, time in moments]))
        poses = np.concatenate([places, np.roll(turns, -1, axis=2)], axis=2)  # MuJoCo writes w first
        for j, mover in enumerate(self._subject.movers):
            if np.any(poses[:, j] != self._shown[j]):
                self._shown[j] = poses[-1, j]
                self._transforms(entity(MOVERS, mover.name), moments, poses[:, j])

    def _ahead(self, x: Array, u: Array) -> Array:
        """Predict without noise where the control takes the robot in a short while, in the robot's frame, (3,)."""
        dynamics, start, still = self._dynamics, x, np.zeros(self._dynamics.m)
        for _ in range(PIECES):
            x = dynamics.step(x, u, still, AHEAD / PIECES)
        return self._adapter.ahead(start, x)

    def _transforms(self, path: str, moments: Moments, poses: Array, more: Iterable[Any] = ()) -> None:
        """Log poses (k, 7), which are places [m] and quaternions, w last, with more columns."""
        columns = rr.Transform3D.columns(translation=poses[:, :3], quaternion=poses[:, 3:])
        self.stream.columns(path, moments, [*columns, *more])


def _values(rows: Sequence[Row]) -> list[Any]:
    """All components of some steps, each with any number of values per step."""
    parts: list[Any] = []
    for name in COMPONENTS:
        values = [row.cells[name] for row in rows]
        if flat := list(chain.from_iterable(values)):
            parts += rr.AnyValues.columns(**{name: flat}).partition([len(row) for row in values])
    return parts


class Plots:
    """Logs the numbers behind the control into one recording stream: for all other classes together and for a few."""

    def __init__(self, stream: Stream, subject: Subject, colors: ClassColors) -> None:
        problem = subject.path_integral.problem
        self._stream, self._temperature, self._colors = stream, problem.temperature, colors
        self._exact, m = ["exact"] * subject.look.truth, problem.dynamics.m
        self._names: list[str] | None = None  # classes that have a line of their own
        self._style("clearance", ["clearance"], [PLAIN], [1.6])
        self._style("control", [f"u{k + 1}" for k in range(m)], [PLAIN, DRIVEN, OPTIMUM, DIM][:m], [1.6] * m)
        self._style("cost", ["so far", "with the value of what is left"], [DRIVEN, PLAIN], [2.0, 1.2])
        if self._exact:
            self._style("optimum/control", [BAND, "|u - u*|"], [DIM, OPTIMUM], [1.0, 2.0])
            names = [BAND, BAND, "all paths", *self._exact]
            self._style("optimum/value", names, [DIM, DIM, PLAIN, OPTIMUM], [1.0, 1.0, 1.2, 2.0])

    def draw(self, rows: Sequence[Row], moments: Moments) -> None:
        """Log some steps."""
        names = self._name_classes(rows)
        spare = [inf] * (LINES - len(names))  # NaN would make equal recordings unequal
        lines: dict[str, list[list[float]]] = {}
        for r in rows:
            weights, sizes = (dict(zip(r.cells["classes"], r.cells[kind], strict=True)) for kind in ("weights", "ess"))
            share = [weights.get(name, 0.0) for name in names]
            value = r["value"]
            by_class = [value - self._temperature * log(w) if w > 0 else inf for w in share]
            risks = [r.risks.get(n, inf) if w >= HEAVY else inf for n, w in zip(names, share, strict=True)]
            exact = r.cells["exact_value"]
            band = _band(value, r["value_error"])

            for path, line in (
                ("weight", [max(0.0, sum(weights.values()) - sum(share)), *share, *spare]),
                ("ess", [sizes.get(OTHER, 0.0), *(sizes.get(name, 0.0) for name in names), *spare]),
                ("arriving", [inf, *(r.arriving.get(name, inf) for name in names), *spare]),
                ("risk", [*(r.cells["collision"] or [inf]), *risks, *spare]),
                ("value", [value, *band, *by_class, *spare, *exact]),
                ("clearance", r.cells["clearance"]),
                ("control", r.cells["control"]),
                ("cost", [r["cost"], r["cost"] + value]),
            ):
                lines.setdefault(path, []).append(line)
            if exact:
                off = float(np.linalg.norm(np.subtract(r.cells["control"], r.cells["exact_control"])))
                error = value - exact[0] if value < inf and exact[0] < inf else inf
                lines.setdefault("optimum/control", []).append([float(np.linalg.norm(r.cells["control_error"])), off])
                lines.setdefault("optimum/value", []).append([*_band(error, r["value_error"]), error, 0.0])
        for path, table in lines.items():
            columns = rr.Scalars.columns(scalars=np.float32(np.concatenate(table)))
            self._stream.columns(f"/why/{path}", moments, columns.partition([len(line) for line in table]))

    def _name_classes(self, rows: Sequence[Row]) -> list[str]:
        """Give colours to new classes, and return those with lines: the cheapest at first, then the heavy."""
        names = list(self._names or ())
        for row in rows:
            self._colors.meet(row.ids)
            weights = zip(row.cells["classes"], row.cells["weights"], strict=True)
            heavy = [name for name, w in weights if w >= HEAVY and name != OTHER]
            for name in [*(row.ids[:CHEAPEST] if not names else ()), *heavy]:
                if name not in names and len(names) < LINES:
                    names.append(name)
        if names != self._names:
            self._names = names
            self._style_classes(names)
        return names

    def _style_classes(self, names: Sequence[str]) -> None:
        """Give the lines of classes their names, colours and widths in every plot."""
        # The viewer requires equal numbers of lines at all times; those of equal name share a place in its legend.
        every = [OTHER, *names, *[OTHER] * (LINES - len(names))]
        titles = [OTHER if name == OTHER else f"class {title(name)}" for name in every]
        colors = [self._colors[name] for name in every]
        widths = [2.5] * len(every)

        for path in ("weight", "ess", "arriving"):
            self._style(path, titles, colors, widths)
        titles = ["all paths" if name == OTHER else name for name in titles]
        colors = [PLAIN if name == OTHER else self._colors[name] for name in every]
        self._style("risk", titles, colors, widths)
        names_of_value = [titles[0], BAND, BAND, *titles[1:], *self._exact]
        colors = [colors[0], PLAIN, PLAIN, *colors[1:], *(OPTIMUM for _ in self._exact)]
        self._style("value", names_of_value, colors, [2.5, 0.8, 0.8, *widths[1:], *(1.2 for _ in self._exact)])

    def _style(self, path: str, names: Sequence[str], colors: Sequence[Color], widths: Sequence[float]) -> None:
        self._stream.static(f"/why/{path}", rr.SeriesLines(names=names, colors=colors, widths=widths))


def _band(value: float, error: float) -> list[float]:
    """One standard error below and above a value, infinite if that is."""
    return [value - error, value + error] if value < inf else [inf, inf]
