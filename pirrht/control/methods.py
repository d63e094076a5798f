"""Methods of control: how each uses references and samples.

All steer the same robot under the same noise of the plant, and those with samples draw them with the same kernels and
exit rule. Around each of H references there are N samples; "best-class" has as many in all, and "single", "passive" and
"mppi" are given N times the classes that are allowed at the start (sim), at least as many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pirrht.planner.references import Reference


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """Use of the references at a state and of the samples around them by `Controller`."""

    text: str  # one line for a person
    most: int | None = None  # references that are sampled around, cheapest first; None: all
    alone: bool = False  # the control is that of the best class, each estimated from its own samples

    @property
    def mixes(self) -> bool:
        """Check that samples around several references make one estimate."""
        return self.most is None and not self.alone

    def around(self, found: Sequence[Reference], kept: Sequence[Reference]) -> list[Reference]:
        """Return the references to sample around, cheapest first, of those of the tree and of guides kept."""
        if self.most is not None:
            return list(found[: self.most])
        return sorted([*found, *kept], key=lambda reference: reference.cost) if kept else list(found)


SAMPLING = {
    "pi-rrht": Method(text="sample around one reference per homology class and let the weights decide (PI-RRHT*)"),
    "best-class": Method(
        text="estimate each class from its own samples and follow only the best (as teb_local_planner, T-MPC)",
        alone=True,
    ),
    "single": Method(text="importance sampling around the cheapest reference only", most=1),
    "passive": Method(text="no reference: sample the passive dynamics", most=0),
}
METHODS = {name: method.text for name, method in SAMPLING.items()} | {
    "mppi": "no reference: one warm-started tape, the straight way to the goal behind its end (Williams et al. 2017)",
    "optimal": "no samples: the optimal feedback law, solved for on a grid (class Optimal)",
}
TREELESS = ("passive", "mppi", "optimal")
