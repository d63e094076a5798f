"""Worlds and scores of BARN (Perille et al. 2020), by the rules of the challenge of 2026, in MuJoCo.

A course is walled in by cylinders; a Jackal starts at its closed end, and its goal is the disc of 1 m around a point
beyond the open one. The clock starts once the robot has moved 0.1 m; a collision, or 100 s, scores 0. Places are in the
frame of the challenge, moved by `ACROSS`, so that the corner of the workspace is the origin.
"""

import numpy as np

from pirrht.arrays import Array

SIZE = (4.5, 14.5)  # of the workspace [m]
START = (2.25, 3.0, 0.5 * np.pi)
GOAL = (2.25, 13.0, 1.0)
ACROSS = 4.5  # by which x is more than that of the challenge [m]
RADIUS = 0.075  # of the cylinders [m]
FASTEST = 2.0  # speed of the best time [m/s]
MOVED = 0.1  # way until the clock of a run starts [m]
MAX_TIME = 100.0  # [s]
KNOWN = {"max_time": MAX_TIME, "speed": 1.0, "margin": 0.05}  # a mean speed of 1 m/s scores most
SENSED = {**KNOWN, "speed": 1.4, "margin": 0.03}
COLUMNS, ROWS, FIRST, FILL = 30, 48, 34, 0.16  # cells of a grown world, those before its field, and their full share
CLEAR = 0.37  # that a way keeps from cylinders in grown worlds [m]


def score(outcome: str, time: float, best: float) -> float:
    """Return the score of a run that took a time, where the best one is known [s]; at most 0.5."""
    return best / float(np.clip(time, 2.0 * best, 8.0 * best)) if outcome == "goal" else 0.0


def waited(states: Array, step: float) -> float:
    """Return how long states (k, n), a step apart, take to have moved [s]."""
    away = np.hypot(*(states[:, :2] - START[:2]).T) > MOVED
    return step * float(np.argmax(away) if away.any() else len(away))
