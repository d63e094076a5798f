"""Systems, one record each: dynamics, costs, steering and defaults; a registry that robots name them in.

A robot's MJCF names a system (`pirrht_dynamics`); `--system MODULE:NAME` takes one of somebody's own instead:

    BOAT = System(
        name="boat", dynamics=lambda settings: Boat(settings.noise), steering=lambda problem: GroundTrack(),
        R=2 * np.eye(2), defaults={"samples": 300},
    )

Without `steering` its references are those of a point that moves straight at a pace, on a tree of positions alone, and
guides make them feasible. References are then not the system's optimum, and their classes are ordered by what they cost
the point. The pace is where the system's cost per meter is least, if there is such a one; else declare `pace`.
"""

from __future__ import annotations

from sim.systems.record import POSE, SPEED, VELOCITIES, System, typed
from sim.systems.registry import BUILT_IN, named, names, refuse, register

__all__ = ["BUILT_IN", "POSE", "SPEED", "VELOCITIES", "System", "named", "names", "refuse", "register", "typed"]
