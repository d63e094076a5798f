"""Interface of all policies, and the state of a run: path, clocks, prediction, and what plans leave for the next."""

from __future__ import annotations

import reprlib
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, replace
from numbers import Real
from typing import TypeVar

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import ClassMixture, Law, Plan
from pirrht.control.prediction import ConstantVelocity, Prediction
from pirrht.control.settings import TimeBudget
from pirrht.errors import OptionError, refuse_unless_positive
from pirrht.estimation.estimate import Allocation
from pirrht.estimation.sampler import PathIntegral
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.fitted_law import LawFit
from pirrht.proposals.guide import DDPGuide
from pirrht.steering.motion import Motions
from pirrht.topology.homology import Driven, Homology
from pirrht.topology.signature import class_id, integers

ClassFromStart = tuple[int, ...]  # class of the driven path and the path ahead together
K = TypeVar("K")
V = TypeVar("V")


@dataclass(slots=True)
class ClassMemory:
    """Memory of the plans of a run, by class from its start: the winding, or the name of it."""

    paths: dict[ClassFromStart, Motions] = field(default_factory=dict)  # last references: shortening goes on from there
    optima: dict[ClassFromStart, list[DDPGuide]] = field(default_factory=dict)  # last valid guides, best first
    fits: dict[ClassFromStart, LawFit] = field(default_factory=dict)  # laws around them, as samples have it
    sampled: set[ClassFromStart] = field(default_factory=set)  # classes whose guides had more than a few samples
    allocation: Allocation = field(default_factory=Allocation)  # of samples, by what earlier ones contributed
    mixture: ClassMixture | None = None  # feedback of the last plan, into which the next one is pooled
    followed: str | None = None  # name of the one class that the control follows; None: all
    guided: int = 0  # plans that improved guides
    again: dict[str, int] = field(default_factory=dict)  # first plan that tries a class without a guide anew, by name
    weak: bool = False  # whether the last plan had too few effective samples not to learn from them
    saved: float = 0.0  # samples for weak plans, in multiples of a plan's

    def waits(self, name: str) -> bool:
        """Check whether a class without a guide, by name, is not to be tried anew yet."""
        return self.guided < self.again.get(name, 0)

    def forget(self) -> None:
        """Forget guides and samples, but no path."""
        self.optima = {}
        self.fits = {}
        self.sampled = set()

        self.allocation, self.mixture = Allocation(), None

    def renamed(self, heirs: Mapping[ClassFromStart, ClassFromStart], names: Mapping[str, str]) -> ClassMemory:
        """Return what remains among other obstacles, by present classes of paths that are free, and their names."""
        allocation = Allocation(kept(self.allocation.contribution, names), kept(self.allocation.shares, names))
        sampled = {heirs[one] for one in self.sampled & heirs.keys()}

        paths = kept(self.paths, heirs)
        optima = kept(self.optima, heirs)
        followed = names.get(self.followed or "")

        return ClassMemory(paths, optima, kept(self.fits, heirs), sampled, allocation, followed=followed)


def kept(known: Mapping[K, V], heirs: Mapping[K, K]) -> dict[K, V]:
    """Rename classes to what they are now; of several that became one, keep the first."""
    return {heirs[one]: value for one, value in reversed([*known.items()]) if one in heirs}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Halt:
    """A law that brakes, or follows the longest free path, and its outcome."""

    law: Law
    times: Array  # ends of steps, (T+1,) [s]
    tape: Array  # controls of those steps without noise, (T, m)
    static_clearance: float  # from static obstacles once it has settled, at most the sufficient one [m]
    free: float  # how long it touches nothing [s]; infinite if that is beyond the horizon
    clearance: float  # the least within the horizon, once it has settled [m]


@dataclass(slots=True, eq=False)
class RunState:
    """State of a run from x (n,) at a time [s] of the moving obstacles' clock."""

    homology: Homology  # of the paths ahead, in the prediction if there is one
    x: InitVar[Array]
    time: float = 0.0  # of the run and of moving obstacles [s]
    movers: tuple[Mover, ...] = ()  # moving obstacles as predicted, on the run's clock
    path: Driven = field(init=False)  # driven so far, which gives classes their names
    begun: float = field(init=False)  # when it started [s]
    known: float = field(init=False)  # until when states are observed, not only expected [s]
    since_plan: float = 0.0  # time since the last plan [s]
    since_estimate: float = 0.0  # time since the last plan of which samples survived [s]
    fitting: float = 0.0  # time that the last plan took to fit laws to its samples [s]
    queried: Array | None = None  # state (n,) of a plan since which no time has passed
    planned: bool = False  # whether there has been a plan
    held: float | None = None  # how long the control of the last step is held [s]; None: there is none
    prediction: Prediction | None = None  # of moving obstacles; None: their motions are known
    halt: Halt | None = None  # brake that the robot waits by; None: it is not blocked
    favourite: Array | None = None  # path ahead of the last plan's favourite, (k, 3) [m, m, s] on the run's clock
    most: int | None = None  # classes that the next plan has time for; None: all
    memory: ClassMemory = field(default_factory=ClassMemory)  # of plans, by class

    def __post_init__(self, x: Array) -> None:
        self.path, self.begun, self.known = Driven(self.homology, x, self.time), self.time, self.time

    @property
    def since(self) -> float:
        """Start of the prediction's clock [s]."""
        return 0.0 if self.prediction is None else self.prediction.since

    @property
    def now(self) -> float:
        """Time on the prediction's clock [s]."""
        return self.time - self.since

    def passed(self, duration: float) -> None:
        """Let time [s] pass."""
        self.queried, self.time = None, self.time + duration
        self.since_plan = self.since_plan + duration
        self.since_estimate = self.since_estimate + duration

    def set_prediction(self, after: Prediction, x: Array) -> None:
        """Continue from x (n,) under another prediction; the class of the path ahead keeps its name."""
        before = self.prediction
        offset = np.zeros(0)
        path = np.array([[*x[:2], self.time]])

        if before is not None:
            if self.favourite is not None:
                path = np.vstack([path, self.favourite[self.favourite[:, 2] > self.time]])
            turns = [one.homology.winding(path - [0.0, 0.0, one.since]) for one in (before, after)]
            offset = np.array(self.path.winding()) + turns[0] - turns[1]
        self.prediction, self.homology = after, after.homology
        self.movers = tuple(replace(m, motion=m.motion.after(-after.since)) for m in after.space.scene.movers)
        self.path = Driven(after.homology, x, self.now, offset)


def from_start(run: RunState, references: Sequence[Reference]) -> list[ClassFromStart]:
    """Return the classes of the driven path and each reference together."""
    driven = run.path.winding()
    return [integers(np.add(driven, one.winding)) for one in references]


class Policy(ABC):
    """A feedback law that replans during a run: `Controller`, `Mppi` or `Optimal`."""

    path_integral: PathIntegral  # sampler of the problem
    homology: Homology  # classes of references and runs
    tree: HomologyTree | None = None  # None: it needs none
    predict: ConstantVelocity | None = None  # None: motions are known
    run: RunState  # of the run under way

    @property
    def problem(self) -> Problem:
        """Problem that the samples are of."""
        return self.path_integral.problem

    @property
    def space(self) -> FreeSpace:
        """Free space of the scene, with its moving obstacles."""
        return self.path_integral.space

    @abstractmethod
    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,); samples are drawn until `left`, the time left for it [s], is up."""

    def step(self, x: Array, dt: float) -> Array:
        """Observe the last step, plan at x (n,) and return the control (m,) that will be held for the next dt [s].

        Raises:
            OptionError: dt is not positive.
            NoReference: no class reaches the goal from where the run begins.

        Examples:
            A loop of your own; `begin(x)` starts another run:

            >>> while not arrived:  # doctest: +SKIP
            ...     u = controller.step(robot.state, 0.02)
            ...     robot.drive(u, 0.02)
        """
        refuse_unless_positive(dt, "dt", "a control is held for a positive number of seconds")
        x = self._checked(x)
        if self.run.held is not None:
            self.observe(x[None], self.run.held)
        plan = self.plan(x)
        self.run.held = dt
        return plan.control

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the run so far; a new one starts at x (n,), at a time of the moving obstacles' clock [s].

        OptionError: x is no state, or the time no number.
        """
        if not (isinstance(time, Real) and np.isfinite(time)):
            raise OptionError(f"the time is {time!r}; a run begins at a number of seconds, such as 0")
        self.run = RunState(self.homology, self._checked(x), float(time), self.space.scene.movers)
        if self.predict is not None:
            self.predict.begin()

    def observe(self, states: Array, duration: float, until: float | None = None) -> None:
        """Record the states (k, n) just driven through and the time it took [s], `until` a time [s]; None: now."""
        run = self.run
        run.passed(duration)
        run.known = run.time if until is None else until
        run.path.observe(states, run.known - run.since)

    def expect(self, states: Array, duration: float) -> None:
        """Plan for the end of states (k, n) driven through next, in `duration` [s]; observations replace them."""
        self.run.passed(duration)
        self.run.path.expect(states, self.run.now)

    def driven_class(self) -> tuple[int, ...]:
        """Return the class (M,) of the driven path, completed by a straight line to the goal point [turns]."""
        return self.run.path.winding()

    def driven_id(self) -> str:
        """Return the name of the class of the driven path, as tables print it: "1,0" for `driven_class` (1, 0)."""
        return class_id(self.driven_class(), self.homology.named)

    def _checked(self, x: Array) -> Array:
        """Return a state (n,) as numbers; OptionError if it is none."""
        d = self.problem.dynamics
        try:
            state = np.asarray(x, dtype=float)
        except (TypeError, ValueError):
            raise OptionError(f"the state is {reprlib.repr(x)}; it must be {d.n} numbers") from None
        if state.shape != (d.n,):
            moves = f"{type(d).__name__} ({', '.join(d.states)})"
            raise OptionError(f"the state has the shape {state.shape}; {moves} has {d.n} numbers")
        if not np.all(np.isfinite(state)):
            raise OptionError(f"the state is {state.tolist()}; all of it must be finite numbers")
        return state

    def _state(self, x: Array) -> Array:
        """Return the state (n,) of a plan as numbers; warn if it is not that of the last, and nothing was observed.

        OptionError: it is no state, lies in the goal or outside the workspace.
        """
        x = self._checked(x)
        last = self.run.queried
        scene = self.space.scene
        place = self.problem.dynamics.place(x)
        for lost, where in (
            (scene.goal.contains(place), "already in the goal"),
            (not scene.world.contains(place), "outside the workspace"),
        ):
            if lost:
                raise OptionError(
                    f"a plan at ({place[0]:.4g}, {place[1]:.4g}) is {where}; no control leads on from there"
                )
        if last is not None and not np.array_equal(x, last):
            warnings.warn(
                f"a plan at ({x[0]:.4g}, {x[1]:.4g}) after one at ({last[0]:.4g}, {last[1]:.4g}), and nothing was "
                "observed in between: call step(x, dt) for each control, or observe(states, dt) after it; begin(x) if "
                "this is another run",
                RuntimeWarning, stacklevel=3,
            )  # fmt: skip
        self.run.queried = x
        return x

    def _update_prediction(self, x: Array, budget: TimeBudget) -> None:
        """Update the prediction of moving obstacles at x (n,), for the run, the samples and the tree."""
        if self.predict is None:
            return
        prediction = self.predict.at(x, self.run.known, None if budget.left is None else budget.enough)
        if prediction is not self.run.prediction:
            self.run.set_prediction(prediction, x)
            self.path_integral.set_prediction(prediction.space.moving, prediction.homology)
            self.tree = self.tree and prediction.tree
