"""Events that interfere with a run, and scripts that time them, as JSON.

A script is a list of steps, each at a time of the run, as in FORM.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pirrht.errors import OptionError, one_line
from sim.files import why_unreadable

GOAL = "goal"  # the name under which the goal's disc is moved
LARGEST = 1 << 20  # bytes of a script
FORM = '[{"at": 0.5, "push": [0, 0.4], "for": 0.3}, {"at": 1, "move": "goal", "to": [5, 3]}, {"at": 2, "noise": 0.3}]'
_KEYS = {"push": {"at", "push", "for"}, "move": {"at", "move", "to", "by"}, "noise": {"at", "noise"}}
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


def read(path: Path) -> tuple[Event, ...]:
    """Return the steps of a script in the order of their times.

    Raises:
        OptionError: it cannot be read, or a step is none; names it and shows a script.
    """
    why = why_unreadable(path)
    if why is not None:
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
    kinds = [kind for kind in _KEYS if isinstance(step, Mapping) and kind in step]
    if len(kinds) != 1:
        raise OptionError(f"{where} is not one of push, move and noise; write it as in {FORM}")
    kind, keys = kinds[0], _KEYS[kinds[0]]
    for name in sorted(set(step) - keys):
        raise OptionError(f'{where} has "{name}"; a {kind} has {", ".join(sorted(keys))}')

    values: dict[str, Any] = {}
    for name in {"at", *step} & _NUMBERS.keys():
        (count, low, high), value = _NUMBERS[name], step.get(name)
        found = value if count > 1 and isinstance(value, list) else [value]
        if len(found) != count or not all(type(one) in (int, float) and low <= one <= high for one in found):
            required = f"{'a number' if count == 1 else 'two numbers [x, y]'} from {low:g} to {high:g}"
            raise OptionError(f'{where}: "{name}" is {json.dumps(value)[:40]}; it must be {required}')
        values[name] = float(value) if count == 1 else tuple(map(float, found))
    if kind == "noise":
        return Noise(**values)
    if kind == "push":
        return Push(at=values["at"], speed=values["push"], lasts=values.get("for", 0.2))
    if len(step.keys() & {"to", "by"}) != 1 or not isinstance(step["move"], str):
        raise OptionError(f'{where}: a move names what is moved, and has either "to": [x, y] or "by": [x, y]')
    to = values.get("to") or values["by"]
    return Move(at=values["at"], what=step["move"], to=to, relative="by" in step)
