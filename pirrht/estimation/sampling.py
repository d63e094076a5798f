"""Settings of a sampler, and the numbers that tune the estimator."""

from dataclasses import dataclass, fields
from numbers import Real
from typing import NamedTuple

import numpy as np

from pirrht.errors import OptionError


class EstimationTuning(NamedTuple):
    """Numbers that trade accuracy of estimates against time; found on random scenes and drives unless stated."""

    tail: float = 40.0  # paths are cut at the cheapest reference plus so many lambda: exp(-40) is below rounding
    parallel: int = 4096  # samples that several threads weigh: waking a thread takes as long as weighing so many
    replayed: int = 2048  # samples simulated again at once: their states and controls take memory
    negligible: float = 1e-6  # weights below this add nothing to a control sequence, so that few samples are replayed

    filled: float = 0.6  # share of the time left for the next round of samples; the rest is for rounds that take longer
    first_round: float = 0.1  # share of samples drawn first by the clock in a world that changes: the rest takes time
    first_plan: int = 64  # multiple of a plan's samples for the first plan of an episode, at most (`Sampling.least`)
    saved: float = 12.0  # multiples of a plan's samples that later plans save for those below `few` effective samples
    later_plan: float = 24.0  # multiple of a plan's samples for a later plan of an episode, at most
    most: int = 150_000  # samples of a plan at any time limit: weighing more takes longer than it is worth
    # Allocation
    plans: float = 5.0  # contributions are averaged over about so many plans; more lag behind a robot that moves
    least_share: float = 0.15  # of N for every class worth it, and of a class for each proposal; lets others recover
    fewest: int = 8  # samples that every reference gets, if N allows: enough to notice a class that becomes worth more
    hopeless: float = 16.0  # nats below another class from which a class gets few samples: less than a sample's weight

    least_step: float = 1.0 / 300.0  # share of a step that is split, at least: the bias of larger steps is negligible
    least_move: float = 0.01  # among moving obstacles, share of the robot's radius by which the shortest step moves
    rim: float = 0.2  # share of the goal's radius that is left where its rim is set back for exits at ends of steps
    bend: float = 1e-3  # bends of a path below this are dropped; a path that cuts corners by more leads into them [m]

    few: float = 10.0  # effective samples below which standard errors are unreliable
    lone: float = 1.5  # effective samples of a class in which hardly more than one sample has any weight
    # Largest terms of a sum count so many times more in its error, as larger ones are likely unseen. With 0 a twentieth
    # of plans near walls is off by more than 3 errors.
    outlying: float = 4.0
    tail_weights: int = 25  # weights from which on the tail's shape is estimated (Vehtari et al. 2024, as the next six)
    tail_share: float = 0.2  # the tail is the smaller of this share of all weights
    tail_roots: float = 3.0  # and of so many roots of their number
    prior_shape: float = 0.5  # prior of the shape
    prior_weight: int = 10  # its weight in samples
    heavy: float = 0.7  # shape from which on errors are unreliable
    step_bias: float = 1.5e-3  # of a whole step's cost q dt, by which v is off; found by `calibration --part car`


TUNING = EstimationTuning()


class Effort(NamedTuple):
    """Say how many samples a plan draws for how many effective ones."""

    least: float = 0.0  # effective samples up to which more are drawn; 0: no more
    multiple: float = 1.0  # of the batch that is drawn, at most


ONCE = Effort()

EXITS = ("bridge", "endpoint")
WEIGHTS = ("balance", "average", "biased")
GUIDES = ("feedback", "open-loop")
ALLOCATIONS = ("contribution", "equal")
DRAWS = ("antithetic", "independent")
STEPS = ("fitted", "uniform")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampling:
    """Settings of drawing and weighing paths.

    Attributes:
        dt: rollout step [s].
        steps: with exit along the step, steps of dt are "fitted" to the place, split near walls and goal (without noise
            on the position they are whole, and it moves as in continuous time), or "uniform" (paper).
        first: with exit along the step, the first dt is split into steps of this length [s].
        samples: N, around each reference.
        exit: first exit judged along the step ("bridge") or at its end ("endpoint", the paper's).
        weights: "balance" heuristic, plain "average" (the paper's), or "biased": no likelihood ratio (Biased-MPPI).
        guide: "feedback": samples of a point climb psi of their class, those of other systems follow a guide; or they
            follow the controls of their reference "open-loop" (paper).
        window: under feedback the control now is averaged over so long [s] where walls and goal are far.
        draws: "antithetic" pairs of samples with opposite noise, or "independent" ones (the paper's).
        target: sample on until the control's standard error is no larger [control]: consistent, not unbiased.
        least: effective samples of the first plan of a run, with 64 N samples at most. Later plans that follow guides
            draw up to 24 times as many below 10, at most 4 times as many on average. 0: plans draw no more.
        budget: with a target, samples around each reference at most; None: 16 N.
        allocation: of samples: by "contribution" of references in earlier plans, or "equal" (paper).
        threads: None for all cores this process may use; results do not depend on it.

    Raises:
        OptionError: a number is out of range, or a choice is unknown.

    Examples:
        >>> from pirrht import Sampling
        >>> Sampling()
        Sampling(defaults)
        >>> Sampling(samples=1000, dt=0.05)
        Sampling(dt=0.05, samples=1000)
    """

    dt: float = 0.1
    steps: str = "fitted"
    first: float | None = None
    samples: int = 200
    exit: str = "bridge"
    weights: str = "balance"
    guide: str = "feedback"
    window: float = 0.4
    draws: str = "antithetic"
    target: float | None = None
    least: float = 0.0
    budget: int | None = None
    allocation: str = "contribution"
    threads: int | None = None

    def __repr__(self) -> str:
        other = [f"{f.name}={getattr(self, f.name)!r}" for f in fields(self) if getattr(self, f.name) != f.default]
        return f"Sampling({', '.join(other) or 'defaults'})"

    def __post_init__(self) -> None:
        for name in ("dt", "first", "samples", "window", "target", "least", "budget", "threads"):
            value = getattr(self, name)
            if not (isinstance(value, Real) or (value is None and name in ("first", "target", "budget", "threads"))):
                raise OptionError(f"{name} is {value!r}; it must be a number")
        enough = self.budget is None or (self.target is not None and self.budget >= self.samples)
        for name, valid, rule in (
            ("dt", 0 < self.dt < np.inf, "it must be a positive number of seconds"),
            ("first", self.first is None or self.first > 0, "it must be a positive number of seconds"),
            ("window", 0 <= self.window < np.inf, "it must be a number of seconds"),
            ("target", self.target is None or self.target > 0, "it must be a positive standard error of the control"),
            ("budget", enough, f"it needs a target and at least the {self.samples} samples"),
            ("samples", self.samples >= 1, "at least 1 is needed"),
        ):
            if not valid:
                value = getattr(self, name)
                raise OptionError(f"{name} is {value if isinstance(value, int) else format(value, 'g')}; {rule}")
        for name, known in (
            ("exit", EXITS), ("steps", STEPS), ("weights", WEIGHTS), ("guide", GUIDES), ("allocation", ALLOCATIONS),
            ("draws", DRAWS),
        ):  # fmt: skip
            if getattr(self, name) not in known:
                raise OptionError(f"{name} is {getattr(self, name)!r}; it must be one of {', '.join(known)}")

    @property
    def first_dt(self) -> float:
        """Length of the steps that the first dt is split into [s]; dt with exits at ends of steps."""
        return self.dt if self.first is None or self.exit == "endpoint" else self.first

    @property
    def fitted(self) -> bool:
        """Check whether steps are split near walls and goal, or turn; not with exits at their ends."""
        return self.exit == "bridge" and self.steps == "fitted"
