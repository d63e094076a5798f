"""One option: what it may be and whom it belongs to."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pirrht.errors import OptionError

DIGITS = 20  # of a number are shown at most


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """The least and the greatest value of a number, both allowed, and why there are such."""

    low: float
    high: float
    why: str  # half a sentence, after a colon
    infinite: bool = False  # infinity is allowed as well

    def admit(self, value: float) -> bool:
        """Return whether a value lies within; NaN does not."""
        return self.low <= value <= self.high or (self.infinite and value == math.inf)

    def wanted(self, whole: bool) -> str:
        """Describe in words what a value must be."""
        if whole:
            return f"a whole number of at least {shown(int(self.low))} and at most {shown(int(self.high))}"
        if self.low > 0:
            return f"a positive number, from {self.low:g} to {self.high:g}"
        extra = " ('inf' is allowed)" if self.infinite else ""
        return f"{self.low:g} or more, and at most {self.high:g}{extra}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One option of the command line; most are settings of a run, and some may stand in a scene as well."""

    name: str  # as it is typed, without the dashes
    text: str  # for a person, without the default
    commands: tuple[str, ...]
    group: str = ""  # heading of the help
    kind: Callable[[str], Any] = str  # of one value; bool for a flag
    metavar: str | tuple[str, ...] = ""  # for a number its unit
    count: int | str | None = None  # how many values; "+" for one or more
    choices: tuple[str, ...] = ()
    bounds: Bounds | None = None
    default: Any = None  # of what is no setting; those have theirs in `Settings` and in systems
    unset: str = ""  # what the help says of a default that is None
    attribute: str = ""  # name in `Settings` and in parsed arguments; empty: as `name`
    sets: bool = True  # what a flag sets
    short: str = ""  # another way to type it
    positional: bool = False
    common: bool = False  # whether `--help` of a command with a scene lists it, not only `--help-all`
    required: bool = False
    role: str = "command"  # "setting" of a run, "task" (scene and robot), or of the "command" alone
    methods: tuple[str, ...] = ()  # the only methods that heed it; empty: all
    fixed: Mapping[str, Any] = field(default_factory=dict)  # method -> the only value that it has there
    special: bool = False  # only systems that name it heed it
    numeric: bool = False  # a scene may carry it, as the custom numeric `pirrht_NAME`
    identifies: bool = False  # runs with different values do not belong into one dataset
    paper: Any = None  # its value under `--preset paper`

    @property
    def dest(self) -> str:
        """Its name in `Settings` and in parsed arguments."""
        return self.attribute or self.name.replace("-", "_")

    @property
    def flag(self) -> str:
        """As it is typed."""
        return self.metavar if self.positional and isinstance(self.metavar, str) else f"--{self.name}"

    @property
    def number(self) -> bool:
        """Return whether its values are numbers."""
        return self.kind in (int, float)

    def check(self, value: Any, label: str = "") -> Any:
        """The value in its own type.

        Args:
            label: how messages call it; without one, as it is typed.

        Raises:
            OptionError: it can be none of this option; says what can.
        """
        label = label or self.flag
        if self.choices and value not in self.choices:
            raise OptionError(f"{label} is {value!r}; it must be one of {', '.join(self.choices)}")
        if self.bounds is None:
            return value
        if self.count is not None:
            return [self._number(one, label, self.bounds) for one in value]
        return self._number(value, label, self.bounds)

    def _number(self, value: Any, label: str, bounds: Bounds) -> Any:
        whole = self.kind is int
        try:
            known = bounds.admit(value)
        except TypeError:
            raise OptionError(f"{label} is {value!r}; it must be {bounds.wanted(whole)}") from None
        if known and whole and value != int(value):
            raise OptionError(f"{label} is {value:g}; it must be a whole number")
        if not known:
            raise OptionError(f"{label} is {shown(value)}; it must be {bounds.wanted(whole)}: {bounds.why}")
        return int(value) if whole else value


def shown(value: Any) -> str:
    """A number in a message, however large."""
    if isinstance(value, float):
        return f"{value:g}"
    text = str(value)
    return text if len(text) <= DIGITS else f"{text[:5]}... ({len(text)} digits)"
