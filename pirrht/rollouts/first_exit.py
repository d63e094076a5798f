"""Parts of a first exit that depend on no footprint: lengths of steps, crossings of a bridge, turns of a step."""

import math
from functools import cache
from typing import Any

from pirrht.jit.jit import inlined, kernel
from pirrht.jit.streams import HALF, normals
from pirrht.jit.vectors import combined
from pirrht.rollouts.tuning import TUNING


@inlined
def wall_slope(c, nx, ny, d, mx, my, offset):  # type: ignore[no-untyped-def]
    """Gradient (x, y) [1/m] of log(c / (c + offset)) + log(d / (d + offset)) for two walls as `two_walls` gives them.

    Along it, times BB', surviving paths lean away from walls: psi vanishes there like the distance, c > 0 [m].
    """
    one = offset / (c * (c + offset))
    other = offset / (d * (d + offset))

    return one * nx + other * mx, one * ny + other * my


@cache
def slope_for(numbers: int) -> Any:
    """Build `wall_slope` (walls, offset) of poses of so many numbers, for walls as `SpaceKernels.walls` gives them."""
    both = combined(numbers)

    @inlined
    def slope(walls, offset):  # type: ignore[no-untyped-def]
        c, n, d, m = walls
        one = offset / (c * (c + offset))
        other = offset / (d * (d + offset))
        return both(one, n, other, m)

    return slope


@inlined
def fitting(near, rest, least, scale):  # type: ignore[no-untyped-def]
    """Fit a step [s] to the place: noise carries a path over a third of the way to what ends it, or less.

    Args: distance to wall or goal [m]; rest of the step of the grid, least step [s]; 1 / (9 variance per second)
        [s/m^2].
    """
    wish = max(scale * near * near, least)
    return rest if wish >= rest else min(wish, HALF * rest)


@kernel
def at_crossing(exit, radius, end, share, deviation, state):  # type: ignore[no-untyped-def]
    """Displace an isotropic bridge to its first crossing, the distance to wall or rim; along it the bridge is drawn.

    Args, in order: `towards_exit`, radius of a rim or 0 [m], displacement (x, y) at the end of the step [m], share of
        the step until the crossing, standard deviation of the whole step [m], and state of the random sequence.
    Returns: next state of the sequence, displacement in x and y [m].
    """
    (gap, nx, ny), (dx, dy) = exit, end
    state, z, _ = normals(state)
    along = share * (dy * nx - dx * ny) + deviation * math.sqrt(share * (1.0 - share)) * z
    if abs(along) < radius:  # the rim is round
        gap += radius - math.sqrt(radius * radius - along * along)
    return state, gap * nx - along * ny, gap * ny + along * nx


@kernel
def at_crossing_in_space(exit, radius, end, share, deviation, state):  # type: ignore[no-untyped-def]
    """Displace an isotropic bridge in space to its first crossing, as `at_crossing` does in the plane.

    Returns: next state of the sequence, displacement in x, y and z [m].
    """
    gap, nx, ny, nz = exit
    dx, dy, dz = end
    state, x, y = normals(state)
    state, z, _ = normals(state)
    spread = deviation * math.sqrt(share * (1.0 - share))
    x = share * dx + spread * x
    y = share * dy + spread * y
    z = share * dz + spread * z
    through = x * nx + y * ny + z * nz
    x -= through * nx
    y -= through * ny
    z -= through * nz
    square = x * x + y * y + z * z
    if square < radius * radius:  # the rim is round
        gap += radius - math.sqrt(radius * radius - square)
    return state, x + gap * nx, y + gap * ny, z + gap * nz


@inlined
def turn_of(v, w, way, dt):  # type: ignore[no-untyped-def]
    """Angle [rad] by which a step of dt [s] turns that goes a way (x, y) [m] while its velocity v [m/s] becomes w."""
    (vx, vy), (wx, wy), (dx, dy) = v, w, way
    square = dx * dx + dy * dy
    return 0.0 if square == 0.0 else max(-TUNING.arc, min(TUNING.arc, dt * ((wy - vy) * dx - (wx - vx) * dy) / square))
