"""Hold the tuning numbers of moving obstacles, and the widths of their arrays."""

from __future__ import annotations

from typing import NamedTuple


class MovingTuning(NamedTuple):
    """Numbers that trade accuracy for time or memory."""

    table_pitch: float = 0.05  # spacing of a table of distances as a share of the robot's radius: error against memory
    table_points: int = 1_000_000  # of all tables, which get coarser beyond: 8 bytes and some microseconds of FCL each
    cutoff_radii: float = 8.0  # clearances are reported up to so many robot radii: walls farther away do not matter
    min_cutoff: float = 1.0  # or up to this, if that is more [m]
    stride: float = 5e-3  # of a march on where nothing is certain [m]: most such steps soon end inside beyond doubt
    certain: float = 1e-5  # so close a march may come where distances are closed forms [m]
    hair: float = 1e-6  # a path that is free but for less than this is not [m]: halvings of a swept piece
    push_cutoff: float = 3.0  # obstacles count within so many distances at which walls push: e^-3 is left there
    stretch: float = 0.2  # steps of the grid share a list for so long at least [s]: building against longer lists
    cells: int = 1 << 16  # of all stretches, which grow where there would be more: memory
    cell_side: float = 1.0  # over the cutoff: building against longer lists
    skin: float = 1.0  # obstacles are listed so much further away than required [m]: fewer new lists of longer ones
    sweep_step: float = 0.1  # sweeps advance by so many robot radii at least: a grazing contact may be missed by less


class RowWidths(NamedTuple):
    """Numbers per row of the arrays that kernels read."""

    body: int = 5  # how much later than now its rows' clock is [s], when it starts over [s] (0: never), whether that is
    # elsewhere than it ends, radius of the disc outside of which the robot is free [m], greatest speed [m/s]
    parts: int = 6  # where its rows begin and end, its solids, and its boxes
    row: int = 7  # t [s], x, y [m], yaw [rad], and the rates of these until the next row [1/s]
    solid: int = 15  # MuJoCo's sizes, place in the obstacle's frame, and axes there as columns, row by row
    table: int = 4  # form or -1, where its lattice begins in the table, and how many points that has along x and y
    wall: int = 5  # clearance [m], direction (x, y) away from it, velocity (x, y) there [m/s]
    near: int = (
        17  # a wall, pose [m], [rad] and its rates, from when and until when these hold [s], cosine and sine of a
    )
    # yaw, and whether the wall is known: otherwise the clearance is only a lower bound
    cached_list: int = 5  # distance within which all are on it, where and when that was known, until when it serves
    cached_body: int = 5  # a lower bound of its clearance [m], where, when, and until when that holds [s]
    cell: int = 2  # cell that is listed, or EVERYBODY or NOBODY, and how many jumps are past


TUNING = MovingTuning()
BODY, PARTS, ROW, SOLID, TABLE, WALL, NEAR_WIDTH, CACHED_LIST, CACHED_BODY, CELL_STATE = RowWidths()
