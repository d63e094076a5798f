"""The clearance field of a world, of whichever kind fits its size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pirrht.geometry.blocks import TooLarge, build_blocks, refusal
from pirrht.geometry.collision import Collision
from pirrht.geometry.dense import build_dense, dense_shape
from pirrht.geometry.field import Field

FINENESS = 8.0  # spacings of the field in a robot's radius
DENSE = 4_000_000  # points up to which one grid holds them all
SINGLE = 2.0**17  # spacings from the origin at which single precision, in which paths are sampled, is too coarse


def build_field(collision: Collision, members: Sequence[int]) -> Field:
    """Sample clearances [m] from the solids that count; the spacing is a share of the robot's radius at any size.

    Raises:
        SceneError: the workspace is too large for that; says which size is not.
    """
    world, h = collision.world, collision.footprint.radius / FINENESS
    span, farthest = world.upper - world.lower, float(np.abs([world.lower, world.upper]).max())
    if float(np.prod(np.array(dense_shape(span, h), dtype=float))) <= DENSE:
        return build_dense(collision, members, h)
    if farthest > SINGLE * h:
        raise refusal(collision, SINGLE * h / farthest)
    try:
        return build_blocks(collision, members, h)
    except TooLarge as error:
        raise refusal(collision, error.share) from None
