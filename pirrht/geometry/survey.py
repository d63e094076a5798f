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

FINENESS = 8.0  # spacings of the field in a robot's radius
DENSE = 4_000_000  # points up to which one grid holds them all
SINGLE = 2.0**17  # spacings from the origin at which single precision, in which paths are sampled, is too coarse


def build_field(collision: Collision, members: Sequence[int]) -> Field:
    """Sample clearances [m] from the solids that count; the spacing is a share of the robot's radius at any size.

    Raises:
        SceneError: the workspace is too large for that; names a size that is not.
    """
    world, radius = collision.world, collision.least_radius
    span, farthest = world.upper - world.lower, float(np.abs([world.lower, world.upper]).max())
    h = radius / FINENESS
    if farthest > SINGLE * h:
        raise SceneError(
            f"{_too_large(span, radius)}: {farthest:g} m from the origin positions are too coarse for it; up to "
            f"{_rounded(SINGLE * h, math.floor)} m works, or a radius of "
            f"{_rounded(farthest * FINENESS / SINGLE, math.ceil)} m or more"
        )
    if float(np.prod(np.array(dense_shape(span, h), dtype=float))) <= DENSE:
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
