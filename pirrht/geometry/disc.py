"""Free space of a disc in the plane: the first member of `SpaceKernels`, on the clearance field of its centre."""

import math

from pirrht.geometry.arcs import entry_of_piece
from pirrht.geometry.certify import certificates
from pirrht.geometry.field import Field, border, closest, interpolate, nearest_label, two_walls, with_slope
from pirrht.geometry.round import GridKernels, round_kernels
from pirrht.geometry.space import SpaceKernels
from pirrht.jit.jit import inlined, part


class Disc(Field):
    """The clearance field of a disc's centre, as a `Space`."""

    @classmethod
    def over(cls, field: Field) -> "Disc":
        """Take the field of a disc's centre."""
        return cls.holding(*field.contents.values())

    @property
    def kernels(self) -> SpaceKernels:
        """Return the kernels that read it."""
        return DISC


@inlined
def walls(static, pose):  # type: ignore[no-untyped-def]
    """Return the two nearest walls of a place (`field.two_walls`), each with its direction as a tuple."""
    c, nx, ny, d, mx, my = two_walls(static, pose[0], pose[1])
    return c, (nx, ny), d, (mx, my)


@inlined
def _side(static, place, k):  # type: ignore[no-untyped-def]
    """Return the distance from a side of the border [m], and the direction away from it."""
    x, y = place
    c = (x - static.left, static.right - x, y - static.low, static.high - y)[k]
    return c, ((1.0, -1.0, 0.0, 0.0)[k], (0.0, 0.0, 1.0, -1.0)[k])


@inlined
def _with_slope(static, grid, place):  # type: ignore[no-untyped-def]
    c, gx, gy = with_slope(static, grid, place[0], place[1])
    return c, (gx, gy)


@inlined
def _closest(static, place):  # type: ignore[no-untyped-def]
    at, dx, dy, width = closest(static, place[0], place[1])
    return at, (dx, dy), width


@inlined
def _along(place, u, s, aside):  # type: ignore[no-untyped-def]
    return place[0] + s * u[0] + aside * u[1], place[1] + s * u[1] - aside * u[0]


@inlined
def _entry(place, u, length, goal, radius):  # type: ignore[no-untyped-def]
    return entry_of_piece(place[0], place[1], math.atan2(u[1], u[0]), 0.0, length, goal[0], goal[1], radius)


PLANE = GridKernels(
    width=2,
    border=part(lambda static, place: border(static, place[0], place[1])),
    side=_side,
    interpolate=part(lambda static, grid, place: interpolate(static, grid, place[0], place[1])),
    with_slope=_with_slope,
    closest=_closest,
    label=part(lambda static, place: nearest_label(static, place[0], place[1])),
    walls=walls,
    along=_along,
    entry=_entry,
)
ROUND = round_kernels(PLANE)
enter_goal = ROUND.enter_goal
clearance = ROUND.fields["clearance"]
certify, certify_piece, certify_curve, _ = certificates(clearance, ROUND.refused, False)

DISC = SpaceKernels(
    isotropic=True, certify=certify, certify_place=certify, certify_piece=certify_piece, certify_curve=certify_curve,
    **ROUND.fields,
)  # fmt: skip
distances, sweep, bridge, towards_exit, rim = DISC.distances, DISC.sweep, DISC.bridge, DISC.exit, DISC.rim
