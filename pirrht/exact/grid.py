"""Hold what the grids share: the domain of psi, frames of points, cubic interpolation, and progress."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.field import clearances
from pirrht.geometry.scene import Goal, Scene
from pirrht.jit.jit import inlined

MOST = 1_000_000  # grid points in the plane that are solved for in about half a minute
BAND = 0.03  # FCL itself is asked where the clearance field claims less than this [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Domain:
    """The workspace, the disc on which psi is one, and the clearance from walls."""

    lower: Array  # (2,) corner of the workspace [m]
    upper: Array  # (2,) the opposite one [m]
    goal: Goal
    clearance: Callable[[Array], Array]  # of centres (k, 2), (k,) [m]; at most 0 where the robot may not be

    @classmethod
    def of(cls, space: FreeSpace) -> Domain:
        """Take that of a scene; its clearance is the field's, border included, and FCL's close to obstacles [m]."""

        def at(points: Array) -> Array:
            out = np.empty(len(points))
            clearances(space.field, np.ascontiguousarray(points), out)
            close = np.flatnonzero(out < BAND)
            out[close] = space.collision.clearance(points[close])
            return out

        scene = space.scene
        return cls(lower=scene.lower.astype(float), upper=scene.upper.astype(float), goal=scene.goal, clearance=at)


class Frame(NamedTuple):
    """Frame of a grid's points, and the goal's disc."""

    x0: float  # position of point (0, 0) [m]
    y0: float  # [m]
    spacing: float  # h [m]
    goal_x: float  # centre of the goal's disc [m]
    goal_y: float  # [m]
    radius: float  # of the disc [m]


def frame_at(corner: Array, spacing: float, goal: Goal) -> Frame:
    """Place a grid whose point (0, 0) is at a corner (2,) [m], spacing in [m]."""
    (x0, y0), (goal_x, goal_y) = corner.tolist(), goal.center.tolist()
    return Frame(x0, y0, spacing, float(goal_x), float(goal_y), float(goal.radius))


@inlined
def in_goal(frame, x):  # type: ignore[no-untyped-def]
    """Tell whether the position of x (n,) [m] is in the goal's disc."""
    return (x[0] - frame.goal_x) ** 2 + (x[1] - frame.goal_y) ** 2 <= frame.radius * frame.radius


@inlined
def in_cells(frame, x):  # type: ignore[no-untyped-def]
    """Return the position of x (n,) [m] in spacings from point (0, 0), 2 numbers."""
    return (x[0] - frame.x0) / frame.spacing, (x[1] - frame.y0) / frame.spacing


def affordable(scene: Scene, spacing: float, reason: str, remedy: str = "") -> float:
    """Return a spacing [m] at which the workspace has at most MOST points.

    OptionError if it has more, with the reason for the spacing and what to choose instead.
    """
    size = (scene.upper - scene.lower) / spacing
    if np.prod(size) > MOST:
        raise OptionError(
            f"{reason}, so the grid needs {size[0]:.0f} x {size[1]:.0f} points and can have {MOST:,}; "
            f"choose more --noise{remedy} or a smaller workspace"
        )
    return spacing


Progress = Callable[[float], None]  # is told the share that is done, from 0 to 1


def ignore_progress(share: float) -> None:
    """Ignore progress."""


@inlined
def polynomial(t, c):  # type: ignore[no-untyped-def]
    """Value at t [spacings] of the cubic polynomial that is 1 at point c of -1, 0, 1, 2 and 0 at the others."""
    if c == -1:
        return -t * (t - 1.0) * (t - 2.0) / 6.0
    if c == 0:
        return (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0
    if c == 1:
        return -(t + 1.0) * t * (t - 2.0) / 2.0
    return (t + 1.0) * t * (t - 1.0) / 6.0


@inlined
def derivative(t, c):  # type: ignore[no-untyped-def]
    """Derivative of `polynomial` at t [1/spacing]."""
    if c == -1:
        return -(3.0 * t * t - 6.0 * t + 2.0) / 6.0
    if c == 0:
        return (3.0 * t * t - 4.0 * t - 1.0) / 2.0
    if c == 1:
        return -(3.0 * t * t - 2.0 * t - 2.0) / 2.0
    return (3.0 * t * t - 1.0) / 6.0
