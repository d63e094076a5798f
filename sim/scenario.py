"""From a scene and settings to the objects of a run: problem, free space, tree, controller and plant."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.control.methods import TREELESS
from pirrht.control.mppi import Mppi
from pirrht.control.optimal import Optimal
from pirrht.control.policy import Policy
from pirrht.control.prediction import ByVelocity, Prediction
from pirrht.errors import NoReference, OptionError, SceneError
from pirrht.estimation.sampling import Sampling
from pirrht.exact.desirability import Desirability, solver_for
from pirrht.exact.progress import Progress, untold
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.steering.in_time import InTime
from pirrht.steering.steering import Steering
from pirrht.topology.homology import Homology
from pirrht.topology.in_time import TimedHomology
from pirrht.tree import file as tree_file
from pirrht.tree.homology_tree import HomologyTree
from pirrht.tree.reference import Reference
from sim import memory
from sim.drive import episode, realtime
from sim.drive.executor import Analytic, Executor, Plant
from sim.drive.odometer import Frame
from sim.mjcf import Loaded, load
from sim.mjcf.covered import covered
from sim.settings import Settings, settle
from sim.system_import import chosen
from sim.systems import System, named, refuse

Driver = Controller | Mppi | Optimal
WIDER = (0.8, 1.0, 1.5)  # H_limit where no class reaches the goal within the robot's own
AMONG = 0.8  # H_limit where bodies move and nobody says another: who waits for one is turned about by it meanwhile
QUICK = 400  # vertices at most of a tree that is grown within a control period


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scenario:
    """A scene with a robot, a problem and settings; everything random comes from `settings.seed`.

    Example:
        >>> from sim.scenario import prepare
        >>> scenario = prepare("slit", given={"vertices": 50, "samples": 50, "max_time": 0.05})
        >>> scenario
        Scenario(puck in 'slit', pi-rrht, noise 0.1, seed 0)
        >>> tree = scenario.grown_tree()
        >>> frames = list(scenario.drive(scenario.plant(), scenario.driver(tree)))
        >>> frames[-1].outcome
        Outcome.TIMEOUT

    Raises:
        OptionError: plans under these settings would fit into no memory, or never end.
    """

    loaded: Loaded
    system: System
    settings: Settings
    problem: Problem
    space: FreeSpace

    def __post_init__(self) -> None:
        memory.check(self.settings, self._size())

    def __repr__(self) -> str:
        what = (
            f"{self.loaded.robot} in {self.loaded.scene.name!r}, {self.settings.method}, noise {self.settings.noise:g}"
        )
        return f"Scenario({what}, seed {self.settings.seed})"

    @property
    def start(self) -> Array:
        """Start state, (n,)."""
        return self.problem.dynamics.state_of(self.problem.scene.start)

    @property
    def moving(self) -> bool:
        """Whether bodies move in the scene."""
        return bool(self.loaded.scene.movers)

    @property
    def homology(self) -> Homology | TimedHomology:
        """What tells classes of drives apart."""
        return self._in_time.homology(self.space) if self.moving else self.space.homology

    @property
    def _in_time(self) -> InTime:
        return InTime.of(self.problem, self.settings.speed_limit, self._pace())

    def _pace(self) -> float | None:
        """The best speed of ways [m/s]: as declared, or else what its own steering makes of the way to the goal."""
        if self.system.pace is not None or self.system.steering is None or self.problem.dynamics.noisy_position:
            return self.system.pace
        steering: Steering = self.system.steered(self.problem)
        goal = np.asarray(steering.roots(self.problem.scene.goal.center))[:1]
        found = steering.trajectory(steering.connect(steering.vertex_of(self.start)[None], goal))
        return float(found.length / found.durations.sum())

    def _prediction(self, *, trees: bool) -> Prediction | None:
        """What plans take to come of bodies that move; None: they know."""
        if not self.moving or self.settings.predict == "known":
            return None
        seeds = self.seeds()[0].spawn(1)[0]

        def grown(space: FreeSpace) -> HomologyTree:
            return self._rooted(space, np.random.default_rng(seeds.spawn(1)[0]))

        vertices = min(self.settings.vertices, QUICK)
        return ByVelocity(self.space, self._in_time, grown if trees else None, vertices=vertices)

    def seeds(self) -> tuple[np.random.SeedSequence, ...]:
        """Independent seeds of the tree, the sampler and the plant."""
        tree, sampler, plant = np.random.SeedSequence(self.settings.seed).spawn(3)
        if self.settings.plan_seed is not None:
            tree = np.random.SeedSequence(self.settings.plan_seed).spawn(3)[0]
        return tree, sampler, plant

    def with_settings(self, **changes: Any) -> Scenario:
        """The same scene under other settings; the free space is kept.

        Raises:
            OptionError: the system has no such number, or a value cannot work.
        """
        refuse(self.system, {name: v for name, v in changes.items() if v != getattr(self.settings, name)})
        settings = replace(self.settings, **changes)
        return replace(self, settings=settings, problem=self.system.problem(self.loaded.scene, settings))

    def steering(self) -> Steering:
        """The two-point optimum that fits the dynamics; ways in space and time where bodies move."""
        if self.moving:
            return self._in_time
        steering: Steering = self.system.steered(self.problem)
        return steering

    def empty_tree(self, limit: float | None = None) -> HomologyTree:
        """A tree that has its roots only; within another limit than the settings' if one is given."""
        return self._rooted(self.space, np.random.default_rng(self.seeds()[0]), limit)

    def _rooted(self, space: FreeSpace, rng: np.random.Generator, limit: float | None = None) -> HomologyTree:
        s = self.settings
        return HomologyTree(space, self.steering(), limit=limit or s.limit, classes=s.classes, rng=rng)

    def grown_tree(self, progress: Callable[[int], None] | None = None) -> HomologyTree:
        """A tree of `settings.vertices` vertices, or the one that was saved as `settings.tree`.

        Where no class reaches the goal from the start within the robot's own limit, it is grown anew within wider ones.

        Raises:
            OptionError: that is no tree for this scene, robot and limit.
        """
        s = self.settings
        if s.tree is not None:
            return tree_file.load(s.tree, self.space, self.steering(), limit=s.limit, classes=s.classes)
        own = s.limit == (AMONG if self.moving else self.system.settings.limit)
        first: HomologyTree | None = None
        for limit in (s.limit, *(wider for wider in WIDER if own and wider > s.limit)):
            tree = self.empty_tree(limit)
            tree.grow(s.vertices, progress=progress)
            if tree.lengths(tree.homology.asked(self.start, 0.0)):
                return tree
            first = first or tree
        assert first is not None
        return first

    def references(self, tree: HomologyTree) -> list[Reference]:
        """The best path of every class from the start, cheapest first.

        Raises:
            NoReference: no class reaches the goal.
            SceneError: none does, and a body that moves comes to rest there.
        """
        try:
            return tree.references(tree.homology.asked(self.start, 0.0), polished=self.settings.polish)
        except NoReference:
            why = covered(self.loaded.scene)
            if why is None:
                raise
            raise SceneError(
                f"{self.loaded.scene.name}: {why}, and no way was found that gets there before; let it rest elsewhere"
            ) from None

    def truth(self, progress: Progress = untold) -> Desirability:
        """The exact solution: in continuous time, or for steps of dt if exit is judged at their ends.

        Args:
            progress: called with the share that is done, where that takes long.

        Raises:
            OptionError: no grid solves this problem.
        """
        dt = self.settings.dt if self.settings.exit == "endpoint" else None
        self._refuse_unsolved(dt)
        return Desirability.of(self.problem, self.space, dt=dt, progress=progress)

    def optimal(self, truth: Desirability | None = None, progress: Progress = untold) -> Optimal:
        """The grid's feedback law, in continuous time; `truth` if it has been solved for before.

        Args:
            progress: called with the share that is done, where it has not and that takes long.

        Raises:
            OptionError: bodies are to be foretold, and the law knows how they move.
        """
        self.refuse_foretold()
        self._refuse_unsolved(None)
        truth = truth or Desirability.of(self.problem, self.space, progress=progress)
        return Optimal(truth, self.sampling)

    def refuse_foretold(self) -> None:
        """Refuse bodies whose motions are to be foretold, for the optimal law, which knows them.

        Raises:
            OptionError: they are.
        """
        if self.moving and self.settings.predict != "known":
            raise OptionError(f"the optimal law knows how bodies move; leave out --predict {self.settings.predict}")

    def _refuse_unsolved(self, dt: float | None) -> None:
        """Refuse by its public name a robot that no grid serves.

        Raises:
            OptionError: says which robots there are grids for.
        """
        try:
            solver_for(self.problem, self.space, dt)
        except OptionError:
            moving = bool(self.space.scene.movers)
            where, who = (" among moving bodies", "puck") if moving else ("", "puck or unicycle")
            raise OptionError(
                f"no grid solves the problem of a {self.system.called}{where}, so its exact value and optimal control "
                f"are not known: leave out --truth, choose another --method than optimal, or --robot {who}"
            ) from None

    def mppi(self) -> Mppi:
        """MPPI, with at least as many samples as "pi-rrht" draws from the start."""
        s = self.settings
        sampling = replace(self._at_once(), first=None, guide="open-loop", draws="independent")
        problem = self.system.problem(self.loaded.scene, replace(s, noise=s.exploration * s.noise))
        home, rng = self.system.way_home(problem), np.random.default_rng(self.seeds()[1])
        return Mppi(
            problem, self.space, sampling, horizon=s.horizon, beyond=home, homology=self.homology,
            predict=self._prediction(trees=False), rng=rng,
        )  # fmt: skip

    def _at_once(self) -> Sampling:
        """Sampling around one reference, or none, with at least as many samples as "pi-rrht" draws from the start."""
        s, classes = self.settings, self._classes_at_start()
        budget = None if s.budget is None else s.budget * classes
        return replace(self.sampling, samples=s.samples * classes, budget=budget)

    def _classes_at_start(self) -> int:
        """Classes with |1 - H_i| <= H_limit at the start, `settings.classes` at most."""
        homology, limit = self.homology, self.settings.limit
        here = np.append(self.start[:2], 0.0) if isinstance(homology, TimedHomology) else self.start[:2]
        straight = homology.straight(here[None])[0]
        most = self.settings.classes or Settings().classes
        number = np.floor(limit - straight) - np.ceil(-limit - straight) + 1
        return int(np.clip(np.prod(number), 1, most))

    def _size(self) -> memory.Size:
        d, scene = self.problem.dynamics, self.loaded.scene
        return memory.Size(
            states=d.n,
            controls=d.m,
            obstacles=len(self.space.obstacles),
            classes=self._classes_at_start(),
            distance=float(np.hypot(*(scene.goal.center - scene.start[:2]))),
            speed=self.settings.speed if "speed" in self.system.heeds else 1.0,
            temperature=self.problem.temperature,
            rate=self.problem.least_rate,
        )

    def controller(self, tree: HomologyTree | None) -> Controller | Mppi:
        """The receding-horizon controller over a grown tree; MPPI if that is the method."""
        if self.settings.method == "mppi":
            return self.mppi()
        return Controller(
            self.problem,
            self.space,
            tree,
            self._at_once() if self.settings.method in ("single", "passive") else self.sampling,
            method=self.settings.method,
            polished=self.settings.polish,
            consistency=self.settings.consistency,
            between=self.settings.between,
            homology=self.homology,
            predict=self._prediction(trees=self.settings.method not in TREELESS),
            rng=np.random.default_rng(self.seeds()[1]),
        )

    def driver(
        self,
        tree: HomologyTree | None = None,
        truth: Desirability | None = None,
        progress: Progress = untold,
    ) -> Driver:
        """Who decides under the settings' method.

        Args:
            tree: a grown one, of methods that need one.
            truth: of the method "optimal", the exact solution in continuous time if it is known already.
            progress: called with the share of it that is done, if it is not.
        """
        return self.optimal(truth, progress) if self.settings.method == "optimal" else self.controller(tree)

    def drive(self, plant: Plant, driver: Policy) -> Generator[Frame]:
        """The drive from the start, as fast as it goes or in real time; one frame per control period.

        Raises:
            NoReference: already the start has no reference.
        """
        s, start, rng = self.settings, self.start, self.plant_rng()
        if s.real_time:
            return realtime.run(plant, driver, start, rng, period=s.period, max_time=s.max_time, grow=s.grow)
        return episode.run(plant, driver, start, rng, max_time=s.max_time, grow=s.grow or 0)

    @property
    def sampling(self) -> Sampling:
        """How paths are drawn and weighed."""
        s = self.settings
        first = s.period if s.period < s.dt else None
        return Sampling(
            dt=s.dt,
            first=first,
            samples=s.samples,
            exit=s.exit,
            steps=s.steps,
            weights=s.weights,
            guide=s.guide,
            allocation=s.allocation,
            draws=s.draws,
            target=s.target_error,
            budget=s.budget,
            threads=s.threads,
        )

    def plant(self) -> Plant:
        """The robot in MuJoCo, or its stochastic equation."""
        period = self.settings.period
        if self.settings.plant == "mujoco":
            return Executor(self.loaded, self.problem, period=period)
        step = float(self.loaded.model.opt.timestep)
        return Analytic(self.problem, self.space.collision.clearance, period=period, physics_step=step)

    def plant_rng(self) -> np.random.Generator:
        """The plant's noise; one increment per physics step whatever the method."""
        return np.random.default_rng(self.seeds()[2])


def prepare(
    scene: str | Path,
    *,
    robot: str | Path | None = None,
    system: str | System | None = None,
    radius: float | None = None,
    margin: float | None = None,
    start: Sequence[float] | None = None,
    goal: Sequence[float] | None = None,
    preset: str | None = None,
    given: Mapping[str, Any] | None = None,
    known: Callable[[System, Problem], object] | None = None,
    loose: bool = False,
    driven: bool = True,
) -> Scenario:
    """Load a scene and settle everything a run needs.

    Args:
        system: what moves, in place of what the robot's file names: MODULE:NAME, or one that is registered.
        given: settings by name, None where not said.
        known: told of system and problem as soon as they are known, before anything is compiled for them.
        loose: whether what stands can be moved (`sim.mjcf.load`).
        driven: whether a robot that its plant cannot drive is refused.

    Raises:
        SceneError, OptionError, NotLinearlySolvable: with one line for a person.
    """
    moves = None if system is None else chosen(system)
    loaded = load(scene, robot=robot, radius=radius, margin=margin, start=start, goal=goal, system=moves, loose=loose)
    kind = named(loaded.dynamics_name)
    said = given or {}
    overlay = kind.preset(preset)
    refuse(kind, said)
    base = replace(kind.settings, limit=AMONG) if loaded.scene.movers else kind.settings
    settings = settle(base, kind.heard(loaded.scene.defaults, loaded.meant), overlay, said)
    problem = kind.problem(loaded.scene, settings)
    if known is not None:
        known(kind, problem)
    space = FreeSpace.of(loaded.scene)
    scenario = Scenario(loaded=loaded, system=kind, settings=settings, problem=problem, space=space)
    if driven:
        scenario.plant()
    return scenario
