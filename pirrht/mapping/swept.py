"""Put what moves where it is in a robot's way soon, as discs that stand.

A robot is so far away after some time; a thing that moves is in its way where it is then. Where it has been by then, or
will only be later, the robot may go.
"""

from collections.abc import Iterable

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.tuning import TUNING as GEOMETRY
from pirrht.mapping.tracks import Track
from pirrht.mapping.tuning import SWEPT, SweptTuning


def swept(
    tracks: Iterable[Track], place: Array, since: float, pace: float, size: float, tuning: SweptTuning = SWEPT
) -> Array:  # fmt: skip
    """Return discs x, y, radius [m] (k, 3) that are in the way of a robot at a place (2,) [m].

    Args:
        tracks: what moves.
        since: time since they were seen [s].
        pace: of the robot [m/s].
        size: radius of a disc in the robot, which discs leave free where it is now [m].

    Examples:
        >>> import numpy as np
        >>> from pirrht.mapping.swept import swept
        >>> from pirrht.mapping.tracks import Track
        >>> state = np.array([2.0, -1.0, 0.0, 1.0])  # it crosses 2 m ahead, a second from now
        >>> one = Track(number=1, state=state, cov=np.eye(4), radius=0.3, born=0.0, seen=1.0)
        >>> swept([one], np.zeros(2), 0.0, 1.5, 0.2).round(2).tolist()
        [[2.0, -0.25, 0.35], [2.0, 0.0, 0.35], [2.0, 0.25, 0.35]]
    """
    rows = []
    for one in tracks:
        radius = one.radius + tuning.around
        for ahead in np.arange(0.0, tuning.horizon + 1e-9, tuning.step):
            center = one.at(since + ahead)
            away = float(np.hypot(*(center - place))) - size
            arrival = max(0.0, away - radius) / pace
            least = min(radius, away)
            if arrival - tuning.late <= ahead <= arrival + tuning.early and least > GEOMETRY.smallest:
                rows.append((*center, least))
    return np.array(rows).reshape(-1, 3)
