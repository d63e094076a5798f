"""Interface between states of systems and what is around them: joints, scenes, options, tables and pictures."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.scene import Goal


class Component(NamedTuple):
    """A component of a state, as tables name it."""

    unit: str
    text: str  # what it is, {} being when
    typed: str  # as the command line has it
    turned: bool = False  # whether it is an angle about the vertical


class Joints(Protocol):
    """Translates states (n,) to the joints of a robot in a joined model."""

    @property
    def rolls(self) -> bool:
        """Return whether wheels or rotors carry the robot, so that a step is that of the equation only about."""

    @property
    def fly(self) -> Callable[[Any, Array, Array], None] | None:
        """Return what flies a robot with rotors: of an acceleration that is wanted, and that with gusts [m/s^2]."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the places that these joints can have."""

    @property
    def rates(self) -> tuple[str, ...]:
        """Names of the speeds that can be states of it."""

    def place(self, data: Any, state: Array, twist: Array, ctrl: Array) -> None:
        """Place the robot at `state` (n,); wheels roll with `twist` (k,) under the commands `ctrl` (nu,)."""

    def read(self, data: Any, before: Array) -> Array:
        """Return the state now, (n,), given the one of the step before, from which angles go on."""


class StateAdapter(ABC):
    """Adapts the states of a system, by their names, to MuJoCo, scenes, options, tables and pictures.

    Subclasses state the names, and how states are placed, read and drawn. The position comes first in every state.

    Examples:
        >>> import numpy as np
        >>> from sim.states import adapter_of
        >>> car = adapter_of(("x", "y", "heading", "speed"))
        >>> car.places, car.typed()
        (('x', 'y', 'heading'), 'X Y TH V')
        >>> x = np.array([1.0, 2.0, 0.5, 0.8])
        >>> x[car.position].tolist(), car.start_of(x).tolist(), car.drawn(x, 0.1).tolist()
        ([1.0, 2.0], [1.0, 2.0, 0.5], [1.0, 2.0, 0.1])
    """

    components: ClassVar[Mapping[str, Component]]  # of states that have a name of their own
    pose: ClassVar[tuple[str, ...]]  # names of all places, in the order of a scene's start
    dimension: ClassVar[int]  # of a position: so many first names of `pose` begin every state
    velocities: ClassVar[tuple[str, ...]]  # names of speeds along the axes, in their order [m/s]
    speeds: ClassVar[tuple[str, ...]]  # names of speeds of the body ahead [m/s]
    start_form: ClassVar[tuple[str, ...]]  # numbers of a start, those in brackets of some
    goal_form: ClassVar[tuple[str, ...]]  # numbers of a goal
    workspace_form: ClassVar[tuple[str, ...]]  # numbers of a workspace, least and greatest by axis

    def __init__(self, states: Sequence[str]) -> None:
        self.states = tuple(states)
        self.position = slice(0, self.dimension)  # of a state, or of states (..., n): `x[..., adapter.position]`
        self.places = tuple(name for name in self.states if name in self.pose)  # states that joints must have
        self.turns = tuple(name for name in self.places if name not in self.pose[: self.dimension])
        self.rates = tuple(name for name in self.states if name in (*self.velocities, *self.speeds))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self.states)})"

    @classmethod
    def fits(cls, states: Sequence[str]) -> bool:
        """Return whether states of these names begin with the position."""
        return tuple(states[: cls.dimension]) == cls.pose[: cls.dimension]

    @classmethod
    def first_words(cls) -> str:
        """Return the names that states begin with, as the end of a sentence."""
        number = ("none", "one", "two", "three")[cls.dimension]
        *rest, last = (f'"{name}"' for name in cls.pose[: cls.dimension])
        return f"the first {number} must be {', '.join(rest)} and {last}"

    @property
    def bare(self) -> bool:
        """Return whether the states are a place and nothing else."""
        return set(self.states) <= set(self.pose)

    def typed(self, names: Sequence[str] | None = None) -> str:
        """Return names of states, by default of all, as the command line has them."""
        known = self.components
        return " ".join(known[one].typed if one in known else one.upper() for one in names or self.states)

    def text(self, place: Array, digits: int = 6) -> str:
        """Return the position of a state, or of a start, for a person."""
        return "(" + ", ".join(f"{v:.{digits}g}" for v in place[self.position]) + ")"

    def state_of(self, start: Array) -> Array:
        """Return the state (n,) at rest at a scene's start."""
        return np.array([start[self.pose.index(name)] if name in self.pose else 0.0 for name in self.states])

    @abstractmethod
    def start_of(self, x: Array) -> Array:
        """Return the scene's start for a run from state x (n,)."""

    @abstractmethod
    def start(self, data: Any, site: int, given: Sequence[float] | None) -> Array:
        """Read a scene's start: as given, else of the site with that number, -1 if there is none; SceneError: no."""

    @abstractmethod
    def goal(self, model: Any, data: Any, site: int, given: Sequence[float] | None) -> Goal:
        """Read a scene's goal: as given, else of the site with that number, -1 if there is none; SceneError: no."""

    @abstractmethod
    def borders_text(self, lower: Array, upper: Array) -> str:
        """Return the borders of a workspace for a person."""

    @abstractmethod
    def unfit(self, model: Any, system: str) -> str:
        """Refuse a robot file that no states fit; return why its joints are not those of a system's states, or ""."""

    @abstractmethod
    def rest(self, model: Any) -> Array:
        """Return joint positions (nq,) of a robot at rest at the origin, heading along x; SceneError: it does not."""

    @abstractmethod
    def joints(self, model: Any) -> Joints:
        """Return what translates states to the joints of the robot in a joined model, whose keyframe 0 holds it."""

    @abstractmethod
    def above(self, states: Array) -> Array:
        """Return positions seen from above, (..., 2) [m], of states (..., n)."""

    @abstractmethod
    def drawn(self, states: Array, height: float | Array) -> Array:
        """Return positions in pictures in space, (..., 3) [m], of states (..., n); robots on the ground at a height."""

    @abstractmethod
    def poses(self, states: Array) -> Array:
        """Return poses seen from above, x, y and heading (..., 3) [m, m, rad], of states (..., n)."""

    @abstractmethod
    def ahead(self, x: Array, y: Array) -> Array:
        """Return the way from state x (n,) to y (n,) in the frame of the robot at x, (3,) [m]."""

    @abstractmethod
    def direction(self, start: Array) -> Array | None:
        """Return where a robot looks at a scene's start, seen from above, a unit vector (2,); None: nowhere."""

    @abstractmethod
    def facing(self, points: Array, count: int) -> list[Array]:
        """Return states (k, n) at points (k, 2) seen from above, for each of `count` headings that it may have."""
