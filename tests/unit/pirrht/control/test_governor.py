"""Controls keep to speeds from which a robot can stop, among what stands and what moves."""

import numpy as np
import pytest

from pirrht import FreeSpace, Scene, SingleIntegrator
from pirrht.control.governor import Governor
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.solids import discs

pytestmark = pytest.mark.slow  # kernels are compiled
TASK = {"lower": (0, 0), "upper": (6, 4), "start": (1, 2), "goal": (5, 2, 0.3), "robot_radius": 0.2}


def share(x: float, y: float, velocity: tuple[float, float], now: float = 0.0) -> float:
    """Of 1 m/s to the right from (1, 2) while a disc of 0.3 m is at a place at 0 s and moves."""
    ends = np.array([(x, y), np.add((x, y), np.multiply(10.0, velocity))])
    rows = np.column_stack([[0.0, 10.0], ends, np.zeros(2)])
    mover = Mover(name="one", solids=discs([[0, 0, 0.3]], 1.0), motion=Motion(rows=rows))
    space = FreeSpace.of(Scene.from_boxes([[5.5, 3.5, 5.8, 3.8]], **TASK)).among([mover])
    governor = Governor(dynamics=SingleIntegrator(b=0.1), world=space.world, now=now, deceleration=2.0)
    return float(governor.admissible(np.array([1.0, 2.0]), np.array([1.0, 0.0]))[0])


@pytest.mark.parametrize(
    ("x", "y", "velocity", "now", "least", "most"),
    [(1.7, 2, (0, 0), 0, 0.3, 0.8), (3.0, 2, (0, 0), 0, 1, 1),  # it stands, near and far
     (1.75, 2, (-0.8, 0), 0, 0, 0.3), (1.75, 2, (0.8, 0), 0, 1, 1),  # it comes, and goes away
     (1.6, 1.2, (0, 2), 0, 0, 0.8), (1.6, 1.2, (0, 2), 1.0, 1, 1)],  # it crosses, and has crossed
)  # fmt: skip
def test_a_robot_keeps_to_a_speed_from_which_it_stops_before_what_moves(x, y, velocity, now, least, most):
    assert least <= share(x, y, velocity, now) <= most
