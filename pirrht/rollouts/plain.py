"""Backend in plain Python, path by path: the sampled equation as one reads it, slow, to judge other backends by.

It takes what every `Backend` is given, and asks space, moving obstacles and classes by the programs of their records.
Steps are those of the grid; among moving obstacles they end where a motion near a noisy position changes. They draw the
same random numbers as those of `Cpu`, which splits them near walls unless `Sampling.steps` is "uniform".

Examples:
    >>> from pirrht import *
    >>> room = {"lower": (0, 0), "upper": (4, 3), "start": (2.6, 1.5), "goal": (3.4, 1.5, 0.3)}
    >>> scene = Scene.from_boxes([], robot_radius=0.2, **room)
    >>> problem, space = Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=np.eye(2)), FreeSpace.of(scene)
    >>> tree = HomologyTree(space, StraightLine.of(problem), rng=np.random.default_rng(0))
    >>> few, rng = Sampling(samples=10), np.random.default_rng(1)
    >>> plan = Controller(problem, space, tree, few, backend=Plain(problem), rng=rng).plan(scene.start[:2])
    >>> plan.estimate.survivors
    10
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.space import COLLISION, GOAL, INSIDE
from pirrht.geometry.world import WALL, merging
from pirrht.jit.streams import antithetic, exposure, fill_normals, stream
from pirrht.problem import Problem
from pirrht.rollouts import tables as tubes
from pirrht.rollouts.cpu import kind_of
from pirrht.rollouts.first_exit import at_crossing, at_crossing_in_space, slope_for, turn_of
from pirrht.rollouts.step import SWAY, KernelSpec, gap_among, of_pose
from pirrht.rollouts.tables import FINER, LawRows, Origin, Paths, ProposalTables, Setup, empty_paths
from pirrht.rollouts.tuning import TUNING
from pirrht.systems.dynamics import Dynamics
from pirrht.topology.signature import NO_CLASSES

Pose = tuple[float, ...]


@dataclass(frozen=True)
class Plain:
    """Backend in plain Python: `Controller(problem, .., backend=Plain(problem))`."""

    problem: Problem

    def sample(self, setup: Setup, tables: ProposalTables, origin: Origin) -> Paths:
        """Simulate all S samples of the tables."""
        return self._simulated(setup, tables, origin, np.arange(int(tables.first[-1])))[0]

    def replay(
        self, setup: Setup, tables: ProposalTables, origin: Origin, number: IntArray
    ) -> tuple[Array, Array, IntArray]:
        """Return states (c, T+1, n), controls carried up to the exit (c, T, m) [control] and steps taken (c,)."""
        paths, states, applied = self._simulated(setup, tables, origin, number)
        return states, applied, paths.steps.astype(np.int64)

    def _simulated(
        self, setup: Setup, tables: ProposalTables, origin: Origin, number: IntArray
    ) -> tuple[Paths, Array, Array]:
        H, T, m = tables.control.shape
        programs = setup.world.static.kernels, setup.world.moving.kernels, tables.classes.kernels
        kind = kind_of(self.problem, *programs, fitted=math.isfinite(tables.least))
        laws = [LawRows.of(tables, g, kind.n, kind.modes) if tables.law_length[g] > 0 else None for g in range(H)]
        paths = empty_paths(len(number), H, m)
        states = np.zeros((len(number), T + 1, len(origin.x)))
        applied = np.zeros((len(number), T, m))
        for c, s in enumerate(number.tolist()):
            path = Path(self.problem.dynamics, kind, setup, tables, laws, origin, s)
            path.run(states[c], applied[c])
            for name in Paths._fields:
                getattr(paths, name)[c] = getattr(path, name)
        return paths, states, applied


class Path:
    """One path under way; its attributes end as a row of `Paths`."""

    def __init__(
        self, d: Dynamics, kind: KernelSpec, setup: Setup, tables: ProposalTables, laws: Sequence[Any],
        origin: Origin, sample: int,
    ) -> None:  # fmt: skip
        """Begin a sample's path at the origin."""
        self.d, self.kind, self.setup, self.tables, self.laws = d, kind, setup, tables, laws
        self.world, self.space, self.begun = setup.world, kind.space, origin.time
        self.moving: Any = kind.moving
        self.reads = list(kind.reads)
        self.whole = of_pose(len(self.reads))
        H, _, m = tables.control.shape
        self.h = int(np.searchsorted(tables.first, sample, side="right")) - 1
        first, self.sign = antithetic(sample, tables.first[self.h], tables.mirrored)
        self.random = stream(origin.seed, first)
        self.fresh = np.zeros(kind.abreast * (kind.modes + kind.modes % 2))
        self.x = origin.x.copy()
        self.a = np.zeros((H, kind.modes))
        self.row = [0] * H  # of a law, or cross-section of a tube
        self.push = np.zeros(m)
        self.pushes = kind.noisy_position and tables.wall_offset > 0.0
        self.owed = self.gap = self.last = 0.0
        self.near = np.empty((self.world.moving.J, WALL))
        self.watch = self.moving.watch(self.world.moving) if self.moving else None
        self.classes = kind.classes or NO_CLASSES
        self.moving_classes = self.classes if self.moving else NO_CLASSES
        self.sides = self.moving_classes.watch(tables.marks)
        self.key = int(self.moving_classes.begin(tables.marks, self.pose(self.x), self.sides))
        self.work = self.log_survival = self.exposure = self.span = 0.0
        self.log_ratio = np.zeros(H)
        self.now = np.zeros(m)
        self.outcome, self.steps = INSIDE, 0

    def pose(self, x: Array) -> Pose:
        """Return the pose of a state."""
        return tuple(x[self.reads].tolist())

    def run(self, states: Array, applied: Array) -> None:
        """Simulate it up to its exit or the last step; write states (T+1, n), and controls carried (T, m)."""
        states[0] = self.x
        for i, whole in enumerate(np.diff(self.tables.times)):
            done = 0.0
            while done < whole * (1.0 - 1e-12) and self.outcome == INSIDE:
                done += self.step(i, done, whole, applied[i])
            states[i + 1] = self.x
            self.steps = i + 1
            if i < self.tables.window:
                self.span += done
            if self.outcome != INSIDE:
                break
        self.now += self.span * self.start_control
        self.key = (self.key + 2**63) % 2**64 - 2**63  # as whole numbers of 64 bits wrap

    def step(self, i: int, done: float, whole: float, applied: Array) -> float:
        """Take a step at most to the end of step i of the grid; return the time until its end, or its exit [s]."""
        clock = self.begun + self.tables.times[i] + done
        self.observe(whole - done, clock)
        for g in range(len(self.a)):
            self.aim(g, i, done / whole)
        if self.owed > 0.0:
            self.now -= 0.5 * self.owed * self.inverse @ self.lead()
        self.draw(i)
        ahead, turn = self.move()
        here, there = self.pose(self.x), self.pose(self.moved)
        share = self.judge(here, there, ahead, turn, clock)
        self.key += self.classes.key(self.tables.classes, here, there)
        self.key += self.moving_classes.follow(
            self.tables.marks, i, (done + self.dt * share) / whole, there, self.sides
        )
        for g in range(len(self.a)):
            self.weigh(g)
        self.record(i, done, applied, whole)
        self.work += (
            (self.kind.q(self.x, self.d.parameters) if self.kind.varying_rate else self.setup.rate) * self.dt * share
        )
        self.x = self.moved
        return self.dt * share

    def observe(self, left: float, clock: float) -> None:
        """Evaluate the equation at the state, and choose the step; with wall drift B' grad log psi."""
        d = self.d
        here = self.pose(self.x)
        self.f = d.f(self.x)
        self.B = d.whole(d.B_c(self.x))
        self.gain = d.noise_gain(self.x)
        self.inverse = d.control_gain(self.x)
        self.dt = self.until = left
        self.shapes = self.kind.takes_law and not self.kind.gated
        if not self.kind.noisy_position:
            return
        spread = self.space.spread(self.world.static, self.covariance(left), False)
        count = 0
        if self.moving:
            within = max(3.0 * math.sqrt(spread), TUNING.push_cutoff * self.tables.wall_offset)
            count, until = self.moving.walls(self.world.moving, self.watch, here, clock, within, self.near)
            self.dt = self.until = min(left, max(until - clock, TUNING.least_change))
        self.expose(here, count)
        way = TUNING.entering * math.sqrt(2.0 * self.setup.least_rate * self.dt) + TUNING.deviations
        spread_out = math.sqrt(float(np.trace(self.of_place())) * self.dt)
        self.shapes &= self.to_goal > way * spread_out  # a step that may enter the goal draws passive noise
        c, n, e, m = self.space.walls(self.world.static, here)
        widest, back = np.float32(0.5 * math.sqrt(spread)), np.float32(self.tables.set_back)
        self.walls = max(c + back, widest), n, max(e + back, widest), m
        if count > 0:
            self.walls = merging(len(here))(self.walls, self.near, count, float(widest))
        if self.pushes:
            self.push = self.along_noise(slope_for(len(here))(self.walls, self.tables.wall_offset))

    def along_noise(self, slope: Any) -> Array:
        """Return B' s of a slope s of the pose."""
        return np.asarray(slope @ self.B[self.reads])

    def covariance(self, dt: float) -> tuple[float, ...]:
        """Return that of the noise of a pose over a time, the upper triangle by rows."""
        noise = self.B[self.reads]
        return tuple(one for i, row in enumerate((dt * noise @ noise.T).tolist()) for one in row[i:])

    def of_place(self) -> Array:
        """Return that of the noise of the position per second, (d, d)."""
        noise = self.B[list(self.kind.position)]
        return np.asarray(noise @ noise.T)

    def expose(self, here: Pose, count: int) -> None:
        """Add how fast the chance grows that the step which ends here comes close to a wall."""
        rates = self.covariance(1.0)
        gap, border, self.to_goal, *_ = distances = self.space.distances(self.world, here)
        if self.kind.along_line:
            gap = self.space.facing(self.world.static, here, distances, rates)
        most = self.space.spread(self.world.static, rates, self.kind.along_line)
        gap = max(min(gap, border, gap_among(self.near, count, self.whole(rates), most, self.kind.along_line)), 0.0)
        if self.last > 0.0:
            self.exposure += exposure(*map(np.float32, (self.gap, gap, math.sqrt(most), self.last)))
        self.gap, self.last = gap, self.dt

    def aim(self, g: int, i: int, share: float) -> None:
        """Set a_g: of a tube, a grid, a law or a control sequence, with wall drift unless tube or law has it."""
        kind = self.kind
        climbs = kind.traits.isotropic_point and self.tables.ways.count[g] > 0
        in_space = len(kind.position) == 3
        led = kind.takes_law and self.tables.law_length[g] > 0
        if climbs:
            self.a[g] = self.along_grid(g) if in_space else self.along_tube(g)
        else:
            self.a[g] = self.along_law(g, i, share) if led else 0.0
        if i < self.tables.active[g]:
            self.a[g, : kind.m] += self.gain @ self.tables.control[g, i]
        if self.pushes and (in_space or not climbs) and (kind.gated or not led):
            self.a[g, : kind.m] += self.push

    def along_tube(self, g: int) -> Array:
        """Return B' grad log psi of the class of a tube."""
        out = np.empty(tubes.NUMBERS, np.float32)
        x, y = self.x[self.reads].astype(np.float32)
        at = tubes.tube_of(self.tables.ways, g), self.row[g], np.float32(self.tables.ways.decay), self.world.goal
        self.row[g] = tubes.tube_at(*at, x, y, out, 0, 1)
        c, n, e, m = self.walls
        return self.along_noise(tubes.slope_of(out, 0, 1, (c, *n, e, *m)))

    def along_grid(self, g: int) -> Array:
        """Return B' grad log psi of the class of a grid in space, without wall drift."""
        place = self.x[self.reads].tolist()
        return self.along_noise(np.array(tubes.grid_slope(tubes.tube_of(self.tables.ways, g), *place)))

    def along_law(self, g: int, i: int, share: float) -> Array:
        """Return a + K (x - x_ref) of a law's row: of the one due among moving obstacles, else of the nearest."""
        law, led, s = self.laws[g], int(self.tables.law_length[g]), self.row[g]
        away = self.d.difference(self.x, law.state)
        if self.moving:
            s = min(i * FINER + int(FINER * share + 0.5), len(away) - 1)
        elif s < led:
            far = (law.metric * away**2).sum(axis=1)[: led + 1]
            s = min(s + FINER, len(far) - 1) if i > 0 else s
            for onward in (1, -1):
                while 0 <= s + onward < len(far) and far[s + onward] < far[s]:
                    s += onward
        self.row[g] = s
        if s < led:
            return np.asarray(np.clip(law.mean[s] + away[s] @ law.gains[s], -law.steepest[s], law.steepest[s]))
        home, goal = np.zeros(self.kind.modes), (self.world.goal, self.world.radius)
        self.kind.homing(
            self.x, self.d.parameters, self.d.B_c(self.x), *goal, self.setup.least_rate, home[: self.kind.m]
        )
        return home

    def shaped(self, g: int) -> bool:
        """Tell whether the noise of a step around g has the covariance of a law."""
        return self.shapes and self.row[g] < self.tables.law_length[g]

    def draw(self, i: int) -> None:
        """Draw a dt + dw of all modes around the reference that is followed; the first m are y."""
        at = i % self.kind.abreast
        if at == 0:
            self.random = fill_normals(np.uint64(self.random), len(self.fresh) // 2, self.fresh)
        noise = self.fresh[at * (self.kind.modes + self.kind.modes % 2) :][: self.kind.modes]
        if self.shaped(self.h):
            noise = noise @ self.laws[self.h].deviation[self.row[self.h]]
        self.drawn = self.a[self.h] * self.dt + self.sign * math.sqrt(self.dt) * noise
        self.y = self.drawn[: self.kind.m]

    def move(self) -> tuple[float, float]:
        """Set where the step leads; return the share of it before the goal, if that is ahead, and its turn [rad].

        What enters the goal straight ahead arrives before its noise matters, and draws none.
        """
        x, f, dt = self.x, self.f, self.dt
        swept = self.setup.bridge and not self.kind.noisy_position
        if swept:
            exit, share, _ = self.space.sweep(self.world, self.pose(x), self.pose(x + f * dt), 0.0, 0.0)
            if exit == GOAL:
                self.outcome, self.moved = GOAL, x + f * dt
                self.y[:] = 0.0
                return share, 0.0
            f = self.drift_half_way()
        if self.kind.stratonovich:
            middle = x + 0.5 * (f * dt + self.B @ self.y)
            self.B = self.d.whole(self.d.B_c(middle))
            f = f if swept else self.d.f(middle)
        self.moved = x + f * dt + self.B @ self.y
        place = list(self.kind.position)
        if not self.kind.curved_step or len(place) == 3:
            return 1.0, 0.0
        return 1.0, turn_of(self.f[place], self.d.f(self.moved)[place], (self.moved - x)[place], dt)

    def drift_half_way(self) -> Array:
        """Return the drift at the middle of the step's noise, or its mean over the step by two points."""
        middle = self.x + 0.5 * self.B @ self.y
        if not self.kind.curved_step:
            return self.d.f(middle)
        mean = middle - SWAY * self.B @ self.drawn[self.kind.m :]
        spread = self.B @ np.copysign(SWAY * np.sqrt(self.y**2 + self.dt), self.y)
        return np.asarray(0.5 * (self.d.f(mean - spread) + self.d.f(mean + spread)))

    def judge(self, here: Pose, there: Pose, share: float, turn: float, clock: float) -> float:
        """Set the outcome of the step, and return its share until then."""
        moving = self.moving
        if not self.setup.bridge:
            inside = not moving or moving.clearance(self.world.moving, there, clock + self.dt) > 0.0
            self.outcome = self.space.end(self.world, there) if inside else COLLISION
            return 1.0
        if self.kind.noisy_position:
            wall, share = False, self.on_bridge(here, there, self.kind.along_line)
            if moving:
                wall, share = self.on_bridge_among((here, there), share, clock, self.kind.along_line)
            if self.outcome != INSIDE:
                self.end(here, share, wall)
            return share
        if self.outcome == INSIDE:
            self.outcome, share, _ = self.space.sweep(self.world, here, there, turn, 0.0)
        step = here, there, turn
        hit = moving.sweep(self.world.moving, self.watch, step, clock, self.dt, share) if moving else math.inf
        if hit <= share:
            self.outcome, share = COLLISION, hit
        if self.space.turns and self.outcome == INSIDE:  # noise turns the footprint on its way
            share = self.on_bridge(here, there, False)
            if moving and self.outcome == INSIDE:
                moving.begin(self.watch)
                _, share = self.on_bridge_among((here, there), share, clock, False)
        return float(share)

    def on_bridge(self, here: Pose, there: Pose, line: bool) -> float:
        """Judge the Brownian bridge between the ends of the step among what is static."""
        distances = self.space.distances
        ends = here, there, distances(self.world, here), distances(self.world, there), self.covariance(self.dt)
        self.random, self.outcome, share, missed = self.space.bridge(
            self.world, *ends, self.tables.weighed, np.uint64(self.random), line
        )
        self.log_survival += missed
        return float(share)

    def on_bridge_among(
        self, way: tuple[Pose, Pose], share: float, clock: float, line: bool
    ) -> tuple[bool, float]:  # fmt: skip
        """Judge it among moving obstacles too; return whether one of these is met, and the share."""
        cov = self.covariance(self.dt)
        rule = (self.space.spread(self.world.static, cov, line), self.tables.weighed)
        step = way, clock, self.dt, self.whole(cov), rule, np.uint64(self.random)
        self.random, hit, missed = self.moving.bridge(self.world.moving, self.watch, *step, self.near)
        if hit <= 1.0 and (self.outcome == INSIDE or hit < share):
            self.outcome = COLLISION
            return True, float(hit)
        self.log_survival += share * missed if self.outcome != COLLISION else 0.0
        return False, share

    def end(self, here: Pose, share: float, wall: bool) -> None:
        """End a step at its crossing, where noise is the displacement: what is beyond has no likelihood ratio.

        That is of points, and of noise along a line that meets the goal's rim; `wall`: row 0 of moving ones is met.
        """
        cov = self.of_place()
        variance = float(cov[0, 0])
        drift = self.f * self.dt
        if self.kind.traits.point and np.array_equal(cov, variance * np.eye(len(cov))):
            met = self.space.exit(self.world, here, self.outcome)
            if wall:
                n, v = (self.near[0, k : k + len(cov)] for k in (1, 4))
                met = (max(self.near[0, 0], 0.0) - share * self.dt * float((v - self.f) @ n), *(-n).tolist())
            radius = self.world.radius if self.outcome == GOAL else 0.0
            beyond = tuple((self.moved - self.x - drift).tolist())
            crossing = at_crossing if len(beyond) == 2 else at_crossing_in_space
            _, *noise = crossing(met, radius, beyond, share, math.sqrt(variance * self.dt), np.uint64(self.random))
            self.y = self.B.T @ noise / variance
        else:
            direction, to_rim, alone = self.space.rim(self.world, here, self.covariance(self.dt))
            if not (self.kind.along_line and self.outcome == GOAL and alone):
                return
            along = direction @ self.B[list(self.kind.position)]
            between = np.empty(len(self.y) + 1)
            fill_normals(np.uint64(self.random), len(between) // 2, between)
            self.y = share * self.y + math.sqrt(share * (1.0 - share) * self.dt) * between[: len(self.y)]
            self.y += along / np.trace(cov) * (to_rim - along @ self.y)
        self.until = share * self.dt
        self.moved = self.x + share * drift + self.B @ self.y

    def weigh(self, g: int) -> None:
        """Add log dQ_g/dP of the step; none if nothing is drawn."""
        a = self.a[g]
        if self.shaped(g) and self.y.any():
            law, s = self.laws[g], self.row[g]
            normal = (self.drawn - a * self.dt) @ law.inverse[s]
            self.log_ratio[g] += 0.5 * (self.drawn @ self.drawn - normal @ normal) / self.dt - law.log_det[s]
        elif self.y.any():
            self.log_ratio[g] += a[: self.kind.m] @ (self.y - 0.5 * self.until * a[: self.kind.m])

    def lead(self) -> Array:
        """Return the part of the a that is followed which changes quickly."""
        a = self.a[self.h, : self.kind.m]
        if self.kind.is_martingale:
            return np.zeros_like(a)
        return self.push + self.tables.law_weight * (a - self.push) if self.kind.gated else a

    def record(self, i: int, done: float, applied: Array, whole: float) -> None:
        """Add the step to the control carried, and to the control now."""
        applied += self.inverse @ self.y / whole
        if i == 0 and done == 0.0:
            self.start_control = self.inverse @ (self.lead() - (0.0 if self.kind.is_martingale else self.push))
        early = i < self.tables.window
        self.owed = self.until if early and self.pushes and self.outcome == INSIDE else 0.0
        if early:
            self.now += self.inverse @ (self.y - (self.until - 0.5 * self.owed) * self.lead())
