"""Settings of a sampler."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from pirrht.errors import OptionError

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
        least: effective samples of the first plan of a run, with 64 N samples at most.
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
        choices = {"exit": EXITS, "steps": STEPS, "weights": WEIGHTS, "guide": GUIDES}
        for name, known in (choices | {"allocation": ALLOCATIONS, "draws": DRAWS}).items():
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

    @property
    def most(self) -> int:
        """Samples around each reference at most, under a target."""
        return 16 * self.samples if self.budget is None else self.budget
