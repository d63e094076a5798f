"""Errors that a caller can fix; each message names a remedy."""

import math
import reprlib
from collections.abc import Sequence
from typing import Any


def one_line(error: BaseException) -> str:
    """Return an error of foreign code in one line, its type first."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def printable(text: str) -> str:
    """Return text in one line; characters that no terminal shows become escape sequences."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class PirrhtError(Exception):
    """Base of all errors of this project; its text is one line for a person."""


class SceneError(PirrhtError):
    """A scene or a robot breaks a convention; the message names the file and the element."""


class OptionError(PirrhtError):
    """An option has a value that cannot work; the message names the option and the values that do."""


class NotLinearlySolvable(PirrhtError):
    """No scalar lambda satisfies `lambda G R^-1 G' = B B'` (paper, section III-A)."""


class NoReference(PirrhtError):
    """No allowed homology class reaches the goal from a state (n,); keeps the query (paper, section IV-C).

    `limit` is that of |1 - H_i| [turns], `blocked` the nearest blocked signature (M,) [turns], if one was given;
    `hasty` whether a class does from the same place at rest, so that the speed is the reason. `margin` is that of the
    plan [m], if it is the reason, and `left` one that leaves a path. `narrow` says where a robot with corners gets
    stuck.
    """

    def __init__(
        self, state: Sequence[float], *, vertices: int, limit: float, blocked: Sequence[float] | None = None,
        hasty: bool = False, margin: float = 0.0, left: float | None = None, narrow: str | None = None,
    ) -> None:  # fmt: skip
        self.state = tuple(map(float, state))
        self.vertices = vertices
        self.limit = limit
        self.hasty = hasty
        self.margin = margin
        self.left = left
        self.narrow = narrow
        self.blocked = None if blocked is None else tuple(map(float, blocked))
        where = ", ".join(f"{s:.3g}" for s in self.state)
        signature = "" if self.blocked is None else ", ".join(f"{h:.3g}" for h in self.blocked)
        nearest = f"; the nearest blocked signature is ({signature})" if signature else ""
        text = (
            f"no allowed class reaches the goal from ({where}): {vertices} vertices, |1 - H_i| <= {limit:g}"
            f"{nearest}. Try more vertices, a larger limit of |1 - H_i| or a smaller footprint."
        )
        if hasty:
            text = (
                f"no class was found from ({where}), but some are found from the same place at rest: at this speed "
                "hardly any path brakes or turns in time. Try more vertices, start slower, or further from what is "
                "ahead."
            )
        if narrow is not None:
            text = f"no path from ({where}) to the goal: {narrow}. Try a smaller footprint or more vertices."
        if left is not None:
            keeps = f"keeps the margin of {margin:g} m. A margin of {left:.3g} m leaves one."
            narrow = "is wide enough for the robot, even without a margin. Try a smaller radius."
            text = f"no path from ({where}) to the goal {keeps if left > 0.0 else narrow}"
        super().__init__(text)


class NoSurvivingSample(PirrhtError):
    """Every sampled path ended outside the goal, so the estimate is undefined; keeps how many ended in which way."""

    def __init__(self, *, collisions: int, timeouts: int) -> None:
        self.collisions, self.timeouts = collisions, timeouts
        super().__init__(
            f"none of {collisions + timeouts} samples reached the goal ({collisions} collided, "
            f"{timeouts} ran out of time). Try more samples or less noise."
        )


def refuse_unless_positive(value: Any, name: str, rule: str) -> None:
    """Raise an OptionError with a rule unless a value is a positive, finite number."""
    try:
        valid = math.isfinite(value) and value > 0
    except (TypeError, ValueError):
        valid = False
    if not valid:
        raise OptionError(f"{name} is {f'{value:g}' if isinstance(value, float) else reprlib.repr(value)}; {rule}")
