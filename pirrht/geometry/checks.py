"""Check numbers that people give to scenes and as states: finite, of their shape, none larger than any scene's."""

from collections.abc import Collection
from typing import Any, TypeVar

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.formatting import short
from pirrht.geometry.tuning import TUNING

FARTHEST = TUNING.farthest
T = TypeVar("T")


def rows_of(value: Any, what: str, must: str) -> Any:
    """Return a sequence of rows as it is; SceneError: it is text, or has no length, as None or a generator."""
    single = getattr(value, "ndim", 1) == 0  # an array of one number, which has the methods of a sequence
    if single or isinstance(value, str | bytes) or not isinstance(value, Collection):
        raise SceneError(f"{what} is {short(value)}; it must be a sequence of {must}")
    return value


def parts_of(value: Any, kind: type[T], what: str) -> tuple[T, ...]:
    """Return a sequence of objects of a kind as a tuple; SceneError: one of them is of another."""
    parts = tuple(rows_of(value, what, f"{kind.__name__} objects"))
    for i, part in enumerate(parts, start=1):
        if not isinstance(part, kind):
            raise SceneError(f"{what}: number {i} is {short(part)}; it must be of type {kind.__name__}")
    return parts


def numbers(value: Any, shape: tuple[int | None, ...], what: str, must: str) -> Array:
    """Return numbers as an array of a shape, in which None is any length; SceneError: they are others or too large."""
    array = _floats(value)
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or not np.abs(array).max(initial=0.0) <= FARTHEST:
        raise SceneError(f"{what} is {short(value)}; it must be {must}, finite and at most {FARTHEST:g}")
    return array


def width_of(position: Any) -> int:
    """Return 3 for a position of three numbers, else 2."""
    return 3 if _floats(position).shape == (3,) else 2


def number(value: Any, what: str, must: str, least: float = TUNING.smallest) -> float:
    """Return a number that is at least so large; SceneError: it is another, or none."""
    array = _floats(value)
    if array.ndim != 0 or not least <= array <= FARTHEST:
        raise SceneError(f"{what} is {short(value)}; it must be {must}, from {least:g} to {FARTHEST:g}")
    return float(array)


def checked_state(value: Any, n: int, owner: str, *, many: bool = False) -> Array:
    """Return a state (n,), or perhaps `many` (k, n), as numbers; OptionError: its owner takes others, or it is none."""
    try:
        state = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        state = np.array(np.nan)
    if state.ndim not in (1, 1 + many) or state.shape[-1] != n or not np.isfinite(state).all():
        raise OptionError(f"the state is {short(value)}; {owner} takes {n} finite numbers")
    return state


def _floats(value: Any) -> Array:
    """Return what is an array of numbers as such, anything else as one that is not a number."""
    if type(value) is np.ndarray and value.dtype == np.float64:  # as most are
        return value
    try:
        array = np.asarray(value)
        if array.dtype.kind in "iufO" and not np.ma.is_masked(value):
            return array.astype(float, copy=False)
    except (TypeError, ValueError, OverflowError):
        pass
    return np.array(np.nan)
