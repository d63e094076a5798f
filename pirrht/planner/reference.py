"""What a tree knows of one homology class from a state: its best path into the goal, and how it winds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pirrht import shown
from pirrht.arrays import Array
from pirrht.steering.trajectory import Trajectory
from pirrht.topology.signature import class_id


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    """The best known path of one homology class from a state into the goal."""

    winding: tuple[int, ...]  # (M,) whole turns against the straight line from the state to the goal point
    signature: Array  # (M,) the paper's H, leading 1 included [turns]
    trajectory: Trajectory  # controls (l, m), durations (l,) [s] and path
    named: int | None = None  # how many turns are in its name at least, as `Homology.named`
    others: tuple[Trajectory, ...] = ()  # dearer ones of the class in other valleys, where they were looked for

    @property
    def path(self) -> Any:
        """Consecutive motions: along arcs, `Curves`."""
        return self.trajectory.path

    @property
    def cost(self) -> float:
        """Steering cost [cost]; it orders references and is never mixed with psi."""
        return self.trajectory.cost

    @property
    def length(self) -> float:
        """Path length [m]."""
        return self.trajectory.length

    @property
    def id(self) -> str:
        """Public name of the class, relative to the state it was asked for."""
        return class_id(self.winding, self.named)

    def __repr__(self) -> str:
        return f"Reference(class {shown.turns(self.id)}: cost {self.cost:.4g}, {self.length:.3g} m)"
