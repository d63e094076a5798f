"""Contents of a recording, batch by batch: numbers at every step, pictures where they are due.

/steps        a row per control step, described in `columns.py`
/world/robot  pose of its root; arrows where the control would take it and, if known, the optimal control
/world/eyes/following    an eye that follows the robot
/world/scene/movers/NAME  pose of a moving obstacle, as long as it moves; `/world/foreseen` its predicted outlines
/world/path   position after every physics step
/spacetime    the run with time upward, where obstacles move; described in `spacetime.py`
/why/weight, /why/ess, /why/arriving   shares, effective samples, and share of samples that arrive: of all other classes
              and of each of a few; `/why/weight/switch` where another class has come to weigh most
/why/value    v of all paths, one standard error below and above, of each of those classes, and if known the exact one
/why/clearance, /why/control, /why/cost   clearance, u, and the cost so far without and with the value
/why/optimum  control: standard error of u, and |u - u*|; value: the error with its standard error around it
/why/page     the argument of the plan in words, where a picture is due
/tree/K       tree lifted by the H of obstacle K: references from the state
/log          what happened
/timing/plan  wall time of a plan [ms]; rows of `/steps` a second time where their batch took long to fill
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from itertools import chain
from math import inf
from textwrap import wrap
from typing import Any

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from sim.drawing.colors import ClassColors
from sim.drawing.strokes import lift
from sim.mjcf.motions import Mocap
from sim.recording import spacetime
from sim.recording.camera import FOLLOWING, Following
from sim.recording.columns import components
from sim.recording.geoms import RobotPoses
from sim.recording.plan_view import Pictures
from sim.recording.plots import Plots
from sim.recording.static import mover_path, properties, stage
from sim.recording.step_row import Row
from sim.recording.stream import Stream
from sim.recording.subject import Subject

BATCH_STEPS = 36  # rows per chunk: a chunk costs 1 to 3 kB whatever it holds
WAIT = 0.15  # how long a step may wait for its batch before it is written ahead of it [s]
BATCH_LEAST, BATCH_TIME = 8, 0.36  # fewer will do once they span so much simulated time [s]
LINE = 56  # letters of a line of the log, which the viewer does not wrap
AHEAD = 0.5  # the arrow reaches where the control would take the robot in this time [s]


def columns(rows: Sequence[Row]) -> list[Any]:
    """All components of some steps, each with any number of values per step; step and time are their index."""
    parts: list[Any] = []
    for name, column in components().items():
        assert column.values is not None
        texts = column.kind is str
        values = [[v if texts else float(v) for v in column.values(row)] for row in rows]
        if flat := list(chain.from_iterable(values)):
            parts += rr.AnyValues.columns(**{name: flat}).partition([len(row) for row in values])
    return parts


class Writer:
    """Writes one recording into a stream; runs on one thread."""

    def __init__(self, stream: Stream, subject: Subject) -> None:
        self.stream, self._subject = stream, subject
        scene, colors = subject.space.scene, ClassColors()
        self._dynamics = subject.path_integral.problem.dynamics
        self._pictures = Pictures(stream, subject, colors)
        self._plots = Plots(stream, subject.path_integral.problem, colors, truth=subject.look.truth)
        self._batch: list[Row] = []
        self._secured, self._waiting_since = 0, inf  # rows of the batch written ahead, when the next one came [s]
        self._robot, self._eye = RobotPoses(subject.loaded), Following(scene)
        self._mocap = Mocap(subject.loaded.model, scene.movers) if scene.movers else None
        self._shown = [np.full(7, np.nan) for _ in scene.movers]  # the last pose that was written of each

    def begin(self) -> None:
        """Everything that stays as it is."""
        subject, log = self._subject, self.stream.static
        self.stream.properties(properties(subject.settings), name=subject.name)
        self._place()  # before there is anything to see: what has no place yet would be at the origin
        stage(subject, log)
        if subject.moves:
            spacetime.stage(subject, log)
        self._plots.begin()

    def _place(self) -> None:
        """Place robot, moving obstacles and eyes at the start."""
        scene = self._subject.space.scene
        start = np.asarray(self._dynamics.state_of(scene.start))[None]
        places, turns = Following(scene).poses(start[:, :2], np.zeros(1))
        known = {"/world/robot": self._robot.at(start), FOLLOWING: np.column_stack([places, turns])}
        if self._mocap is not None:
            poses = self._mover_poses(self._mocap, [0.0])
            known |= {mover_path(mover.name): pose for mover, pose in zip(scene.movers, poses, strict=True)}
        for path, pose in known.items():
            self.stream.columns(path, [0], [0.0], _transforms(pose))

    def add(self, row: Row) -> bool:
        """Take in a step; whether its batch was written, which depends on steps and simulated time alone."""
        self._batch.append(row)
        self._waiting_since = min(self._waiting_since, time.monotonic())
        count, span = len(self._batch), row.time + row.duration - self._batch[0].time
        long_enough = count >= BATCH_LEAST and span >= BATCH_TIME - 1e-9
        if count < BATCH_STEPS and not long_enough and row.outcome is None:
            return False
        self._write()
        return True

    def secure(self) -> bool:
        """Write the steps ahead that have waited too long, lest a crash lose them; whether there were any."""
        if time.monotonic() - self._waiting_since < WAIT:
            return False
        rows = self._batch[self._secured :]
        self._columns("/timing/plan", rows, columns(rows))
        self._secured, self._waiting_since = len(self._batch), inf
        return True

    def end(self) -> None:
        """Write what is left."""
        if self._batch:
            self._write()

    def _write(self) -> None:
        rows, self._batch = self._batch, []
        self._secured, self._waiting_since = 0, inf
        self._columns("/steps", rows, columns(rows))
        self._poses(rows)
        if self._mocap is not None:
            self._movers(self._mocap, rows)
        self._plots.draw(rows)
        self._columns("/timing/plan", rows, rr.Scalars.columns(scalars=[1e3 * r.plan_seconds for r in rows]))
        for row in rows:
            if row.news is not None:
                for line in wrap(row.news, LINE):
                    self.stream.log("/log", row.step, row.time, rr.TextLog(line, level="INFO"))
            if row.plan is not None:
                self._pictures.draw(row.plan, row.step, row.time)

    def _poses(self, rows: Sequence[Row]) -> None:
        """Log robot, control, eye and driven path."""
        states = np.array([r.state for r in rows])
        controls = [(r.state, u) for r in rows for u in (r.control, *([] if r.truth is None else [r.truth.control]))]
        vectors = np.array([self._ahead(x, u) for x, u in controls])
        arrows = rr.Arrows3D.columns(vectors=vectors).partition([len(vectors) // len(rows)] * len(rows))
        self._columns("/world/robot", rows, [*_transforms(self._robot.at(states)), *arrows])
        seen = self._eye.poses(states[:, :2], np.array([r.duration for r in rows]))
        self._columns(FOLLOWING, rows, _transforms(np.column_stack(seen)))
        pieces = [lift(np.vstack([r.state[:2], r.states[:, :2]]), 0.06) for r in rows]
        self._columns("/world/path", rows, rr.LineStrips3D.columns(strips=pieces))
        if self._pictures.in_time is not None:
            self._pictures.in_time.follow(rows)
        last = rows[-1]
        if last.outcome is not None and len(last.states):
            pose = _transforms(self._robot.at(last.states[-1:]))
            self.stream.columns("/world/robot", [last.step + 1], [last.time + last.duration], pose)

    def _movers(self, mocap: Mocap, rows: Sequence[Row]) -> None:
        last = rows[-1]
        ends = [(last.step + 1, last.time + last.duration)] if last.outcome is not None else []
        steps, times = zip(*((r.step, r.time) for r in rows), *ends, strict=True)
        scene = self._subject.space.scene
        for j, (mover, poses) in enumerate(zip(scene.movers, self._mover_poses(mocap, times), strict=True)):
            new = np.any(poses != self._shown[j], axis=0)
            if new.any():
                turned = {"quaternion": poses[:, 3:]} if new[3:].any() else {}  # else the last one holds
                self._shown[j] = poses[-1]
                moved = rr.Transform3D.columns(translation=poses[:, :3], **turned)
                self.stream.columns(mover_path(mover.name), steps, times, moved)

    def _mover_poses(self, mocap: Mocap, times: Sequence[float]) -> Array:
        """Return poses (movers, k, 7) at times (k,) [s]; quaternions have w last, which MuJoCo writes first."""
        places, turns = mocap.poses(np.array(times))
        return np.concatenate([places, np.roll(turns, -1, axis=2)], axis=2).transpose(1, 0, 2)

    def _ahead(self, x: Array, u: Array) -> Array:
        """Predict without noise where the control takes the robot in a short while, in the robot's frame, (3,)."""
        dynamics, start, still = self._dynamics, x, np.zeros(self._dynamics.m)
        for _ in range(5):
            x = dynamics.step(x, u, still, AHEAD / 5)
        dx, dy = x[:2] - start[:2]
        heading = float(start[dynamics.angles[0]]) if dynamics.angles else 0.0
        c, s = np.cos(heading), np.sin(heading)
        return np.array([c * dx + s * dy, c * dy - s * dx, 0.0])

    def _columns(self, path: str, rows: Sequence[Row], columns: Iterable[Any]) -> None:
        self.stream.columns(path, [r.step for r in rows], [r.time for r in rows], columns)


def _transforms(poses: Array) -> Any:
    """Poses (k, 7) of places [m] and quaternions, w last, as columns."""
    return rr.Transform3D.columns(translation=poses[:, :3], quaternion=poses[:, 3:])
