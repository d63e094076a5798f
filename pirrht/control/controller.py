"""Algorithm 4, the execution phase: references of every class, samples around all of them, one control."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control import map_update
from pirrht.control.blocked import Brake, blocked_plan
from pirrht.control.checks import refuse_misfits, validate
from pirrht.control.governor import governed
from pirrht.control.map_update import Renewed
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.control.prediction import ConstantVelocity
from pirrht.control.proposals import ProposalBuilder, Propose, Surcharge, plan_of
from pirrht.control.pursuit import pursuing
from pirrht.control.references import extract_references, regrow
from pirrht.control.settings import TUNING, ControlSettings, ControlTuning, TimeBudget
from pirrht.errors import NoReference
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch
from pirrht.rollouts.backend import Backend
from pirrht.rollouts.cpu import Cpu
from pirrht.steering.in_time import homology_of
from pirrht.topology.signature import Signature


class Controller(Policy):
    """Receding-horizon path integral control with topology-guided sampling.

    Args:
        tree: of the scene, grown beforehand; None only for the method "passive".
        method, shortened, consistency, look_ahead, between, held, tuning: see `ControlSettings`.
        propose: functions of a state and the default proposal of a class that return another one, or None.
        backend: simulates paths; None: compiled kernels on this machine.
        homology: tells classes apart; None: that of the tree, or of the problem.
        predict: predicts moving obstacles; None: their motions are known.
        deceleration: at which the robot can brake [m/s^2]: controls keep to speeds from which it can stop (`governor`);
            0: it stops at once.
        surcharge: what the samples of a class pay besides their cost, by its reference [cost]; None: nothing.
        rng: source of one seed per plan.

    Nothing but its `run`, the state of the run under way, and the tree changes from plan to plan.

    Examples:
        >>> import numpy as np
        >>> from pirrht import *
        >>> goal, start = Goal(center=np.array([3.4, 1.5]), radius=0.3), np.array([0.6, 1.5, 0.0])
        >>> room = {"name": "room", "lower": np.zeros(2), "upper": np.array([4.0, 3.0]), "obstacles": ()}
        >>> scene = Scene(**room, goal=goal, start=start, robot_radius=0.2)
        >>> problem, space = Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=np.eye(2)), FreeSpace.of(scene)
        >>> tree = HomologyTree(space, StraightLine.of(problem), rng=np.random.default_rng(0))
        >>> tree.grow(50)
        >>> controller = Controller(problem, space, tree, Sampling(samples=100), rng=np.random.default_rng(1))
        >>> bool(controller.plan(start[:2]).control[0] > 0.5)  # towards the goal
        True

    Raises:
        OptionError: method or feedback is unknown, the tree is missing or of another system, or an argument is of a
            type that cannot serve.
    """

    def __init__(
        self, problem: Problem, space: FreeSpace, tree: HomologyTree | None, sampling: Sampling, *,
        method: str = "pi-rrht", shortened: bool = True, consistency: float = 0.8, look_ahead: float = 0.6,
        between: str = "classes", held: float | None = None, homology: Signature | None = None,
        predict: ConstantVelocity | None = None, tuning: ControlTuning = TUNING, propose: Sequence[Propose] = (),
        backend: Backend | None = None, surcharge: Surcharge | None = None, deceleration: float = 0.0,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self.settings = ControlSettings(
            method=method, shortened=shortened, consistency=consistency, look_ahead=look_ahead, between=between,
            held=held, tuning=tuning,
        )  # fmt: skip
        refuse_misfits(sampling, propose, backend, rng)
        self.predict, self.rng, self.surcharge = predict, rng, surcharge
        self.deceleration = deceleration
        self.tracks = False
        validate(tree, problem, sampling, self.settings)
        self._enter(problem, space, tree, sampling, homology, propose, backend)
        self.begin(problem.dynamics.state_of(problem.scene.start))

    def _enter(
        self, problem: Problem, space: FreeSpace, tree: HomologyTree | None, sampling: Sampling,
        homology: Signature | None = None, propose: Sequence[Propose] = (), backend: Backend | None = None,
    ) -> None:  # fmt: skip
        """Replace problem, space and tree."""
        own = homology_of(problem, space) if tree is None else tree.homology

        self.tree = tree
        self.homology = homology or own
        self.brake = Brake(problem=problem)

        self.path_integral = path_integral(problem, space, sampling, homology=self.homology, backend=backend)
        self.proposals = ProposalBuilder(
            integral=self.path_integral, settings=self.settings, propose=propose, surcharge=self.surcharge
        )

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the run so far; a new one starts at x (n,), at a time of the moving obstacles' clock [s]."""
        super().begin(x, time)
        regrow(self.tree, x, time, self.settings.tuning)

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,): lines 3 and 4 of Algorithm 4; the caller applies the control (line 5).

        OptionError: x is no state. NoReference: no class reaches the goal, and there is no earlier plan to go on with;
        SceneError if that is since x lies in an obstacle.
        """
        return self.governed(self._decided(x, left))

    def _decided(self, x: Array, left: Callable[[], float] | None) -> Plan:
        """Return the plan of `plan`, whatever the brakes."""
        run, settings, x = self.run, self.settings, self._state(x)
        self._update_prediction(x, TimeBudget(left, settings.tuning))
        gap = settings.tuning.off_walls * self.space.scene.robot_radius
        world = self.path_integral.setup.world
        x = world.off_walls(x, self.problem.dynamics.reads(world.static.kernels.turns), run.now, gap)
        stands = self.brake.stops and run.halt is not None and run.halt.free == inf
        stuck = left is not None and stands and run.clock.since_estimate >= settings.tuning.stuck
        budget = TimeBudget(left, settings.tuning, addition=settings.tuning.standing if stuck else 0.0)
        try:  # line 3: U_in <- ExtractReference(x_cur, (V, E))
            references = extract_references(self.tree, x, run, budget, settings, self.path_integral)
        except NoReference:
            if run.planned or self.space.scene.movers:
                return blocked_plan(self.brake, x, run, self.space, "no reference")
            run.queried = None
            self.space.refuse_start(x)
            raise
        if settings.use.pursues:
            return pursuing(self.path_integral, x, references[0], run, settings)
        # line 4: u <- PathIntegral(x_cur, U_in)
        draft = self.proposals.draft(x, references, run, budget)
        batch, estimate = self.proposals.estimate(draft, int(self.rng.integers(2**63)), run, budget)
        if estimate is None:
            return blocked_plan(self.brake, x, run, self.space, "no survivor", batch, references)
        return plan_of(self.path_integral, batch, references, estimate, run, settings)

    def governed(self, plan: Plan) -> Plan:
        """Return a plan whose controls keep to speeds from which the robot can stop."""
        moving = self.path_integral.setup.world.moving
        d = self.problem.dynamics
        sure = self.predict is None and not self.tracks
        return governed(plan, d, self.space.static, self.deceleration, moving, self.run.now, self.blind, sure=sure)

    def batch(self, x: Array, references: list[Reference]) -> Batch:
        """Return what a plan at x (n,) samples first, around references."""
        return self.proposals.mixture(self.proposals.draft(x, references, self.run, TimeBudget()), self.run)

    def adopt(self, new: Renewed | None) -> None:
        """Continue in a scene that `renewed` has examined; None: in the last one."""
        if new is not None:
            self._reenter(*new)
            map_update.continue_among(self.space, self.run)

    def avoid(self, movers: Sequence[Mover]) -> None:
        """Continue among obstacles that move as predicted, on the run's clock, until the next map or prediction.

        They make no classes, and the tree does not know of them: guides and samples pass them in time.
        """
        if not movers and not self.space.scene.movers:
            return
        space = self.space.with_blockers(movers)
        scene = replace(self.problem.scene, movers=space.scene.movers)
        self._reenter(replace(self.problem, scene=scene), space, self.tree)
        if bool(movers) != bool(self.run.route.movers):
            self.run.starts.forget()  # other kernels take other laws
            self.run.shares.forget()
        self.run.route.movers = space.scene.movers
        self.tracks = bool(movers)

    def _reenter(self, problem: Problem, space: FreeSpace, tree: HomologyTree | None) -> None:
        """Continue in another problem, with what the user gave."""
        integral = self.path_integral
        backend = None if isinstance(integral.backend, Cpu) else integral.backend  # kernels depend on moving obstacles
        self._enter(problem, space, tree, integral.sampling, propose=self.proposals.propose, backend=backend)

    def __repr__(self) -> str:
        of = f"a {type(self.problem.dynamics).__name__} in {formatting.name(self.space.scene.name)}"
        tree = "no tree" if self.tree is None else f"a tree of {self.tree.size} vertices"
        return f"Controller({self.settings.method} for {of}: {self.path_integral.sampling.samples} samples, {tree})"
