"""Methods of control, their settings, the numbers that control is tuned by, and the time that a plan has.

All methods steer one robot under the noise of one plant, and those with samples draw them with the same kernels and
exit rule. Around each of H references there are N samples; "best-class" has as many in all, and "single", "passive" and
"mppi" are given N times the classes that are allowed at the start (sim), at least as many."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

from pirrht.errors import OptionError

BETWEEN = ("classes", "hold")


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """Use of the references at a state and of the samples around them by `Controller`, and one line for a person."""

    text: str
    most: int | None = None  # references that are sampled around, cheapest first; None: all
    alone: bool = False  # the control is that of the best class, each estimated from its own samples
    pursues: bool = False  # there are no samples: the cheapest reference is followed

    @property
    def mixes(self) -> bool:
        """Check that samples around several references make one estimate."""
        return self.most is None and not self.alone


SAMPLING = {
    "pi-rrht": Method(text="sample around one reference per homology class and let the weights decide (PI-RRHT*)"),
    "best-class": Method(
        text="estimate each class from its own samples and follow only the best (as teb_local_planner, T-MPC)",
        alone=True,
    ),
    "single": Method(text="importance sampling around the cheapest reference only", most=1),
    "pursuit": Method(text="no samples: pure pursuit of the cheapest reference (Coulter 1992)", most=1, pursues=True),
    "passive": Method(text="no reference: sample the passive dynamics", most=0),
}
METHODS = {name: method.text for name, method in SAMPLING.items()} | {
    "mppi": "no reference: one warm-started control sequence, then the shortest path (Williams et al. 2017)",
    "optimal": "no samples: the optimal feedback law, solved for on a grid (class Optimal)",
}
TREELESS = ("passive", "mppi", "optimal")
WITHOUT_SAMPLES = ("pursuit", "optimal")


class ControlTuning(NamedTuple):
    """Numbers that control is tuned by; times are in seconds, log weights in nats."""

    # Time budget of a plan
    short: float = 0.3  # share of the time left below which time is short; less leaves too few samples, by runs
    regrown: float = 0.6  # share left at which growth of a new tree of `few_vertices` stops, so that sampling follows
    few_vertices: int = 100  # vertices of a tree that usually has all classes of the bundled scenes
    before_samples: float = 0.6  # share for guides and references; more of it leaves too few samples
    mapping: float = 0.015  # time that a plan leaves to the map that is examined meanwhile
    standing: float = 1.0  # time that guides of a robot that has stood for lack of them may take in addition
    stuck: float = 2.0  # for which it has: a first guide that is found at all by the clock is found in less
    # Mixture of classes between plans
    memory: float = 0.03  # time constant of earlier samples, 0 for none; longer averages noise, but u_c changes
    stale: float = 0.05  # time after which the gradient of a class without samples is no longer trusted
    bound: float = 2.0  # earlier plans count at most exp(bound) times as much as the last; bounds wrong gradients
    faded: float = 25.0  # classes so far behind add nothing to a control in double precision, and are forgotten
    # Prediction at constant velocity
    deviation: float = 0.005  # distance from a prediction that contradicts it [m]; less replans at every rounding
    deviation_ahead: float = 1.0  # time after which a velocity may make ten times that deviation
    crossings: float = 2.0  # horizon in times to cross the workspace at the best speed; longer than runs that arrive
    # Trees and first plans of a run
    elsewhen: float = 0.1  # a run that begins so much later than its tree assumes regrows it
    regrowth: int = 400  # vertices that such a tree gains, about a third of a usual one
    growth: float = 0.1  # share of its vertices that the tree of a map gains while it holds no path
    unreached: float = 4.0  # times its vertices at most
    kept: float = 0.8  # most vertices of an updated tree that are those of the last, as a share: others are new draws
    thorough: int = 4  # cheapest classes whose first guides are improved from all initialisations; each takes 10 ms
    off_walls: float = 0.01  # clearance of a plan that begins in the safety margin, in radii of the robot
    # Shortest paths of MPPI's terminal cost
    path_radii: float = 0.1  # spacing of their grid in radii of the robot: passages are judged to half of it
    path_points: float = 1e6  # points of that grid at most, in a tenth of a second or so
    # Decisions
    decided: float = 0.9  # share of a decision; under the exact law shares are martingales, so 1 in 9 is reversed


TUNING = ControlTuning()


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlSettings:
    """Choices of a `Controller`; an OptionError is raised if the method or the feedback is unknown."""

    method: str = "pi-rrht"
    shortened: bool = True  # shorten references inside their class
    consistency: float = 0.8  # factor on the value of the class followed so far under "best-class"
    look_ahead: float = 0.6  # distance to the point of a path that "pursuit" steers to [m]
    held: float | None = None  # time for which the plant holds a control between plans [s]; None: it does not
    between: str = "classes"  # until the next plan follow the state by "classes", or "hold" the control (paper)
    tuning: ControlTuning = TUNING

    def __post_init__(self) -> None:
        if self.between not in BETWEEN:
            raise OptionError(f"unknown feedback {self.between!r} between plans; known are {', '.join(BETWEEN)}")
        if self.method not in SAMPLING:
            raise OptionError(f"unknown method {self.method!r}; known here are {', '.join(SAMPLING)}")

    @property
    def use(self) -> Method:
        """Use of references and samples by the method."""
        return SAMPLING[self.method]


class TimeBudget:
    """Time that one plan may take, by what returns the time `left` for sampling [s]; None: it is unlimited.

    While there is no guide they may take some time [s] in `addition`, and the plan is late.
    """

    def __init__(
        self, left: Callable[[], float] | None = None, tuning: ControlTuning = TUNING, *, addition: float = 0.0
    ) -> None:
        self.left, self.tuning, self.whole = left, tuning, inf if left is None else left()
        self.addition = addition

    def less(self, taken: float) -> Callable[[], float]:
        """Return what tells the time left [s] if so much of it is kept back."""
        return lambda: (inf if self.left is None else self.left()) - taken

    @property
    def spent(self) -> float:
        """Time spent so far [s]; 0 without a limit."""
        return 0.0 if self.left is None else self.whole - self.left()

    def short(self, more: float = 0.0) -> bool:
        """Check that little time is left, if there is so much more of it [s]."""
        return self.left is not None and self.left() + more < self.tuning.short * (self.whole + more)

    def enough(self, vertices: int) -> bool:
        """Check that a tree of so many vertices must do for lack of time."""
        share = self.tuning.regrown if vertices >= self.tuning.few_vertices else self.tuning.short
        return self.left is not None and self.left() < share * self.whole

    def most_classes(self, classes: int) -> int | None:
        """Return the number of classes that the next plan has time for, by that of one about to sample; None: all."""
        if self.left is None:
            return None
        taken = max(self.whole - self.left(), 1e-6)  # clocks may stop
        return max(1, int(classes * self.tuning.before_samples * self.whole / taken))
