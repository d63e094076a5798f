"""Hold the tuning numbers of maps: how much one scan counts, and how moving obstacles are tracked."""

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
    recent: int = 15  # scans for which what is hit where it had been free may be on the move
    grazing: float = 1.0  # cells above a wall through which a ray comes down to its hit, and takes back no hits


class TrackTuning(NamedTuple):
    """Numbers that moving things are tracked by."""

    before: int = 10  # earlier scans that tell what had been free
    passed: float = 0.1  # by which their rays went on, at least [m]
    gap: float = 0.2  # between neighbouring hits of one thing, at most [m]
    fewest: int = 3  # hits of a thing that is noticed
    new: float = 0.3  # share of its hits that are where it had been free, at least
    widest: float = 1.6  # thing that is tracked [m]
    least: float = 0.1  # radius, at least [m]
    first: float = 0.3  # radius while it is not all in view [m]
    agility: float = 1.0  # standard deviation of accelerations [m/s^2]
    fastest: float = 1.5  # standard deviation of speeds of what is noticed [m/s]
    noise: float = 0.02  # standard deviation of a centre, whose outline is no circle [m]
    hit: float = 0.02  # and what a hit's distance from the circle adds [m]
    gate: float = 0.15  # distance of hits from where the circle is expected, at most [m]
    near: float = 0.05  # the same for hits on what was there before [m]
    sightings: int = 3  # of all of it, after which a thing may be on the move
    gone: float = 0.12  # by then, at least [m]
    far: float = 0.35  # way after which it is on the move though its speed is within three standard deviations [m]
    slow: float = 0.25  # speed of what is on the move, at least [m/s]
    still: float = 0.15  # speed below which it stands [m/s]
    rest: float = 1.0  # time after which a thing that stands is a part of the map [s]
    unseen: float = 0.8  # time after which what is out of sight is forgotten [s]
    fits: int = 5  # steps by which the centre of a circle is found
    horizon: float = 10.0  # of predictions at constant velocity [s]
    around: float = 0.05  # a predicted disc, which is kept clear [m]
    trail: float = 0.4  # time before it was noticed from which it may have left walls [s]


TUNING = MapTuning()
TRACKS = TrackTuning()
