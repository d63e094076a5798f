"""The execution phase, Algorithm 4: references for every class, samples around all of them, one control."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pirrht import shown
from pirrht.arrays import Array
from pirrht.control.best_class import CONSISTENCY, alone, best_class
from pirrht.control.blocked import Brake, known_law
from pirrht.control.feedback import ClassMixture, ClassPool
from pirrht.control.methods import SAMPLING
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy, TimeBudget, enough_of, pressed_of
from pirrht.control.prediction import FavouritePath, Predictor
from pirrht.control.proposals import PlanContext, ProposalBuilder
from pirrht.control.references import ReferenceCache, blame_speed, check_drives, heirs, renewed, validate_tree
from pirrht.errors import NoReference, NoSurvivingSample, OptionError
from pirrht.estimation.batches import sample
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch, ProposalControl
from pirrht.proposals.walls import WallDrift
from pirrht.steering.in_time import homology_of
from pirrht.topology.homology import Homology
from pirrht.topology.signature import integers

BETWEEN = ("classes", "hold")
ELSEWHEN = 0.1  # a drive that begins so much later is another one [s]
ANEW = 400  # vertices that a tree then gains


class Controller(Policy):
    """Receding-horizon path integral control with topology-guided sampling.

    Args:
        tree: grown beforehand; None only for the method "passive".
        method: one of `methods.SAMPLING`.
        rng: source of one seed per plan.
        polished: shorten references inside their class.
        consistency: factor on the value of the class followed so far under the method "best-class".
        between: until the next plan follow the state by "classes", or "hold" the control (paper).
        homology: tells classes apart where obstacles move; None: that of the tree, or of the problem.
        predict: predicts moving obstacles; None: their motions are known.

    Examples:
        >>> import numpy as np
        >>> from pirrht import Controller, FreeSpace, Goal, HomologyTree, Problem, Sampling, Scene, SingleIntegrator
        >>> from pirrht import StraightLine
        >>> scene = Scene(
        ...     name="room", lower=np.zeros(2), upper=np.array([4.0, 3.0]), obstacles=(),
        ...     goal=Goal(center=np.array([3.4, 1.5]), radius=0.3), start=np.array([0.6, 1.5, 0.0]), robot_radius=0.2,
        ... )
        >>> problem = Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=2.0 * np.eye(2))
        >>> space = FreeSpace.of(scene)
        >>> tree = HomologyTree(space, StraightLine.of(problem), rng=np.random.default_rng(0))
        >>> tree.grow(50)
        >>> controller = Controller(problem, space, tree, Sampling(samples=100), rng=np.random.default_rng(1))
        >>> controller
        Controller(pi-rrht for a SingleIntegrator in 'room': 100 samples, a tree of 50 vertices)
        >>> plan = controller.plan(scene.start[:2])
        >>> bool(plan.control[0] > 0.5)  # towards the goal
        True

    Raises:
        OptionError: method or feedback is unknown, or the tree is missing or of another system.
    """

    def __init__(
        self, problem: Problem, space: FreeSpace, tree: HomologyTree | None, sampling: Sampling, *,
        method: str = "pi-rrht", polished: bool = True, consistency: float = CONSISTENCY, between: str = "classes",
        homology: Homology | None = None, predict: Predictor | None = None,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        if between not in BETWEEN:
            raise OptionError(f"unknown feedback {between!r} between plans; known are {', '.join(BETWEEN)}")
        if method not in SAMPLING:
            raise OptionError(f"unknown method {method!r}; known here are {', '.join(SAMPLING)}")
        self.method, self.name = SAMPLING[method], method
        if tree is None and self.method.most != 0:
            raise OptionError(f"the method {method!r} needs a tree")
        if tree is not None:
            validate_tree(problem, tree)
        self.consistency, self.predict = consistency, predict
        self.polished, self.rng, self.between = polished, rng, between
        self._enter(problem, space, tree, sampling, homology)
        self.begin(problem.dynamics.state_of(problem.scene.start))

    def _enter(
        self, problem: Problem, space: FreeSpace, tree: HomologyTree | None, sampling: Sampling,
        homology: Homology | None = None,
    ) -> None:  # fmt: skip
        """Replace problem, space and tree; nothing is known of earlier plans."""
        if homology is None:
            homology = homology_of(problem, space) if tree is None else tree.homology
        self.path_integral = PathIntegral(problem, space, sampling, homology=homology)
        if tree is not None:
            check_drives(problem, tree, guided=self.path_integral.leads_itself)
        self.problem, self.space, self.tree, self.homology = problem, space, tree, homology
        self.around = ProposalBuilder(problem, self.path_integral, homology, mixes=self.method.mixes)
        self.pool = ClassPool(problem) if self.between == "classes" else None
        self.brake = Brake(problem)

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the drive so far; a new one starts at x (n,), at a time of the moving obstacles' clock [s]."""
        super().begin(x, time)
        self._planned = False
        self._followed: str | None = None  # class, where only one is
        if self.pool is not None:
            self.pool.forget()
        self.around.begin()
        self.brake.begin()
        self._ways = ReferenceCache(polished=self.polished, threads=self.path_integral.threads)
        self._aim(x, time)
        self._way, self._pressed, self._pace = FavouritePath(), pressed_of(None), TimeBudget()

    def update(self, scene: Scene, vertices: int | None = None) -> None:
        """Continue among other static obstacles; the path driven so far still counts.

        A new tree grows. Classes keep their names: obstacles keep their numbers, and new ones come last; turns about
        these count from where the robot is. Guides, control sequences and statistics of a class are kept while its
        path is free. An obstacle that has moved off its own marker is another one. Nothing changes if the scene is
        unchanged, or is refused.

        Args:
            scene: with the same goal; its start does not matter.
            vertices: of the tree; None: as many as the last one has.

        Raises:
            OptionError: the goal is another, or obstacles move.
            SceneError: obstacles cover all of the goal, or the workspace is too large for the robot.
        """
        new = renewed(self.problem, self.space, self.tree, scene, vertices)
        if new is None:
            return
        around, pool, homology = self.around, self.pool, self.homology
        self._enter(*new, self.path_integral.sampling)
        path = self.drive.path
        path.enter(self.space.homology)
        guides = heirs(self.space, path, around.guides.lines(self.drive.since_plan, scene.goal.center))
        classes = guides | heirs(self.space, path, self._ways.lines())
        names = {homology.name(then): self.space.homology.name(now) for then, now in classes.items()}
        self.around.inherit(around, guides, names)
        self._ways.inherit(classes)
        self._followed = names.get(self._followed or "")
        if self.pool is not None and pool is not None:
            self.pool.inherit(pool, names)

    def _aim(self, x: Array, time: float) -> None:
        """Grow a tree in space and time for a drive that begins elsewhere than it was grown for."""
        if self.tree is None or not self.tree.steering.timed:
            return
        here = self.tree.at(x, time)
        scene = self.space.scene
        origin = np.array([*scene.start[:2], 0.0]) if self.tree.origin is None else self.tree.origin
        if np.hypot(*(here[:2] - origin[:2])) > scene.robot_radius or abs(here[2] - origin[2]) > ELSEWHEN:
            self.tree.aim(here)
            self.tree.grow(self.tree.size + ANEW)

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,) (Algorithm 4, lines 3 and 4).

        Args:
            left: time left for sampling [s]; samples are drawn until it is up.

        Raises:
            OptionError: x is no state of the system.
            NoReference: no class reaches the goal, and there is no earlier plan to go on with.
        """
        x = np.asarray(x, dtype=float)
        if x.shape != (self.problem.dynamics.n,):
            moves = f"{type(self.problem.dynamics).__name__} ({', '.join(self.problem.dynamics.states)})"
            raise OptionError(f"the state has the shape {x.shape}; {moves} has {self.problem.dynamics.n} numbers")
        self.drive.ask(x)
        foreseen = self._look(x, self._way.left(x, self.drive.time), enough_of(left))
        if foreseen is not None:
            self.tree = self.tree and foreseen.tree
            self.path_integral.foresee(foreseen.space.traffic, foreseen.homology)
        self._pressed, whole = pressed_of(left), 0.0 if left is None else left()
        try:
            references = self._references(x, self._pace.most(left))
        except NoReference:
            if not self._planned and not self.space.scene.movers:
                self.drive.asked = None  # nothing was planned
                blame_speed(self.tree, x)
                raise
            references = self._kept(x, set())
            if not references:
                return self._blocked(x, "no reference")
        batch = self.batch(x, references)
        self.path_integral.prepare(batch)
        if left is not None:
            self._pace.note(len(references), whole - left())
        estimate = self._estimate(batch, left)
        if estimate is None:
            return self._blocked(x, "no survivor", batch, references)
        self.brake.begin()
        plan = self._plan(batch, references, estimate)
        self._planned, self.drive.since_plan = True, 0.0
        if self._foreseen is not None:
            self._way.note(plan)
        return plan

    def __repr__(self) -> str:
        scene, of = shown.name(self.space.scene.name), type(self.problem.dynamics).__name__
        tree = "no tree" if self.tree is None else f"a tree of {self.tree.size} vertices"
        return f"Controller({self.name} for a {of} in {scene}: {self.path_integral.sampling.samples} samples, {tree})"

    def _blocked(self, x: Array, why: str, batch: Batch | None = None, references: Sequence[Reference] = ()) -> Plan:
        """Brake at x (n,), and wait until there is a path; forget earlier ones."""
        space = self.space if self._foreseen is None else self._foreseen.space
        known = None if batch is None or self.brake.stops else known_law(batch, references)
        halt = self.brake.halt(x, space, self.now, known)
        self.around.begin()
        if self.pool is not None:
            self.pool.forget()
        self.drive.since_plan = 0.0
        return Plan(
            state=x, times=halt.times, references=tuple(references),
            ids=() if batch is None else tuple(batch.classes.values()), estimate=None, fallback=why,
            stops=self.brake.stops, instead=halt.tape, law=halt.law, time=self.drive.time, space=self.space,
            movers=self.movers,
        )  # fmt: skip

    def _plan(self, batch: Batch, references: list[Reference], estimate: Estimate) -> Plan:
        """Return the plan that samples around references make."""
        x = batch.state
        push = self.path_integral.leading.push(estimate.rollouts.leads, x, self.now)
        law = None if self.pool is None else self._law(self.pool, estimate, batch, push)
        return Plan(
            state=x, times=batch.times, references=tuple(references), ids=tuple(batch.classes.values()),
            estimate=estimate, replay=self.path_integral.replay, fallback=None, law=law, classes=batch.named,
            time=self.drive.time, push=push, shares=None if law is None else law.weights(x, 0.0),
            followed=self._followed, space=self.space, movers=self.movers,
        )  # fmt: skip

    def batch(self, x: Array, references: list[Reference]) -> Batch:
        """Return what a plan at x (n,) samples: around references, or passive dynamics if there is none."""
        backwards = partial(self._ways.reversed, self.tree, x, self.now)
        moment = PlanContext(now=self.now, elapsed=self.drive.since_plan, pressed=self._pressed, reversed=backwards)
        batch = self.around.batch(x, references, self._from_start(references), moment)
        return replace(batch, others=self._ways.unseen)

    def _estimate(self, batch: Batch, left: Callable[[], float] | None) -> Estimate | None:
        """Sample and weigh a batch; None if no sample survives."""
        ids, seed = list(batch.classes.values()), int(self.rng.integers(2**63))
        try:
            first = left is None and self.drive.time == self.drive.begun
            least = self.path_integral.sampling.least if first else 0.0
            estimate = sample(self.path_integral, batch, seed, left=left, least=least)
        except NoSurvivingSample:
            return None
        self.around.learn(batch, estimate)
        if self.method.alone and ids:
            estimate = self._alone(estimate, ids, batch.classes)
        guided = self.path_integral.guidance is not None and ids
        return None if guided and estimate.survivors == 0 else estimate

    def _alone(self, estimate: Estimate, ids: list[str], names: Mapping[int, str]) -> Estimate:
        """Estimate by the samples of the best class; forget those of earlier plans if it changes."""
        best = best_class(self.problem, estimate, ids, self._followed, consistency=self.consistency)
        if self._followed != ids[best] and self.pool is not None:
            self.pool.forget()
        self._followed = ids[best]
        return alone(self.problem, estimate, best, {key: name for key, name in names.items() if name == ids[best]})

    def _law(self, pool: ClassPool, estimate: Estimate, batch: Batch, push: WallDrift) -> ClassMixture:
        """Return the feedback until the next plan."""
        rows = sorted(zip(batch.proposals, estimate.proposal_weights, strict=True), key=lambda row: row[1])
        leads: dict[str, ProposalControl | None] = {one.name: None for one, _ in rows if one.key is not None}
        leads |= {one.name: one.lead for one, _ in rows if one.key is not None and one.lead.follows}
        elapsed, self.drive.since_estimate = self.drive.since_estimate, 0.0
        return pool.law(estimate, leads, push, elapsed)

    def _references(self, x: Array, most: int | None = None) -> list[Reference]:
        """Return the references at x (n,), cheapest first; of `most` classes, None: of all."""
        if self.tree is None or self.method.most == 0:
            return []
        found = self._ways.references(
            self.tree, self.homology, self.tree.at(x, self.now), self.driven_class(), pressed=self._pressed,
            most=most,
        )  # fmt: skip
        kept = [] if self.method.most is not None else self._kept(x, set(self._from_start(found)))
        return self.method.around(found, kept)[:most]

    def _kept(self, x: Array, known: set[tuple[int, ...]]) -> list[Reference]:
        """Return the last guides of classes that the tree, close to a wall, has no curve for from x (n,)."""
        references, driven = [], np.array(self.driven_class())
        homology = self.homology if self._foreseen is None else self._foreseen.homology
        for whole, rest in self.around.guides.left(self.drive.since_plan, self.space.scene.goal.center):
            winding = integers(np.asarray(whole) - driven)
            signature = homology.signature(homology.at(x, self.now), winding)
            allowed = self.tree is not None and np.all(np.abs(signature - 1.0) <= self.tree.limit)
            if allowed and whole not in known:
                named = self.homology.named
                references.append(Reference(winding=winding, signature=signature, trajectory=rest, named=named))
        return references

    def _from_start(self, references: list[Reference]) -> list[tuple[int, ...]]:
        """Return the classes of the driven path and each reference together."""
        driven = np.array(self.driven_class())
        return [integers(driven + np.asarray(reference.winding)) for reference in references]
