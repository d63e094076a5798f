"""Events that interfere with a run, and scripts that time them, as JSON.

A script is a list of steps, each at a time of the run, as in FORM.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pirrht.errors import OptionError, one_line
from sim.files import why_unreadable

GOAL = "goal"  # the name under which the goal's disc is moved
LARGEST = 1 << 20  # bytes of a script
FORM = '[{"at": 0.5, "push": [0, 0.4], "for": 0.3}, {"at": 1, "move": "goal", "to": [5, 3]}, {"at": 2, "noise": 0.3}]'
_NUMBERS = {  # keys of a step: how many numbers, from and to [s], [m/s], [m]
    "at": (1, 0.0, 1e5), "for": (1, 1e-3, 1e5), "push": (2, -20.0, 20.0), "to": (2, -1e4, 1e4), "by": (2, -1e4, 1e4),
    "noise": (1, 1e-6, 1e3),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Push:
    """A push on the robot's body: one with velocity servos is carried along meanwhile, others gain that speed."""

    at: float  # time of the run [s]
    speed: tuple[float, float]  # [m/s]
    lasts: float = 0.2  # [s]

    def __str__(self) -> str:
        return f"pushed by ({self.speed[0]:.2g}, {self.speed[1]:.2g}) m/s for {self.lasts:.2g} s"


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """A static obstacle, or the goal, is put elsewhere."""

    at: float  # time of the run [s]
    what: str
    to: tuple[float, float]  # where its centre goes [m], or how far
    relative: bool = False  # `to` is how far

    def __str__(self) -> str:
        return f"{self.what} moved {'by' if self.relative else 'to'} ({self.to[0]:.3g}, {self.to[1]:.3g})"


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """The noise becomes another."""

    at: float  # time of the run [s]
    noise: float  # b, as --noise

    def __str__(self) -> str:
        return f"noise {self.noise:.3g}"


Event = Push | Move | Noise
_KINDS: dict[str, tuple[Callable[..., Event], str]] = {  # with the keys of a step
    "push": (Push, "at for push"), "move": (Move, "at by move to"), "noise": (Noise, "at noise"),
}  # fmt: skip
_FIELDS = {"push": "speed", "for": "lasts", "by": "to"}  # keys of other names than the fields


def read(path: Path) -> tuple[Event, ...]:
    """Return the steps of a script in the order of their times.

    Raises:
        OptionError: it cannot be read, or a step is none; names it and shows a script.
    """
    if (why := why_unreadable(path)) is not None:
        raise OptionError(f"--script {path}: it {why}; give a JSON file like {FORM}")
    try:
        with path.open("rb") as stream:
            steps = json.loads(stream.read(LARGEST))
    except (ValueError, RecursionError, OSError) as error:
        raise OptionError(f"--script {path}: this is no JSON ({one_line(error)}); write a list like {FORM}") from None
    if not isinstance(steps, list):
        raise OptionError(f"--script {path}: it holds no list of steps; write one like {FORM}")
    events = [_event(f"--script {path}: step {i}", step) for i, step in enumerate(steps, 1)]
    return tuple(sorted(events, key=lambda event: event.at))


def _event(where: str, step: Any) -> Event:
    kinds = [kind for kind in _KINDS if isinstance(step, Mapping) and kind in step]
    if len(kinds) != 1:
        raise OptionError(f"{where} is not one of push, move and noise; write it as in {FORM}")
    made = _KINDS[kinds[0]][0]
    keys = _KINDS[kinds[0]][1].split()

    for name in sorted(set(step) - set(keys)):
        raise OptionError(f'{where} has "{name}"; a {kinds[0]} has {", ".join(keys)}')

    values: dict[str, Any] = {}
    for name in {"at", *step} & _NUMBERS.keys():
        count, low, high = _NUMBERS[name]
        value = step.get(name)
        found = value if count > 1 and isinstance(value, list) else [value]
        if len(found) != count or not all(type(one) in (int, float) and low <= one <= high for one in found):
            required = f"{'a number' if count == 1 else 'two numbers [x, y]'} from {low:g} to {high:g}"
            raise OptionError(f'{where}: "{name}" is {json.dumps(value)[:40]}; it must be {required}')
        values[_FIELDS.get(name, name)] = float(value) if count == 1 else tuple(map(float, found))
    if made is Move:
        if len(step.keys() & {"to", "by"}) != 1 or not isinstance(step["move"], str):
            raise OptionError(f'{where}: a move names what is moved, and has either "to": [x, y] or "by": [x, y]')
        values |= {"what": step["move"], "relative": "by" in step}
    return made(**values)
