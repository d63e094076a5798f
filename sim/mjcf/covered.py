"""Whether a body that moves comes to rest on the goal, so that nobody can arrive after that."""

from __future__ import annotations

import math

import numpy as np

from pirrht.geometry.scene import Scene
from pirrht.moving.collision import MovingObstacles

MOMENTS = 1000  # before it rests at which one looks


def covered(scene: Scene) -> str | None:
    """Which body rests on the goal point in the end and since when, in words; None if the robot fits there."""
    goal = scene.goal.center
    for mover in scene.movers:
        if not math.isfinite(mover.motion.last):
            continue
        crowd, rests = MovingObstacles([mover], scene.footprint), max(mover.motion.last, 0.0)
        if crowd.clearance(goal, rests) > 0.0:
            continue
        times = np.linspace(0.0, rests, MOMENTS)
        free = [t for t in times.tolist() if crowd.clearance(goal, t) > 0.0]
        since = f"from {free[-1]:.2g} s on" if free else "all the time"
        return f"body {mover.name!r} covers the goal ({goal[0]:g}, {goal[1]:g}) {since}"
    return None
