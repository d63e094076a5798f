"""Plants: a robot that is driven for one control period at a time, in MuJoCo or by its stochastic equation alone.

Noise enters with the control. Every physics step of length h draws one increment dw ~ N(0, h I), whatever the method
and the noise level, and commands `ctrl = M @ twist(x, f_c + G u + B dw/h)`, or where noise enters through the inputs
`ctrl = M @ twist(x, u + s dw/h)`. With deadbeat servos a step of MuJoCo is then the Euler-Maruyama step of the
equation, and the displacement has covariance B B' t. Motors take accelerations instead: the velocity's step is then
that of the equation, and the position moves on with the velocity of the step's end (semi-implicit Euler) where the
equation alone takes that of its start. Rotors are commanded the control alone, and noise is a force. They, and wheels
with slow servos, follow the equation up to their lag (models/robots/drone.xml, diffdrive.xml).
A step may be longer than a wall is thick, or than an obstacle that moves: what is between two steps counts as well as
their ends. Clearance is that of the robot itself, without the margin of plans: of the ball that holds it.
Moving obstacles are where their motions say at the end of each step, by the plant's own clock.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil, dist, inf, sqrt

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.collision import Collision, touches
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.scene import ROUNDING, Scene, Workspace
from pirrht.moving.collision import MovingObstacles
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.traits import Traits
from sim.mjcf import Loaded
from sim.mjcf.footprint import collision_of
from sim.mjcf.obstacles import Mocap
from sim.mjcf.robot import check_motion
from sim.sensing.senses import Senses
from sim.states import StateAdapter, adapter_of
from sim.systems import named

BALLS = ("robot/footprint", "robot/inner footprint")  # geoms, one of which collides where the robot is a ball
APART = 0.25  # of its radius: poses within a step at which another robot is examined
MOST_POSES = 10_000  # of these in a step

Control = Callable[[Array, float], Array]  # state (n,), time since the start of the period [s] -> control (m,)
Clearance = Callable[[Array], Array]  # centres (k, 2) -> the robot's free distance (k,) [m], 0 or less in a collision


class ClearanceChecker:
    """Clearance of the robot itself among static and moving obstacles; that of static ones may be known already.

    Clearance is 1-Lipschitz: around a place that has some there is a disc that is free. FCL is queried only where the
    last disc does not bound it well enough. A robot with corners is examined where the disc around it is not free.
    """

    def __init__(self, scene: Scene, states: StateAdapter, clearance: Clearance | None = None) -> None:
        self._position = states.position
        static = Workspace(scene.lower, scene.upper, scene.obstacles)
        body = scene.body
        around = body if body.is_disc else Footprint.disc(body.reach, height=body.height)
        self._clearance = clearance or Collision(static, around).clearance
        self._crowd = MovingObstacles(scene.movers, body) if scene.movers else None
        self._states, self._reach = states, 0.0 if body.is_disc else body.reach
        self._exact = None if body.is_disc else collision_of(static, body).clearance
        self._disc: tuple[float, list[float] | None] = -inf, None  # the last static clearance [m], and where

    def least(self, states: Array, times: Array) -> float:
        """Return the least clearance at states (k, n) and times (k,) [s], the last ones next to the robot now [m].

        It is 0 in a collision.
        """
        places = states[:, self._position]
        static = self._clearance(places)
        self._disc = float(static[-1]), places[-1].tolist()
        free = float(static.min() if self._exact is None else self._exact(self._states.poses(states)).min())
        if self._crowd is not None:
            for pose, now in zip(self._poses(states), times, strict=True):
                if self._crowd.surely(pose, now) < free:
                    free = min(free, self._crowd.clearance(pose, now))
        return max(0.0, free)

    def _poses(self, states: Array) -> Array:
        """Return positions of a disc (..., d), or poses of a robot with corners (..., 3), of states (..., n)."""
        return states[..., self._position] if self._exact is None else self._states.poses(states)

    def blocked(self, before: Array, x: Array, begin: float = 0.0, now: float = 0.0) -> bool:
        """Check for anything between two states 2 x (n,), a free one at `begin` and the next one `now` [s]."""
        start = before[self._position]
        end = x[self._position]
        there = end.tolist()
        length = dist(start.tolist(), there)

        def clear(s: float) -> float:
            return self._static((start + s * (end - start)).tolist()) + ROUNDING

        if (
            not self._static(there, length) > length
            and touches(clear, lambda a, b: (b - a) * length, undecided=False)
            and (self._exact is None or self._touching(before, x))
        ):
            return True
        return self._crowd is not None and self._crowd.meets(self._poses(before), begin, self._poses(x), now)

    def _touching(self, before: Array, x: Array) -> bool:
        """Check for anything between two states that touches a robot with corners."""
        assert self._exact is not None
        exact, begin, end = self._exact, self._states.poses(before), self._states.poses(x)
        moved = dist(before[self._position], x[self._position]) + self.turning(before, x)

        def clear(s: float) -> float:
            return float(exact((begin + s * (end - begin))[None])[0])  # never less than 0

        return touches(clear, lambda a, b: (b - a) * moved, undecided=False)

    def turning(self, before: Array, x: Array) -> float:
        """Bound how far corners go by turning from one state to the next [m]; a disc has none."""
        return self._reach * float(abs(self._states.poses(x) - self._states.poses(before))[2]) if self._reach else 0.0

    def travel(self, before: Array, x: Array, begin: float, now: float) -> float:
        """Bound how far a robot goes from one state to the next and an obstacle meanwhile, together [m]."""
        moved = 0.0 if self._crowd is None else self._crowd.travel(begin, now)
        return dist(x[self._position], before[self._position]) + self.turning(before, x) + moved

    def _static(self, place: list[float], enough: float = inf) -> float:
        free, known = self._disc
        free = -inf if known is None else free - dist(place, known)
        if free < enough:
            free = float(self._clearance(np.array([place]))[0])
            self._disc = free, place
        return free


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Advance:
    """Result of one control period: k physics steps, fewer than a period holds if the run ended.

    Step i goes from the state before it under `controls[i]` and `noise[i]` to `states[i]`.
    """

    outcome: Outcome | None  # GOAL or COLLISION; None while the run goes on
    time: float  # until the exit or the end of the period [s]
    cost: float  # integral of q + u'Ru/2
    length: float  # of the path [m]
    clearance: float  # the least around the robot after any step [m]; 0 after a collision
    states: Array  # (k, n) after each step
    attitudes: Array  # (k, 4) quaternions, w first, of a robot that flies; else (k, 0)
    controls: Array  # (k, m)
    noise: Array  # (k, m) Brownian increments [sqrt(s)]
    off: tuple[Array, ...] = ()  # (n,) how far from the equation it ends; of wheels or rotors, which follow it about

    def __repr__(self) -> str:
        end = "" if self.outcome is None else f", {self.outcome.name.lower()}"
        return f"Advance({len(self.states)} steps in {self.time:.4g} s, cost {self.cost:.4g}{end})"


class Plant:
    """A robot by its stochastic equation alone, which is driven on in physics steps, judged and paid for.

    The control period [s] is a whole number of physics steps [s]; the clearance around the robot is that of static
    obstacles, if known.
    """

    def __init__(
        self, problem: Problem, clearance: Clearance | None = None, *, period: float, physics_step: float = 0.002
    ) -> None:  # fmt: skip
        count = round(period / physics_step) if np.isfinite(period) and physics_step > 0 else 0
        if count < 1 or abs(period - count * physics_step) > 1e-6 * physics_step:
            whole = f"a whole multiple of the physics step {physics_step:g} s"
            raise OptionError(f"the period {period:g} s must be {whole}")
        self.period, self.physics_step, self._count = period, physics_step, count
        self._begun, self._steps = 0.0, 0  # time of the last reset [s], and steps since; one that is made counts
        self.enter(problem, clearance)
        self.reset(problem.dynamics.state_of(problem.scene.start))

    attitude = np.empty(0)  # quaternion (4,) of a robot that flies

    def enter(self, problem: Problem, clearance: Clearance | None = None) -> None:
        """Continue in this problem, of the same robot: among its obstacles, to its goal, under its noise."""
        self._problem, self._states = problem, adapter_of(problem.dynamics.states)
        self._checker = ClearanceChecker(problem.scene, self._states, clearance)

    @property
    def state(self) -> Array:
        """State (n,), its headings unwrapped."""
        return self._state.copy()

    @property
    def time(self) -> float:
        """Time of the run, also while a control is queried: moving obstacles go by it [s]."""
        return self._begun + self._steps * self.physics_step

    def reset(self, state: Array, time: float = 0.0) -> None:
        """Start from the first n entries of `state`, at a time [s] of the run; OptionError if that is none."""
        if not 0.0 <= time < inf:
            raise OptionError(f"the time is {time!r}; a run's clock begins at 0, or at a later number of seconds")
        self._begun, self._steps = time, 0
        self._state = np.array(state, dtype=float)[: self._problem.dynamics.n]

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period, or to the goal or a collision if that comes first.

        The control is queried at every physics step; `rng` gives the period's increments, in the order of the steps.
        """
        h = self.physics_step
        problem = self._problem
        checker = self._checker
        x = self.state
        scene = self._problem.scene

        position = self._states.position
        lower = scene.lower.tolist()
        upper = scene.upper.tolist()
        goal = scene.goal.center.tolist()

        place = x[position].tolist()
        noise = sqrt(h) * rng.standard_normal((self._count, problem.dynamics.m))
        controls = np.empty_like(noise)
        states = np.empty((self._count, len(x)))
        attitudes = np.empty((self._count, len(self.attitude)))

        outcome = None
        cost = 0.0
        length = 0.0
        k = 0

        times = self._begun + h * np.arange(self._steps + 1.0, self._steps + 1.0 + self._count)
        while k < self._count and outcome is None:
            u = controls[k]
            u[:] = control_at(x, k * h)
            cost += (problem.rate(x) + 0.5 * float(u.dot(problem.control_cost(x)).dot(u))) * h
            before = x
            last = place
            self._steps += 1
            x = self._state = states[k] = self._move(x, u, noise[k], h)
            attitudes[k] = self.attitude
            place = x[position].tolist()
            length += dist(place, last)
            if not _within(lower, place, upper) or self._touching(before, x):
                outcome = Outcome.COLLISION
            elif dist(place, goal) <= scene.goal.radius:
                outcome = Outcome.GOAL
            k += 1
        if not np.isfinite(cost):
            raise OptionError(f"not finite: control {u.tolist()} or its cost at {before.tolist()}; fix them")
        return Advance(
            outcome=outcome, time=k * h, cost=cost, length=length, states=states[:k], controls=controls[:k],
            noise=noise[:k], attitudes=attitudes[:k],
            clearance=0.0 if outcome is Outcome.COLLISION else checker.least(states[:k], times[:k]),
        )  # fmt: skip

    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        return self._problem.dynamics.step(x, u, dw, step)

    def _touching(self, before: Array, x: Array) -> bool:
        return self._checker.blocked(before, x, self.time - self.physics_step, self.time)


def _within(lower: list[float], place: list[float], upper: list[float]) -> bool:
    """Return whether a position lies strictly inside a box."""
    return all(low < at < high for low, at, high in zip(lower, place, upper, strict=True))


class Executor(Plant):
    """The robot in MuJoCo, whose contacts are collisions; `data` is MuJoCo's state, for pictures."""

    def __init__(self, loaded: Loaded, problem: Problem, *, period: float, senses: Senses | None = None) -> None:
        model = self._model = loaded.model
        called, n, own = named(loaded.dynamics_name).called, problem.dynamics.n, type(problem.dynamics).__name__
        if n != len(loaded.states):
            states = f"{len(loaded.states)} states; {own} has {n}"
            raise OptionError(f'robot "{loaded.robot}" moves as {called} with {states}')
        if loaded.unfit:
            raise OptionError(f"{loaded.unfit}; or give --robot FILE.xml, or --plant sde, which drives no joints")
        check_motion(model, called, problem.dynamics, loaded.command)
        self.data = mujoco.MjData(model)
        self._joints = loaded.adapter.joints(model)
        self._command, self._obstacles = loaded.command, loaded.obstacle_geoms
        self._mocap = Mocap(model, loaded.scene.movers) if loaded.scene.movers else None
        balls = [model.geom(i) for i in range(model.ngeom) if model.geom(i).name in BALLS]
        self._ball = any(geom.contype[0] | geom.conaffinity[0] for geom in balls)
        self._between = None if self._ball else mujoco.MjData(model)
        self.senses = senses
        super().__init__(problem, period=period, physics_step=float(model.opt.timestep))

    def enter(self, problem: Problem, clearance: Clearance | None = None) -> None:
        """Continue in this problem, of the same robot; bodies in MuJoCo stay where they are."""
        super().enter(problem, clearance)
        d, step = problem.dynamics, self.physics_step
        self._rate: Callable[[Array, Array, Array], Array] = lambda x, u, dw: d.rate(x, u, dw, step)
        if Traits.of(problem).constant_gain:  # the same, with blocks looked up only once
            G, B = d.noise_form(np.zeros(d.n))
            B_per_step = B / step
            self._rate = lambda x, u, dw: d.idle(x) + G.dot(u) + B_per_step.dot(dw)

    def reset(self, state: Array, time: float = 0.0) -> None:
        """Start from the first n entries of `state` at a time [s]; wheels roll as they do without control."""
        super().reset(state, time)
        still = np.zeros(self._problem.dynamics.m)
        twist = self._made(self._state, still, still)
        mujoco.mj_resetDataKeyframe(self._model, self.data, 0)
        self._joints.place(self.data, self._state, twist, self._command.dot(twist))
        if self._mocap is not None:
            self._mocap.place(self.data, time)
        mujoco.mj_step1(self._model, self.data)
        if self._joints.fly is not None:
            self.attitude = self.data.qpos[3:7].copy()
        if self.senses is not None:
            self.senses.begin(self.data, self._states.poses(self._state), time)

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period, or to the goal or a collision; see `Plant.advance`."""
        x = self.state
        advance = super().advance(control_at, rng)
        if not self._joints.rolls:
            return advance
        for u, dw in zip(advance.controls, advance.noise, strict=True):
            x = self._problem.dynamics.step(x, u, dw, self.physics_step)
        return replace(advance, off=(advance.states[-1] - x,))

    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        """Make one step, cut after its position stage, so that the contacts are those of the new state."""
        fly = self._joints.fly
        made = self._made(x, u, dw)
        if fly is None:
            self.data.ctrl[:] = self._command.dot(made)
        else:
            fly(self.data, self._made(x, u, np.zeros(len(dw))), made)
        mujoco.mj_step2(self._model, self.data)
        if self._mocap is not None:
            self._mocap.place(self.data, self.time)
        mujoco.mj_step1(self._model, self.data)
        if fly is not None:
            self.attitude = self.data.qpos[3:7].copy()
        x = self._joints.read(self.data, x)
        if self.senses is not None:
            self.senses.sense(self.data, self._states.poses(x), self.time)
        return x

    def _made(self, x: Array, u: Array, dw: Array) -> Array:
        """Return the twist of the robot at x (n,) for a control (m,) and noise (m,) of a physics step."""
        return self._problem.dynamics.twist(x, self._rate(x, u, dw))

    def _touching(self, before: Array, x: Array) -> bool:
        if self._contacts(self.data):
            return True
        if not super()._touching(before, x):  # not even the ball that holds the robot
            return False
        return self._between is None or self._touching_between(before, x, self._between)

    def _contacts(self, data: mujoco.MjData) -> bool:
        """Check for contacts; nothing but the robot has joints, and without them bodies touch no others in MuJoCo."""
        contact = data.contact
        return bool(data.ncon > 0 and self._obstacles[contact.geom[contact.dist < -ROUNDING]].any())

    def _touching_between(self, before: Array, x: Array, data: mujoco.MjData) -> bool:
        """Check for contacts at poses within the last step, of a robot that is no ball."""
        h, begin = self.physics_step, self.time - self.physics_step
        apart = APART * self._problem.scene.body.radius
        poses = min(ceil(self._checker.travel(before, x, begin, self.time) / apart), MOST_POSES)
        mujoco.mj_copyData(data, self._model, self.data)
        for share in np.arange(1, poses) / poses:
            self._joints.place(data, before + share * (x - before), np.zeros(2), data.ctrl)
            if self._mocap is not None:
                self._mocap.place(data, begin + share * h)
            mujoco.mj_fwdPosition(self._model, data)
            if self._contacts(data):
                return True
        return False
