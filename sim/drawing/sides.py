"""On which side of bodies that move a path in space and time passes: before them, or behind."""

from __future__ import annotations

import numpy as np

from pirrht.topology.moving import MovingHomology, place_at
from pirrht.tree.homology_tree import Reference

MOMENTS = 60  # of a path that are looked at
BACK = 0.1  # over which a body's direction is taken [s]
STILL = 0.05  # m/s; what is slower is passed, not gone before or behind


def sides(reference: Reference, moving: MovingHomology) -> tuple[str, ...]:
    """ "before", "behind" or "past", one for each of J markers, by where the path is when it is nearest to it.

    "" for a path that has no times.
    """
    path = reference.trajectory.path
    knots = getattr(path, "knots", None)
    if knots is None or knots.shape[1] != 3:
        return ("",) * moving.J
    times = np.linspace(knots[0, 2], knots[-1, 2], MOMENTS)
    way = np.column_stack([np.interp(times, knots[:, 2], knots[:, k]) for k in (0, 1)])
    found = []
    for j in range(moving.J):
        places = np.array([place_at(moving.tracks, j, float(t)) for t in times])
        k = int(np.argmin(np.hypot(*(way - places).T)))
        late, early = (np.array(place_at(moving.tracks, j, float(times[k] + s))) for s in (BACK, -BACK))
        ahead = (late - early) / (2.0 * BACK)
        slow = float(np.hypot(*ahead)) < STILL
        found.append("past" if slow else "before" if float((way[k] - places[k]) @ ahead) > 0.0 else "behind")
    return tuple(found)
