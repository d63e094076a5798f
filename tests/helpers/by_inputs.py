"""Systems whose noise enters through their inputs, and the scene of the number that plain simulation gave for one."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from discs import disc, scene_of
from scooter import Scooter

from pirrht import Problem, Scene
from pirrht.jit.jit import jitable
from pirrht.systems.double_integrator import coasting, into_goal
from pirrht.systems.dynamics import Dynamics, no_drift

RADIUS = 0.004  # of a robot that stands for a point, by which its obstacle is smaller [m]


@dataclass(frozen=True, eq=False)
class Driven(Scooter):
    """The scooter of the examples with other noise, along the heading of a step's start or of its middle."""

    stratonovich: bool = False  # type: ignore[misc]
    s: tuple[float, float] = (0.5, 1.0)  # [m/sqrt(s)], [rad/sqrt(s)]

    drift = staticmethod(no_drift)  # known to be none

    @cached_property
    def input_noise(self) -> np.ndarray:  # type: ignore[override]
        return np.diag(self.s)


@jitable
def homing_of_mass(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """That of the mass, whose B has two rows."""
    into_goal(x, p, B[2:], aim, radius, rate, out)


class PushedMass(Dynamics):
    """The mass of `DoubleIntegrator` in input form, b = 0.1 m/s/sqrt(s)."""

    n = 4
    m = 2
    states = ("x", "y", "vx", "vy")
    parameters = np.zeros(0)
    drift = staticmethod(coasting)
    input_matrix = np.vstack([np.zeros((2, 2)), np.eye(2)])
    input_noise = 0.1 * np.eye(2)

    homing = staticmethod(homing_of_mass)

    def twist(self, x: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return rate


def around_a_disc() -> Scene:
    """A goal disc of 0.3 m, and one disc of 0.2 m beside the way to it."""
    post = disc("post", 0.35, -0.25, 0.2 - RADIUS)
    return scene_of(
        [post], start=(0.0, 0.0, 0.4), goal=(0.8, 0.2, 0.3), lower=(-1.0, -1.0), side=(2.0, 1.5), radius=RADIUS
    )


def driven(*, stratonovich: bool = False) -> Problem:
    """The car in that scene: R = diag(2, 0.5), lambda = 0.5, q = 1."""
    return Problem(dynamics=Driven(stratonovich), scene=around_a_disc(), R=np.diag([2.0, 0.5]))
