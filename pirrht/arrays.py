"""Types of the arrays that the records of this package are made of, and a check of those that are states."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht import formatting
from pirrht.errors import OptionError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def checked_state(value: Any, n: int, owner: str, *, many: bool = False) -> Array:
    """Return a state (n,), or perhaps `many` (k, n), as numbers; OptionError: its owner takes others, or it is none."""
    try:
        state = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        state = np.array(np.nan)
    if state.ndim not in (1, 1 + many) or state.shape[-1] != n or not np.isfinite(state).all():
        raise OptionError(f"the state is {formatting.short(value)}; {owner} takes {n} finite numbers")
    return state
