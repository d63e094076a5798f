"""Axes to draw on: the caller's, or those of a new figure."""

from __future__ import annotations

from typing import Any

from pirrht.errors import OptionError


def on(axes: Any | None, what: str) -> Any:
    """Return the axes; None: those of a new figure. An OptionError names the extra if matplotlib is missing."""
    if axes is not None:
        return axes
    try:
        from matplotlib import pyplot
    except ImportError:
        raise OptionError(f"{what} needs matplotlib; install it with: pip install 'pirrht[figures]'") from None
    return pyplot.subplots(figsize=(7.0, 5.0), layout="constrained")[1]
