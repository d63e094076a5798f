"""Trees that tests ask, grown to a number of vertices."""

from __future__ import annotations

from typing import Any

import numpy as np

from pirrht import FreeSpace, HomologyTree, Steering


def grown(
    space: FreeSpace, steering: Steering, vertices: int, *, seed: int = 0, limit: float = 0.8, **options: Any
) -> HomologyTree:
    """A tree of a seed."""
    tree = HomologyTree(space, steering, limit=limit, rng=np.random.default_rng(seed), **options)
    tree.grow(vertices)
    return tree
