"""Hold the tuning numbers of moving obstacles, and the widths of their arrays."""

from typing import NamedTuple


class MovingTuning(NamedTuple):
    """Numbers that trade accuracy for time or memory."""

    table_pitch: float = 0.05  # spacing of a table of distances as a share of the robot's radius: error against memory
    table_points: int = 1_000_000  # of all tables, which get coarser beyond: 8 bytes and some microseconds of FCL each
    cover_share: float = 0.9  # of the excess of a polygon that its discs take; the rest is for tables
    cutoff_radii: float = 8.0  # clearances are reported up to so many robot radii: walls farther away do not matter
    min_cutoff: float = 1.0  # or up to this, if that is more; for a polygon, only to this [m]
    stride: float = 5e-3  # of a march on where nothing is certain [m]: most such steps soon end inside beyond doubt
    certain: float = 1e-5  # so close a march may come where distances are closed forms [m]
    skin: float = 1.0  # obstacles are listed so much further away than required [m]: fewer new lists of longer ones
    sweep_step: float = 0.1  # sweeps advance by so many robot radii at least: a grazing contact may be missed by less


class RowWidths(NamedTuple):
    """Numbers per row of the arrays that kernels read."""

    body: int = 5  # how much later than now its rows' clock is [s], when it starts over [s] (0: never), whether that is
    # elsewhere than it ends, radius of the disc outside of which the robot is free [m], greatest speed [m/s]
    parts: int = 4  # where its rows begin and end, and its solids
    row: int = 7  # t [s], x, y [m], yaw [rad], and the rates of these until the next row [1/s]
    piece: int = 14  # in space t [s], place [m], quaternion (w, x, y, z), and velocity and turns until the next row
    solid: int = 15  # MuJoCo's sizes, place in the obstacle's frame, and axes there as columns, row by row
    table: int = 4  # form or -1, where its lattice begins in the table, and how many points that has along x and y
    # A wall (`geometry.world`), pose [m], [rad] and its rates, from when and until when these hold [s], cosine and sine
    # of a yaw, that yaw, and whether the wall is known: otherwise the clearance is only a lower bound.
    posed: int = 18
    # Reach of a list [m], from where [m] and when it is known, from and until when it serves [s], and its size.
    listing: int = 7


TUNING = MovingTuning()
BODY, PARTS, ROW, PIECE, SOLID, TABLE, POSED, LISTING = RowWidths()
