"""Format objects at the prompt: one line each."""

import reprlib
from collections.abc import Iterable
from typing import Any

import numpy as np

WIDEST = 24  # most characters of a name
FEW = 6  # numbers of an array in one line
_SHORT = reprlib.Repr()
_SHORT.maxother = _SHORT.maxstring = 60


def name(text: str) -> str:
    """Return a name in quotes, cut where it is long."""
    return repr(text if len(text) <= WIDEST else text[: WIDEST - 3] + "...")


def vector(numbers: Iterable[float]) -> str:
    """Return numbers as (1.2, 3.4), with three digits."""
    return "(" + ", ".join(f"{float(v) + 0.0:.3g}" for v in numbers) + ")"


def exact(numbers: Iterable[float]) -> str:
    """Return numbers as (1.2, 3.4), with six digits."""
    return "(" + ", ".join(f"{float(v):g}" for v in numbers) + ")"


def matrix(rows: Iterable[Iterable[float]]) -> str:
    """Return rows of numbers as [[1.2, 0], [0, 3.4]], with four digits."""
    return "[" + ", ".join("[" + ", ".join(f"{float(v) + 0.0:.4g}" for v in row) + "]" for row in rows) + "]"


def share(weight: float) -> str:
    """Return a share in per cent."""
    return f"{100.0 * weight:.0f} %"


def percent(probability: float) -> str:
    """Return a probability in per cent, with two digits."""
    return f"{100.0 * probability:.{2 + (probability > 0.994)}g} %"


def turns(id: str) -> str:
    """Return a class's name for people: where there are many obstacles only those with turns, as in "+5 -12"."""
    each = [int(k) for k in id.split(",")] if id.count(",") >= 4 else []
    parts = [f"{'+' if k > 0 else '-'}{i}" * abs(k) for i, k in enumerate(each, 1) if k]
    return (" ".join(parts) or "straight") if each else id


def short(value: Any) -> str:
    """Return a value in one short line: a few numbers of an array, anything else as Python writes it."""
    if type(value) is np.ndarray and value.ndim == 1 and len(value) <= FEW and value.dtype.kind in "iuf":
        return vector(value)
    return " ".join(_SHORT.repr(value).split())
