"""Sample the clearance field of a world, of the kind that fits its size."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.blocks import TooLarge, build_blocks
from pirrht.geometry.collision import Collision
from pirrht.geometry.dense import build_dense, dense_shape
from pirrht.geometry.field import Field
from pirrht.geometry.tuning import TUNING


def build_field(collision: Collision, members: Sequence[int]) -> Field:
    """Sample clearances [m] from the solids that count; the spacing is a share of the robot's radius at any size.

    Raises:
        SceneError: the workspace is too large for that; names a size that is not.
    """
    world, radius = collision.world, collision.least_radius
    span, farthest = world.upper - world.lower, float(np.abs([world.lower, world.upper]).max())
    h = radius / TUNING.cells_per_radius
    if farthest > TUNING.single_cells * h:
        raise SceneError(
            f"{_too_large(span, radius)}: {farthest:g} m from the origin positions are too coarse for it; up to "
            f"{_rounded(TUNING.single_cells * h, math.floor)} m works, or a radius of "
            f"{_rounded(farthest * TUNING.cells_per_radius / TUNING.single_cells, math.ceil)} m or more"
        )
    if float(np.prod(np.array(dense_shape(span, h), dtype=float))) <= TUNING.dense_points:
        return build_dense(collision, members, h)
    try:
        return build_blocks(collision, members, h)
    except TooLarge as error:
        x, y = (_rounded(error.share * side, math.floor) for side in span.tolist())
        raise SceneError(
            f"{_too_large(span, radius)} among these {len(members)} obstacles; up to about {x} m x {y} m works, or "
            f"a radius of about {_rounded(radius / error.share, math.ceil)} m or more"
        ) from None


def _too_large(span: Array, radius: float) -> str:
    return f"the workspace of {span[0]:g} m x {span[1]:g} m is too large for a robot of radius {radius:g} m"


def _rounded(length: float, rounding: Callable[[float], float]) -> str:
    """Write a length [m] in three digits."""
    unit = 10.0 ** (math.floor(math.log10(length)) - 2)
    return f"{rounding(length / unit) * unit:g}"
