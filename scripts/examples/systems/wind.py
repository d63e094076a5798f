"""A balloon that a wind carries and gusts shake, more along the wind than across: both states are actuated.

cd scripts/examples/systems && pirrht run slit --system wind:BALLOON
"""

import numpy as np

from pirrht import Dynamics, StraightLine
from sim.systems import System

WIND = np.array([0.3, 0.1])  # [m/s]
GUSTS = np.array([[0.14, 0.02], [0.02, 0.08]])  # B: how noise moves it [m/sqrt(s)]
LAMBDA = 0.02  # [cost]; R = lambda (B B')^-1: what noise shakes is cheap to push


class Balloon(Dynamics):
    n, m, parameters = 2, 2, WIND
    control_block, diffusion_block = np.eye(2), GUSTS

    @staticmethod
    def drift(x, p, out):  # compiled by numba
        out[0], out[1] = p[0], p[1]

    def twist(self, x, rate):  # `rate` is wind, control and noise together [m/s]: what the servos are commanded
        return rate


class OverGround(StraightLine):  # straight lines at 1 m/s over ground, whatever the wind
    def controls(self, heading, curvature):
        return super().controls(heading, curvature) - WIND


BALLOON = System(
    name="balloon",
    dynamics=lambda settings: Balloon(),
    steering=lambda problem: OverGround(pace=1.0, cost_rate=2.0),
    R=LAMBDA * np.linalg.inv(GUSTS @ GUSTS.T),
    heeds=(),  # of --noise, --speed and --rho none
)
