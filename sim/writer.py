"""What a recording holds of a drive: numbers at every step, pictures of the plan now and then."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
import rerun as rr
from rerun._baseclasses import ComponentColumn

from pirrht.controller import Plan
from pirrht.path_integral import OTHER
from pirrht.scene import Array
from sim import drawing
from sim.colors import DEAD_COLOR, ClassColors, fade
from sim.drawing import at_most, lift, packed
from sim.episode import Frame
from sim.stage import FLOOR, Subject, properties, stage

BATCH_STEPS = 20  # rows per chunk: a chunk costs 1.7 kB whatever it holds
BATCH_LEAST, BATCH_TIME = 8, 0.2  # fewer will do once they span so much simulated time [s]
PATH_POINTS = 3600  # points of samples per picture, 12 bytes each
REFERENCE_POINTS = 64
AHEAD = 0.5  # the arrow reaches where the control would take the robot in this time [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Row:
    """One control step of a recording."""

    frame: Frame
    plan: Plan | None  # where a picture is due
    news: str | None

    @classmethod
    def of(cls, frame: Frame, drawn: bool, news: str | None) -> Row:
        """The row of a frame; what only pictures need is let go where none is due."""
        return cls(frame=frame, plan=frame.plan if drawn else None, news=news)


class Writer:
    """Writes one recording stream; runs on one thread."""

    def __init__(self, stream: rr.RecordingStream, subject: Subject) -> None:
        self._stream, self._subject = stream, subject
        self._colors = ClassColors()
        self._fans: set[str] = set()
        self._favourite: str | None = None
        self._batch: list[Row] = []

    def begin(self) -> None:
        """Everything that stays as it is."""
        subject = self._subject
        stage(subject, self._static)
        self._stream.send_recording_name(str(subject.settings.get("name", subject.space.scene.name)))
        self._stream.send_property("run", rr.AnyValues(**properties(subject.settings)))

    def add(self, row: Row) -> None:
        """Take in a step; it is written with its batch, whose bounds depend on simulated time alone."""
        self._batch.append(row)
        first, last = self._batch[0].frame, row.frame
        count, span = len(self._batch), last.end_time - first.time
        if (
            count >= BATCH_STEPS
            or (count >= BATCH_LEAST and span >= BATCH_TIME - 1e-9)
            or last.outcome is not None
        ):
            self.flush()

    def flush(self) -> None:
        """Write the batch."""
        rows, self._batch = self._batch, []
        if not rows:
            return
        frames = [row.frame for row in rows]
        self._name_classes(frames)
        self._numbers(frames)
        self._robot(frames)
        self._why(frames)
        self._columns(
            "/timing/plan", frames, rr.Scalars.columns(scalars=[1e3 * f.plan_seconds for f in frames])
        )
        for row in rows:
            if row.news is not None:
                self._at(row.frame.step, row.frame.time)
                self._stream.log("/log", rr.TextLog(row.news, level="INFO"))
            if row.plan is not None:
                self._at(row.frame.step, row.frame.time)
                self._picture(row.plan)
        self._stream.flush()

    def end(self) -> None:
        """Write what is left and close the stream."""
        self.flush()
        self._stream.disconnect()

    def _name_classes(self, frames: Sequence[Frame]) -> None:
        new = False
        for frame in frames:
            new |= self._colors.meet(frame.plan.ids)
        if not new and self._fans:
            return
        names = [*self._colors.names, OTHER]
        colors = [self._colors[name] for name in names]
        titles = [f"class {name}" for name in names[:-1]] + [OTHER]
        for path in ("/why/weight", "/why/ess"):
            self._static(path, rr.SeriesLines(names=titles, colors=colors, widths=[2.5] * len(names)))

    def _numbers(self, frames: Sequence[Frame]) -> None:
        columns = []
        for name, values in (
            ("state", [f.plan.state for f in frames]),
            ("control", [f.plan.control for f in frames]),
            ("noise", [f.advance.noise.sum(axis=0) for f in frames]),
            ("cost", [f.cost for f in frames]),
            ("length", [f.length for f in frames]),
            ("clearance", [f.clearance for f in frames]),
        ):
            flat = np.array(values, dtype=float).reshape(len(frames), -1)
            columns += list(
                rr.AnyValues.columns(**{name: flat.ravel()}).partition([flat.shape[1]] * len(frames))
            )
        self._columns("/steps", frames, columns)

    def _robot(self, frames: Sequence[Frame]) -> None:
        states = np.array([f.plan.state for f in frames])
        heading = states[:, 2] if states.shape[1] > 2 else np.zeros(len(states))
        turned = np.zeros((len(states), 4))
        turned[:, 2], turned[:, 3] = np.sin(0.5 * heading), np.cos(0.5 * heading)
        arrows = np.array([self._ahead(f.plan, angle) for f, angle in zip(frames, heading, strict=True)])
        self._columns(
            "/world/robot",
            frames,
            [
                *rr.Transform3D.columns(translation=_spatial(states), quaternion=turned),
                *rr.Arrows3D.columns(vectors=arrows),
            ],
        )
        pieces = [lift(np.vstack([f.plan.state[:2], f.advance.states[:, :2]]), 0.06) for f in frames]
        self._columns("/world/path", frames, rr.LineStrips3D.columns(strips=pieces))
        if frames[-1].outcome is not None:
            self._at(frames[-1].step + 1, frames[-1].end_time)
            self._stream.log(
                "/world/robot", rr.Transform3D.from_fields(translation=_spatial(frames[-1].state[None])[0])
            )

    def _ahead(self, plan: Plan, heading: float) -> Array:
        """Where the control would take the robot in a short while, in the robot's frame, (3,)."""
        dynamics = self._subject.path_integral.problem.dynamics
        x, still = plan.state, np.zeros(dynamics.m)
        for _ in range(5):
            x = dynamics.step(x, plan.control, still, AHEAD / 5)
        dx, dy = x[:2] - plan.state[:2]
        c, s = np.cos(heading), np.sin(heading)
        return np.array([c * dx + s * dy, c * dy - s * dx, 0.0])

    def _why(self, frames: Sequence[Frame]) -> None:
        names = [*self._colors.names, OTHER]
        estimates = [f.plan.estimate for f in frames]
        weights = [[e.class_weights.get(n, 0.0) if e else np.nan for n in names] for e in estimates]
        sizes = [[e.class_ess.get(n, 0.0) if e else np.nan for n in names] for e in estimates]
        value = [e.value if e else np.nan for e in estimates]
        for path, table in (("/why/weight", weights), ("/why/ess", sizes)):
            flat = list(chain.from_iterable(table))
            self._columns(
                path, frames, rr.Scalars.columns(scalars=flat).partition([len(names)] * len(frames))
            )
        self._columns("/why/value", frames, rr.Scalars.columns(scalars=value))
        for frame in frames:
            self._mark_switch(frame)

    def _mark_switch(self, frame: Frame) -> None:
        if frame.plan.fallback is not None:
            return
        if self._favourite is not None and frame.plan.favourite != self._favourite:
            self._at(frame.step, frame.time)
            self._stream.log("/why/weight/switch", rr.Scalars(1.03))
        self._favourite = frame.plan.favourite

    def _picture(self, plan: Plan) -> None:
        self._references(plan)
        log = self._stream.log
        log("/world/tape", rr.LineStrips3D(self._tape(plan)[None]))
        found: dict[str, drawing.Fan] = {}
        if plan.estimate is not None and self._subject.samples != "none":
            homology = self._subject.space.homology
            found = drawing.fans(
                self._subject.path_integral,
                plan.estimate,
                {homology.key(r.winding): name for r, name in zip(plan.references, plan.ids, strict=True)},
                points=PATH_POINTS,
                everything=self._subject.samples == "all",
            )
        for name in sorted(self._fans - found.keys()):
            log(_fan_path(name), rr.LineStrips3D(np.zeros((0, 2, 3), np.float32)))
        for name, fan in found.items():
            dead = name == drawing.DEAD
            color = DEAD_COLOR if dead else self._colors[name]
            opacity = np.full(len(fan.strips), 0.45) if dead else 0.25 + 0.75 * fan.opacity
            log(
                _fan_path(name),
                rr.LineStrips3D(fan.strips, colors=packed(fade(color, FLOOR, opacity)), radii=0.006),
            )
        self._fans = set(found)

    def _references(self, plan: Plan) -> None:
        weights = plan.estimate.class_weights if plan.estimate else {}
        share = np.array([weights.get(name, 0.0) for name in plan.ids])
        look = {
            "colors": packed([self._colors[name] for name in plan.ids]),
            "radii": (0.014 + 0.02 * np.sqrt(share)).astype(np.float32),
            "labels": [f"{name}  {100 * w:.0f} %" for name, w in zip(plan.ids, share, strict=True)],
            "show_labels": True,
        }
        flat = [lift(at_most(r.trajectory.points, REFERENCE_POINTS), 0.05) for r in plan.references]
        self._stream.log("/world/references", rr.LineStrips3D(flat, **look))
        for obstacle, path, _ in self._subject.lifted:
            homology, turn = self._subject.space.homology, self._subject.turn
            lines = [
                drawing.lifted_reference(homology, r, obstacle, REFERENCE_POINTS) for r in plan.references
            ]
            raised = [lift(line, line[:, 2] * turn) for line in lines]
            self._stream.log(
                f"{path}/references", rr.LineStrips3D(raised, **{**look, "radii": [0.03] * len(raised)})
            )

    def _tape(self, plan: Plan) -> drawing.Floats:
        """The path the tape alone would take, as far as a tenth of the weight is still under way."""
        problem = self._subject.path_integral.problem
        x, still, path = plan.state, np.zeros(problem.dynamics.m), [plan.state[:2]]
        alive = plan.estimate.alive if plan.estimate else np.ones(len(plan.tape))
        for u, dt, share in zip(plan.tape, np.diff(plan.times), alive, strict=True):
            if share < 0.1 or problem.scene.goal.contains(x[:2]):
                break
            x = problem.dynamics.step(x, u, still, dt)
            path.append(x[:2])
        return lift(at_most(np.array(path), REFERENCE_POINTS), 0.07)

    def _static(self, path: str, archetype: rr.AsComponents) -> None:
        self._stream.log(path, archetype, static=True)

    def _at(self, step: int, time: float) -> None:
        self._stream.set_time("step", sequence=step)
        self._stream.set_time("sim_time", duration=time)

    def _columns(self, path: str, frames: Sequence[Frame], columns: Iterable[ComponentColumn]) -> None:
        index = [
            rr.TimeColumn("step", sequence=[f.step for f in frames]),
            rr.TimeColumn("sim_time", duration=[f.time for f in frames]),
        ]
        self._stream.send_columns(path, indexes=index, columns=columns)


def _spatial(states: Array) -> Array:
    return np.column_stack([states[:, :2], np.zeros(len(states))])


def _fan_path(name: str) -> str:
    return str(rr.new_entity_path(["world", "samples", name]))
