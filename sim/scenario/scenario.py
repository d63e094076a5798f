"""A scene with a robot, a problem and settings, and the objects of a run: tree, policy, exact solution, plant."""

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from pirrht.arrays import Array
from pirrht.control.baselines import Mppi, TerminalCost
from pirrht.control.controller import Controller
from pirrht.control.cost_to_go import shortest_paths, straight_lines
from pirrht.control.mapped import Mapped
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.control.prediction import ConstantVelocity
from pirrht.control.settings import TREELESS
from pirrht.errors import NoReference, OptionError
from pirrht.estimation.risk import CollisionProbability, collision_probability
from pirrht.estimation.sampling import Sampling
from pirrht.exact.desirability import Desirability, Optimal, solver_for
from pirrht.exact.grid import Progress, ignore_progress
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.planner.limits import grown_tree
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.in_time import InTime
from pirrht.steering.steering import Steering
from pirrht.topology.signature import Signature
from pirrht.traits import Traits
from sim import tree_file
from sim.drive import episode
from sim.drive.episode import Clock
from sim.drive.executor import Executor, Plant
from sim.drive.metrics import Frame
from sim.mjcf import Loaded
from sim.mjcf.names import names_of
from sim.options import check_size
from sim.scenario.narrow_place import narrow_place
from sim.sensing.lidar import Lidar, LidarSensor
from sim.sensing.senses import Senses
from sim.settings import Settings
from sim.systems import System, refuse

QUICK = 400  # vertices at most of a tree that is grown within a control period
DECIDED = ("noise", "phi", "risk", "between", "period")  # settings that decide on the margin of a risk
ENOUGH = 30.0  # effective samples that the first plan of a run rests on, if it can be had

Driver = Controller | Mapped | Mppi | Optimal


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Scenario:
    """A scene with a robot, a problem and settings; everything random comes from `settings.seed`.

    Examples:
        >>> from sim.scenario import prepare
        >>> scenario = prepare("slit", given={"vertices": 50, "samples": 50, "max_time": 0.05})
        >>> scenario
        Scenario(puck in 'slit', pi-rrht, noise 0.1, seed 0)
        >>> tree = scenario.grown_tree()
        >>> frames = list(scenario.drive(scenario.plant(), scenario.driver(tree)))
        >>> frames[-1].outcome
        Outcome.TIMEOUT

    Raises:
        OptionError: plans would fit into no memory or never end, or the optimal law would need a prediction.
    """

    loaded: Loaded
    system: System
    settings: Settings
    problem: Problem
    space: FreeSpace
    margin: float = 0.0  # that plans leave around the robot [m]
    widens: bool = True  # whether the limit H_limit may give way; not one that was given
    risk_note: str = ""  # what a risk changed besides the margin, or that it is not kept
    spare: list[HomologyTree] = field(default_factory=list)  # a tree that is grown already: `grown_tree` takes it
    real: Problem | None = None  # among what there is, where the robot has to see it; None: it is `problem`
    collision: CollisionProbability | None = None  # predicted at the start by the search for a margin

    def __post_init__(self) -> None:
        s = self.settings
        if s.sense == "lidar" and self.system.adapter.dimension == 3:
            raise OptionError("--sense lidar is for robots on the ground; leave it out")
        if s.method == "optimal" and self.moving and s.predict != "known":
            raise OptionError(f"the optimal law knows how bodies move; leave out --predict {s.predict}")
        if s.method == "mppi" and s.mppi_terminal != "straight" and self.system.adapter.dimension == 3:
            raise OptionError("--method mppi knows shortest paths on the ground only; add --mppi-terminal straight")
        check_size(self)

    def __repr__(self) -> str:
        s, loaded = self.settings, self.loaded
        return f"Scenario({loaded.robot} in {loaded.scene.name!r}, {s.method}, noise {s.noise:g}, seed {s.seed})"

    def with_settings(self, **changes: Any) -> Self:
        """Return the scene under other settings; OptionError: the system has no such number, or it cannot work."""
        refuse(self.system, {name: v for name, v in changes.items() if v != getattr(self.settings, name)})
        settings = replace(self.settings, **changes)
        if settings.risk is not None and (fixed := [one for one in DECIDED if one in changes and
                                                    changes[one] != getattr(self.settings, one)]):  # fmt: skip
            raise OptionError(f"{fixed[0]} decides on the margin that keeps --risk; prepare the scene with it")
        problem = self.system.problem(self.problem.scene, settings)
        widens = self.widens and "limit" not in changes
        real = self.real and self.system.problem(self.real.scene, settings)
        return replace(self, settings=settings, problem=problem, real=real, widens=widens, spare=[], collision=None)

    @property
    def start(self) -> Array:
        """Start state, (n,)."""
        return self.problem.dynamics.state_of(self.problem.scene.start)

    @property
    def moving(self) -> bool:
        """Check for moving obstacles that plans know of."""
        return bool(self.problem.scene.movers)

    @property
    def physics_step(self) -> float:
        """Time for which the plant holds a control [s]."""
        return float(self.loaded.model.opt.timestep)

    @property
    def homology(self) -> Signature:
        """Signature that separates the classes of runs."""
        return self._in_time().homology(self.space) if self.moving else self.space.homology

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each static obstacle that paths can turn about."""
        return names_of(self.loaded, self.space)

    def _in_time(self) -> InTime:
        """Return the steering in space and time, at the declared speed or that of the system's own path to the goal."""
        speed, problem = self.system.pace, self.problem
        if speed is None and self.system.steering is not None and not Traits.of(problem).noisy_position:
            steering: Steering = self.system.steered(problem)
            goal = np.asarray(steering.roots(problem.scene.goal.center))[:1]
            path = steering.trajectory(steering.connect(steering.vertex_of(self.start)[None], goal))
            speed = float(path.length / path.durations.sum())
        return InTime.of(problem, self.settings.speed_limit, speed)

    def among(self, scene: Scene) -> Self:
        """Return it in another scene, of which a robot with a lidar knows border, start and goal alone."""
        problem = self.system.problem(scene, self.settings)
        loaded = replace(self.loaded, scene=scene)
        if self.settings.sense == "map":
            return replace(self, loaded=loaded, problem=problem)
        return replace(self, loaded=loaded, real=problem, problem=self.system.problem(unseen(scene), self.settings))

    def steering(self) -> Steering:
        """Return the two-point optimum that fits the dynamics; in space and time among moving obstacles."""
        steering: Steering = self._in_time() if self.moving else self.system.steered(self.problem)
        return steering

    def _seeds(self) -> tuple[np.random.SeedSequence, ...]:
        """Return independent seeds of the tree, the sampler and the plant."""
        s = self.settings
        _, sampler, plant = np.random.SeedSequence(s.seed).spawn(3)
        return np.random.SeedSequence(s.seed if s.plan_seed is None else s.plan_seed).spawn(3)[0], sampler, plant

    def plant_rng(self) -> np.random.Generator:
        """Return the generator of the plant's noise; it draws one increment per physics step, whatever the method."""
        return np.random.default_rng(self._seeds()[2])

    @property
    def sampling(self) -> Sampling:
        """Sampling of the settings."""
        s = self.settings
        return Sampling(
            dt=s.dt, first=s.period if s.period < s.dt else None, samples=s.samples, exit=s.exit, steps=s.steps,
            weights=s.weights, guide=s.guide, allocation=s.allocation, draws=s.draws, target=s.target_error,
            least=ENOUGH if s.guide == "feedback" else 0.0, budget=s.budget, threads=s.threads,
        )  # fmt: skip

    def classes_at_start(self, limit: float | None = None) -> int:
        """Count classes within a limit of |1 - H_i|, by default the settings', at the start; `classes` at most."""
        homology, limit = self.homology, limit or self.settings.limit
        straight = homology.base(homology.at(self.start, 0.0))
        number = np.floor(limit - straight) - np.ceil(-limit - straight) + 1
        return int(np.clip(np.prod(number), 1, self.settings.classes or Settings().classes))

    @property
    def predicts_collisions(self) -> bool:
        """Whether samples are judged along their steps, and the method is not another law than theirs."""
        return self.settings.exit == "bridge" and self.settings.method != "mppi"

    def collisions(self, plan: Plan | None, margin: float = 0.0) -> CollisionProbability | None:
        """Predict the probability of a collision from a plan on, with a wider margin by so much [m].

        None: there are no samples, or nothing is predicted (`predicts_collisions`).
        """
        if plan is None or plan.estimate is None or not self.predicts_collisions:
            return None
        full, scene = self.margin + margin, self.loaded.scene
        least = full - max((disc.less for disc in scene.narrow), default=0.0)
        lines = {name: one.trajectory.points for name, one in zip(plan.ids, plan.references, strict=True)}
        kept = {name: full - waived_along(scene, line) for name, line in lines.items()}
        margins = {code: kept.get(name, least) for code, name in plan.classes.items()}
        return collision_probability(
            self.problem, plan.estimate, step=self.held, margin=least, classes=plan.classes, margins=margins
        )

    @property
    def held(self) -> float:
        """Return how long a control is held [s]: a physics step, or the period if plans are held."""
        return self.settings.period if self.settings.between == "hold" else self.physics_step

    def empty_tree(
        self, limit: float | None = None, space: FreeSpace | None = None, seed: np.random.SeedSequence | None = None
    ) -> HomologyTree:
        """Return a tree that has its roots only; in another limit, free space or seed than the scenario's if given."""
        s, rng = self.settings, np.random.default_rng(seed or self._seeds()[0])
        return HomologyTree(space or self.space, self.steering(), limit=limit or s.limit, classes=s.classes, rng=rng)

    def grown_tree(self, progress: Callable[[int], None] | None = None, at: Array | None = None) -> HomologyTree:
        """Grow a tree of `settings.vertices` vertices, or load the one that was saved as `settings.tree`.

        A limit that was not asked for gives way to the short classes at the start, or at another state (n,)
        (`pirrht.grown_tree`).
        OptionError: the file holds no tree for this scene, robot and limit.
        """
        s, x = self.settings, self.start if at is None else at
        if s.tree is not None:
            return tree_file.load(s.tree, self.space, self.steering(), limit=s.limit, classes=s.classes)

        if at is None and self.spare:
            return self.spare.pop()
        if self.widens:
            return grown_tree(
                self.space, self.steering(), x, s.vertices, limit=s.limit, classes=s.classes, seed=self._seeds()[0],
                progress=progress,
            )  # fmt: skip
        tree = self.empty_tree()
        tree.grow(s.vertices, progress=progress)
        return tree

    def references(self, tree: HomologyTree, *, waits: bool = False) -> list[Reference]:
        """Return the best path of every class from the start, cheapest first; NoReference: there is none.

        Among moving obstacles, or without a map, that is no error if the robot `waits` for a path.
        """
        try:
            return tree.references(tree.at(self.start, 0.0), shortened=self.settings.polish)
        except NoReference as error:
            if waits and (self.moving or self.settings.sense == "lidar"):
                return []
            left = self.space.margin_left(self.start)
            own = self.space.scene.margin - self.margin  # of the footprint

            known = {"vertices": tree.size, "limit": tree.limit}
            if left is None:
                if (place := narrow_place(tree, self.start)) is None:
                    raise
                narrow = place.says(self.space.scene.footprint)
                raise NoReference(error.state, narrow=narrow, **known) from None
            left = math.floor(1e3 * max(left - own, 0.0)) / 1e3
            raise NoReference(error.state, margin=self.margin, left=left, **known) from None

    def optimal(self, truth: Desirability | None = None, progress: Progress = ignore_progress) -> Optimal:
        """Return the grid's feedback law, in continuous time; `truth` if it has been solved for before."""
        return Optimal(truth or self.truth(progress, steps=False), self.sampling, held=self.physics_step)

    def truth(self, progress: Progress = ignore_progress, *, steps: bool = True) -> Desirability:
        """Solve exactly, for `steps` of dt if exit is judged at their ends; OptionError: no grid solves the problem."""
        dt = self.settings.dt if steps and self.settings.exit == "endpoint" else None
        try:
            solver_for(self.problem, self.space, dt)
        except OptionError:
            where, who = (" among moving bodies", "puck") if self.moving else ("", "puck or unicycle")
            if self.system.adapter.dimension == 3:
                where, who = (" among moving bodies in space", "") if self.moving else (where, "ball")
            raise OptionError(
                f"no grid solves the problem of {self.system.called}{where}, so its exact value and optimal control "
                "are not known: leave out --truth, choose another --method than optimal"
                f"{f', or --robot {who}' if who else ''}"
            ) from None
        return Desirability.of(self.problem, self.space, dt=dt, progress=progress)

    def controller(self, tree: HomologyTree | None) -> Controller | Mppi:
        """Return the receding-horizon controller over a grown tree; MPPI if that is the method.

        Methods of one reference, or none, have at least as many samples as "pi-rrht" draws from the start.
        """
        s, sampling = self.settings, self.sampling
        limit = None if tree is None else tree.limit
        classes = self.classes_at_start(limit)
        if s.method in ("mppi", "single", "passive"):
            budget = None if s.budget is None else s.budget * classes
            sampling = replace(sampling, samples=s.samples * classes, budget=budget)
        tree_seed, sampler_seed, _ = self._seeds()
        more: Any = {"homology": self.homology, "rng": np.random.default_rng(sampler_seed), "predict": None}
        if self.moving and s.predict != "known":
            seeds = tree_seed.spawn(1)[0]
            trees = None if s.method in TREELESS else lambda space: self.empty_tree(limit, space, seeds.spawn(1)[0])
            more["predict"] = ConstantVelocity(self.space, self._in_time(), trees, vertices=min(s.vertices, QUICK))
        if s.method == "mppi":
            sampling = replace(sampling, first=None, guide="open-loop", draws="independent")
            problem = self.system.problem(self.problem.scene, replace(s, noise=s.exploration * s.noise))

            def terminal_costs(space: FreeSpace) -> TerminalCost:
                straight = s.mppi_terminal == "straight"
                remaining = straight_lines(problem.scene.goal) if straight else shortest_paths(space)
                costs: TerminalCost = self.system.cost_to_go(problem, remaining)
                return costs

            return Mppi(
                problem, self.space, sampling, horizon=s.horizon, terminal_costs=terminal_costs, deceleration=s.brake,
                **more,
            )  # fmt: skip
        return Controller(
            self.problem, self.space, tree, sampling, method=s.method, shortened=s.polish, consistency=s.consistency,
            look_ahead=s.look_ahead, between=s.between, held=self.physics_step, deceleration=s.brake, **more,
        )  # fmt: skip

    def driver(
        self, tree: HomologyTree | None = None, truth: Desirability | None = None, progress: Progress = ignore_progress
    ) -> Driver:
        """Return the policy of the settings' method, over a grown tree; `truth` is the method "optimal"'s if known."""
        s = self.settings
        if s.method == "optimal":
            return self.optimal(truth, progress)
        controller = self.controller(tree)
        if s.sense == "map":
            return controller
        return Mapped(controller, cell=s.cell, unknown=s.unknown, background=s.real_time)

    def plant(self) -> Plant:
        """Return the robot in MuJoCo, or its stochastic equation."""
        period = self.settings.period
        if self.settings.plant == "mujoco":
            return Executor(self.loaded, self.real or self.problem, period=period, senses=self.senses())
        return Plant(self.problem, period=period, physics_step=self.physics_step)

    def senses(self) -> Senses | None:
        """Return what the robot sees with; None: it knows the scene."""
        s = self.settings
        if s.sense == "map":
            return None
        sensor = LidarSensor(self.loaded, Lidar.of(s.lidar or ""))
        return Senses(sensor, s.sense_pose, np.random.default_rng(self._seeds()[2].spawn(1)[0]))

    def drive(
        self, plant: Plant, driver: Policy, *, start: Array | None = None, rng: np.random.Generator | None = None,
        grid: Desirability | None = None,
    ) -> Generator[Frame]:  # fmt: skip
        """Run from a start (n,) under the plant's noise, as fast as it goes or in real time; see `episode.run`."""
        s = self.settings
        grow = 0 if s.grow is None and isinstance(driver, Mapped) else s.grow  # the next map's tree is another one
        if isinstance(driver, Mapped) and isinstance(plant, Executor) and plant.senses is not None:
            driver.sensor = plant.senses
        return episode.run(
            plant, driver, self.start if start is None else start, rng or self.plant_rng(), max_time=s.max_time,
            grow=grow, clock=Clock() if s.real_time else None, grid=grid, risk=self.collisions,
        )  # fmt: skip


def unseen(scene: Scene) -> Scene:
    """Return a scene without its obstacles."""
    return replace(scene, obstacles=(), movers=(), narrow=())


def waived_along(scene: Scene, line: Array) -> float:
    """Return the most by which the margin is smaller in the narrow passages of a path (l, 2), a polyline [m]."""
    tails = line[:-1]
    span = np.diff(line, axis=0)
    square = np.maximum((span**2).sum(axis=1), 1e-300)
    most = 0.0
    for disc in scene.narrow:
        away = np.array([disc.x, disc.y]) - tails
        share = np.clip((away * span).sum(axis=1) / square, 0.0, 1.0)
        if np.hypot(*(away - share[:, None] * span).T).min(initial=np.inf) < scene.robot_radius:
            most = max(most, disc.less)
    return most
