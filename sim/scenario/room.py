"""The margin of scenes that ask for none: how far noise moves the robot before it reacts, if there is room for it."""

from __future__ import annotations

import numpy as np

from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import find_passages
from pirrht.problem import Problem

REACTION = 0.01  # how long feedback takes to answer noise [s]
DEVIATIONS = 3.0  # of the robot's place after that time without control
LEAST = 0.01  # margin [m]: contacts and servos are not exact either
SHARE = 0.25  # of the room that the robot has in the narrowest passage, at the start and at the goal point
STEPS = 20  # of that time, by which the noise adds up
WORTH = 2e-3  # a smaller margin is none [m]


def default_margin(problem: Problem, space: FreeSpace, reaction: float) -> float:
    """The margin [m] for a problem without one; 0 where there is no room.

    It is three standard deviations of the place that noise alone moves the robot to before it reacts [s], and takes
    no more than a quarter of the room anywhere, so that no class is lost.
    """
    scene = space.scene
    ends = space.collision.clearance(np.array([scene.start[:2], scene.goal.center[:2]]))
    if scene.goal is not problem.scene.goal:  # its centre is covered, and plans lead to what is free with the margin
        ends = ends[:1]
    if scene.movers:
        ends = np.append(ends, space.crowd.clearance(scene.start[:2], 0.0))
    widths = find_passages(space.field, space.collision).width
    room = min(float(ends.min()), 0.5 * float(widths.min(initial=np.inf)) - scene.robot_radius)
    margin = min(max(LEAST, DEVIATIONS * _deviation(problem, reaction)), SHARE * room)
    return round(margin, 4) if margin > WORTH else 0.0


def _deviation(problem: Problem, time: float) -> float:
    """Standard deviation of the place after a time [s] from the start, along its worst direction [m]."""
    d, h = problem.dynamics, time / STEPS
    start = d.state_of(problem.scene.start)
    still, shift = np.zeros(d.m), 1e-4
    total = np.zeros((2, 2))
    for i in range(STEPS):  # noise of one step each, carried on to the end; the equation is linear in it
        ends = []
        for j in range(d.m):
            for sign in (shift, -shift):
                x = d.step(start, still, sign * np.eye(d.m)[j], h)
                for _ in range(STEPS - 1 - i):
                    x = d.step(x, still, still, h)
                ends.append(x[:2])
        moved = (np.array(ends[::2]) - np.array(ends[1::2])) / (2.0 * shift)
        total += h * moved.T @ moved
    return float(np.sqrt(np.linalg.eigvalsh(total)[-1]))
