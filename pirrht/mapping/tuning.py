"""Hold the tuning numbers of maps: how much one scan counts."""

from typing import NamedTuple


class MapTuning(NamedTuple):
    """Evidence of rays, as natural log-odds, and what of their ends counts."""

    hit: float = 0.85  # added to a cell in which a ray ends; more than `least` takes away, so one scan shows a wall
    free: float = 0.4  # taken from a cell that rays of a scan pass: the less, the longer something gone remains
    least: float = -0.4  # of a cell: after any number of scans without a wall the first one with it counts
    most: float = 1.5  # of a cell: after four scans without a wall it is gone
    into: float = 0.1  # of a cell by which hits are moved on along their rays: noise does not choose a wall's side
    slack: float = (
        0.3  # of a cell by which a hit may miss an occupied cell and count for it: corners stay where they are
    )
    near: float = 0.25  # of a cell up to which a ray passes the last hit in it and takes that back
    grazing: float = 1.0  # cells above a wall through which a ray comes down to its hit, and takes back no hits


TUNING = MapTuning()
