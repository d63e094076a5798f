"""State of a run: values with one owner each; changes that belong together are its methods."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import ClassMixture, Law
from pirrht.control.prediction import Prediction
from pirrht.estimation.estimate import Allocation
from pirrht.geometry.obstacle import Mover
from pirrht.planner.references import Reference
from pirrht.proposals.desirability_grid import DesirabilityGrid
from pirrht.proposals.fitted_law import LawFit
from pirrht.proposals.guide import DDPGuide
from pirrht.steering.motion import Motions
from pirrht.topology.driven import Driven
from pirrht.topology.signature import Signature, integers

ClassFromStart = tuple[int, ...]  # class of the driven path and the path ahead together
K = TypeVar("K")
V = TypeVar("V")


@dataclass(slots=True)
class Clock:
    """Times of a run, on the clock of the moving obstacles [s]."""

    time: float
    begun: float  # when it started
    known: float  # until when states are observed, not only expected
    since_plan: float = 0.0  # time since the last plan
    since_estimate: float = 0.0  # time since the last plan of which samples survived

    @property
    def first(self) -> bool:
        """Check whether no time has passed since the run began."""
        return self.time <= self.begun

    def passed(self, duration: float) -> None:
        """Let time [s] pass."""
        self.time += duration
        self.since_plan += duration
        self.since_estimate += duration

    def observed(self, until: float | None = None) -> None:
        """Note that all is observed until a time [s]; None: now."""
        self.known = self.time if until is None else until

    def planned(self, *, estimated: bool) -> None:
        """Note a plan; `estimated`: its samples survived."""
        self.since_plan = 0.0
        if estimated:
            self.since_estimate = 0.0


@dataclass(slots=True)
class WarmStarts:
    """Keeps what plans leave for the next to begin from, by class from the start of the run."""

    paths: dict[ClassFromStart, Motions] = field(default_factory=dict)  # last references: shortening goes on from there
    optima: dict[ClassFromStart, list[DDPGuide]] = field(default_factory=dict)  # last valid guides, best first
    fits: dict[ClassFromStart, LawFit] = field(default_factory=dict)  # laws around them, as samples have it
    sampled: set[ClassFromStart] = field(default_factory=set)  # classes whose guides had more than a few samples
    grids: dict[ClassFromStart, DesirabilityGrid] = field(default_factory=dict)  # log psi in space

    def keep_paths(self, paths: Mapping[ClassFromStart, Motions], *, all_of_them: bool) -> None:
        """Keep the paths of a plan's references; unless those are all of them, earlier ones of other classes too."""
        self.paths = ({} if all_of_them else self.paths) | {**paths}

    def keep_optima(self, found: Mapping[ClassFromStart, list[DDPGuide]]) -> None:
        """Keep the local optima of classes whose best one is valid."""
        self.optima = {one: some for one, some in found.items() if some and some[0].valid}

    def fitted(self, one: ClassFromStart, elapsed: float, *, timed: bool) -> DDPGuide | None:
        """Return the law around the guide of a class that samples of earlier plans suggest, if there are any."""
        if one not in self.fits or one not in self.optima:
            return None
        if self.fits[one].guide is not self.optima[one][0]:
            self.fits[one] = self.fits[one].carried(self.optima[one][0], elapsed, timed=timed)
        return self.fits[one].followed

    def forget(self) -> None:
        """Forget guides and samples, but no path."""
        self.optima = {}
        self.fits = {}
        self.sampled = set()

    def renamed(self, heirs: Mapping[ClassFromStart, ClassFromStart]) -> "WarmStarts":
        """Return what remains among other obstacles, by present classes of paths that are free."""
        sampled = {heirs[one] for one in self.sampled & heirs.keys()}
        return WarmStarts(kept(self.paths, heirs), kept(self.optima, heirs), kept(self.fits, heirs), sampled)


@dataclass(slots=True)
class Retries:
    """When classes without a guide are tried anew, by name."""

    plans: int = 0  # that improved guides
    due: dict[str, int] = field(default_factory=dict)  # first plan that tries a class anew

    def count(self) -> int:
        """Count a plan that improves guides; return how many there were with it."""
        self.plans += 1
        return self.plans

    def waits(self, name: str) -> bool:
        """Check whether a class is not to be tried anew yet."""
        return self.plans < self.due.get(name, 0)

    def postpone(self, name: str, plans: int) -> None:
        """Try a class anew after so many plans, unless it waits already."""
        if not self.waits(name):
            self.due[name] = self.plans + plans


@dataclass(slots=True)
class ClassShares:
    """Keeps what classes have contributed, by name."""

    allocation: Allocation = field(default_factory=Allocation)  # of samples, by what earlier ones contributed
    mixture: ClassMixture | None = None  # feedback of the last plan, into which the next one is pooled
    followed: str | None = None  # name of the one class that the control follows; None: all

    def follow(self, name: str) -> None:
        """Follow one class; feedback of another is forgotten."""
        if self.followed != name:
            self.followed = name
            self.mixture = None

    def forget(self) -> None:
        """Forget samples, but not which class is followed."""
        self.allocation = Allocation()
        self.mixture = None

    def renamed(self, names: Mapping[str, str]) -> "ClassShares":
        """Return what remains among other obstacles, by present names of classes whose paths are free."""
        allocation = Allocation(kept(self.allocation.contribution, names), kept(self.allocation.shares, names))
        return ClassShares(allocation, followed=names.get(self.followed or ""))


@dataclass(slots=True)
class PlanEffort:
    """Tells what the next plan has time and samples for."""

    most: int | None = None  # classes that it has time for; None: all
    fitting: float = 0.0  # time that the last plan took to fit laws to its samples [s]
    weak: bool = False  # whether the last plan had too few effective samples not to learn from them
    saved: float = 0.0  # samples for weak plans, in multiples of a plan's

    def save(self, share: float, most: float) -> float:
        """Save samples of a plan for weak ones, up to so many; return what is saved."""
        self.saved = min(self.saved + share, most)
        return self.saved

    def spend(self, drawn: float | None) -> None:
        """Take what a plan drew, in multiples of its own, off what is saved; None: it drew all, in vain."""
        self.saved = 0.0 if drawn is None else max(0.0, self.saved + 1.0 - drawn)

    def renewed(self) -> "PlanEffort":
        """Return what remains among other obstacles."""
        return PlanEffort(self.most, self.fitting)


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


@dataclass(slots=True)
class Route:
    """The path driven so far and the one ahead, among moving obstacles as they are predicted."""

    homology: Signature  # of the paths ahead, in the prediction if there is one
    path: Driven  # driven so far, which gives classes their names
    movers: tuple[Mover, ...]  # moving obstacles as predicted, on the run's clock
    prediction: Prediction | None = None  # of moving obstacles; None: their motions are known
    favourite: Array | None = None  # path ahead of the last plan's favourite, (k, d + 1) [m, s] on the run's clock

    @property
    def since(self) -> float:
        """Start of the prediction's clock [s]."""
        return 0.0 if self.prediction is None else self.prediction.since

    def enter(self, homology: Signature) -> None:
        """Continue among other static obstacles."""
        self.path.enter(homology)
        self.homology = homology

    def predict(self, after: Prediction, x: Array, time: float) -> None:
        """Continue from x (n,) at a time [s] under another prediction; the class of the path ahead keeps its name."""
        before = self.prediction
        offset = np.zeros(0)
        path = after.homology.at(x, time)[None]

        if before is not None:
            if self.favourite is not None:
                path = np.vstack([path, self.favourite[self.favourite[:, -1] > time]])
            clock = np.eye(path.shape[1])[-1]
            turns = [one.homology.winding(path - one.since * clock) for one in (before, after)]
            offset = np.array(self.path.winding()) + turns[0] - turns[1]
        self.prediction = after
        self.homology = after.homology
        self.movers = tuple(replace(m, motion=m.motion.after(-after.since)) for m in after.space.scene.movers)
        self.path = Driven(after.homology, x, time - self.since, offset)


@dataclass(slots=True, eq=False)
class RunState:
    """State of a run: its parts, and what no part owns."""

    clock: Clock
    route: Route
    starts: WarmStarts = field(default_factory=WarmStarts)
    retries: Retries = field(default_factory=Retries)
    shares: ClassShares = field(default_factory=ClassShares)
    effort: PlanEffort = field(default_factory=PlanEffort)
    queried: Array | None = None  # state (n,) of a plan since which no time has passed
    planned: bool = False  # whether there has been a plan
    held: float | None = None  # how long the control of the last step is held [s]; None: there is none
    halt: Halt | None = None  # brake that the robot waits by; None: it is not blocked

    @classmethod
    def begin(cls, homology: Signature, x: Array, time: float, movers: tuple[Mover, ...]) -> "RunState":
        """Begin a run from x (n,) at a time [s] of the moving obstacles' clock."""
        return cls(Clock(time, begun=time, known=time), Route(homology, Driven(homology, x, time), movers))

    @property
    def now(self) -> float:
        """Time on the prediction's clock [s]."""
        return self.clock.time - self.route.since

    def passed(self, duration: float) -> None:
        """Let time [s] pass."""
        self.queried = None
        self.clock.passed(duration)

    def plan(self) -> None:
        """Note a plan whose samples survived."""
        self.planned = True
        self.halt = None
        self.clock.planned(estimated=True)

    def wait(self, halt: Halt | None) -> None:
        """Note a plan that brakes; guides and samples of earlier ones are forgotten."""
        self.halt = halt
        self.clock.planned(estimated=False)
        self.starts.forget()
        self.shares.forget()

    def rename(self, heirs: Mapping[ClassFromStart, ClassFromStart], names: Mapping[str, str]) -> None:
        """Keep what remains among other obstacles, by present classes of paths that are free, and their names."""
        self.starts = self.starts.renamed(heirs)
        self.retries = Retries()
        self.shares = self.shares.renamed(names)
        self.effort = self.effort.renewed()


def from_start(run: RunState, references: Sequence[Reference]) -> list[ClassFromStart]:
    """Return the classes of the driven path and each reference together."""
    driven = run.route.path.winding()
    return [integers(np.add(driven, one.winding)) for one in references]
