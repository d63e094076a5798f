"""Baselines: follow the best class only, and model predictive path integral control without references.

*Best class.* teb_local_planner (Roesmann, Hoffmann and Bertram, Robotics and Autonomous Systems 88, 2017) and T-MPC (de
Groot, Ferranti, Gavrila and Alonso-Mora, IEEE T-RO 2025) optimise several homotopy classes and execute the cheapest.
Here psi_h is the mean over the samples around reference h, each weighed by dP/dQ_h alone, v_h = -lambda log psi_h, and
the control is the mean of these samples. Both planners can favour the class followed so far: its cost is multiplied by
`selection_cost_hysteresis` (1 by default) or by `selection_weights/consistency` (0.8 as T-MPC is configured).

*MPPI.* Williams, Wagener, Goldfain, Drews, Rehg, Boots and Theodorou, "Information theoretic MPC for model-based
reinforcement learning" (ICRA 2017), Algorithm 2. Around the controls u_0 .. u_T-1 noise eps is drawn; a path costs

    S = sum of q dt + phi at a collision + cost-to-go at the horizon + sum of u' lambda Sigma^-1 eps dt,

where lambda Sigma^-1 = R for matched noise, and the controls move by the mean of eps at the weights exp(-S / lambda).
The XX"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control import map_update
from pirrht.control.cost_to_go import cost_to_go, shortest_paths
from pirrht.control.governor import governed
from pirrht.control.map_update import Renewed
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.control.prediction import ConstantVelocity
from pirrht.control.run_state import ClassShares
from pirrht.control.settings import TimeBudget
from pirrht.errors import NoSurvivingSample, OptionError, refuse_unless_positive
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Estimate, Rollouts, weigh
from pirrht.estimation.sampling import Sampling
from pirrht.estimation.weights import log_weights
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch, Proposal, Tape
from pirrht.steering.in_time import homology_of
from pirrht.steering.motion import step_means
from pirrht.topology.signature import Signature

TerminalCost = Callable[[Array], Array]  # costs (k,) [cost] of states (k, n)

USUAL = Sampling(guide="open-loop", draws="independent", samples=600)


def follow_best(
    problem: Problem, estimate: Estimate, batch: Batch, shares: ClassShares, consistency: float
) -> Estimate:  # fmt: skip
    """Return the estimate by the best class alone, the one followed so far valued `consistency` times as much."""
    ids = list(batch.classes.values())
    values = class_values(problem, estimate)

    if shares.followed in ids:
        values[ids.index(shares.followed)] *= consistency
    best = int(np.argmin(values[: len(ids)]))
    shares.follow(ids[best])
    return alone(problem, estimate, best, {key: name for key, name in batch.classes.items() if name == ids[best]})


def class_values(problem: Problem, estimate: Estimate) -> Array:
    """Estimate v (H,) [cost] by the samples around each reference alone; infinite where none survived."""
    number = sum(np.diff(part.tables.first) for part in estimate.parts)
    sums = [np.logaddexp.reduceat(_own(problem, part), part.tables.first[:-1]) for part in estimate.parts]
    return np.asarray(-problem.temperature * (np.logaddexp.reduce(sums) - np.log(number)))


def alone(problem: Problem, estimate: Estimate, h: int, classes: Mapping[int, str] | None = None) -> Estimate:
    """Estimate v [cost], u (m,) and their errors by the samples around reference h alone; see `weigh`."""
    parts = []
    for part in estimate.parts:  # the others weigh nothing; each of these counts S / N_h times in a mean over all
        number = np.diff(part.tables.first)
        mine = np.repeat(np.arange(len(number)) == h, number)
        own = _own(problem, part) + np.log(part.size / max(number[h], 1))
        parts.append(replace(part, log_weight=np.where(mine, own, -np.inf)))
    return weigh(problem, parts, estimate.walls, classes)


def _own(problem: Problem, part: Rollouts) -> Array:
    """Return log weights (S,) as if there were no samples but those around their own reference."""
    number = np.diff(part.tables.first)
    averaged = log_weights(problem, "average", part.paths, part.tables.first)
    return np.asarray(averaged - np.repeat(np.log(part.size / (len(number) * number)), number))


class Mppi(Policy):
    """MPPI in place of `Controller`; OptionError if the horizon is not positive, or the samples follow guides.

    Args:
        problem: of the samples. One with more noise than the robot's explores more widely: as R stays, lambda grows
            with Sigma, which is how MPPI is tuned.
        sampling: `samples` counts all of a plan; they follow the control sequence. None: 600 independent ones.
        horizon: length of the control sequence [s].
        terminal_cost: costs (k,) [cost] from states (k, n) at the horizon to the goal; None: those of `terminal_costs`.
        terminal_costs: makes such costs of a free space, anew for every scene; None: a point's along shortest paths.
        homology, predict, deceleration, rng: see `Controller`.
    """

    def __init__(
        self, problem: Problem, space: FreeSpace, sampling: Sampling | None = None, *, horizon: float = 3.0,
        terminal_cost: TerminalCost | None = None, terminal_costs: Callable[[FreeSpace], TerminalCost] | None = None,
        homology: Signature | None = None, predict: ConstantVelocity | None = None, deceleration: float = 0.0,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        refuse_unless_positive(horizon, "the horizon", "it must be a positive number of seconds")
        sampling = sampling or USUAL
        if sampling.guide != "open-loop":
            raise OptionError("MPPI has no guides; give a Sampling with guide='open-loop'")
        self.rng, self.predict = rng, predict
        self.deceleration = deceleration
        self.terminal_costs = terminal_costs or (lambda space: cost_to_go(problem, shortest_paths(space)))
        self.terminal_cost = terminal_cost
        self._enter(problem, space, sampling, homology)
        self.times = self.path_integral.steps(horizon)
        self.begin(problem.dynamics.state_of(problem.scene.start))

    def _enter(
        self, problem: Problem, space: FreeSpace, sampling: Sampling, homology: Signature | None = None
    ) -> None:  # fmt: skip
        """Replace problem and space."""
        self.homology = homology or homology_of(problem, space)
        self.path_integral = path_integral(
            problem,
            space,
            sampling,
            terminal_cost=self.terminal_cost or self.terminal_costs(space),
            homology=self.homology,
        )

    def adopt(self, new: Renewed | None) -> None:
        """Continue in a scene that `renewed` has examined; None: in the last one."""
        if new is not None:
            problem, space, _ = new
            self._enter(problem, space, self.path_integral.sampling)
            map_update.continue_among(space, self.run)

    def __repr__(self) -> str:
        scene, of = formatting.name(self.space.scene.name), type(self.problem.dynamics).__name__
        horizon = float(self.times[-1])
        return f"Mppi(for a {of} in {scene}: {self.path_integral.sampling.samples} samples, horizon {horizon:.3g} s)"

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the run so far; a new one starts at x (n,) at a time [s], from controls of zero (T, m)."""
        super().begin(x, time)
        self._tape = np.zeros((len(self.times) - 1, self.problem.dynamics.m))

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,); without a survivor the control sequence goes on."""
        run, x = self.run, self._state(x)
        self._update_prediction(x, TimeBudget())
        tape = step_means(self._tape, np.diff(self.times), self.times, self.times + run.clock.since_plan)
        proposal = Proposal(lead=Tape(self.times, tape), count=self.path_integral.sampling.samples)
        batch = Batch(state=x, times=self.times, proposals=(proposal,), time=run.now)
        try:
            estimate = self.path_integral.sample(batch, int(self.rng.integers(2**63)), left=left)
            run.plan()
        except NoSurvivingSample:
            estimate = None
            run.clock.planned(estimated=False)
        plan = Plan(
            state=x, times=self.times, references=(), ids=(), estimate=estimate, replay=self.path_integral.replay,
            fallback="no survivor" if estimate is None else None, instead=tape if estimate is None else None,
            time=run.clock.time, space=self.space, dynamics=self.problem.dynamics, movers=run.route.movers,
        )  # fmt: skip
        self._tape = plan.tape
        return self.governed(plan)

    def governed(self, plan: Plan) -> Plan:
        """Return a plan whose controls keep to speeds from which the robot can stop, among static obstacles."""
        return governed(
            plan, self.problem.dynamics, self.space.static, self.deceleration, now=self.run.now, blind=self.blind
        )
