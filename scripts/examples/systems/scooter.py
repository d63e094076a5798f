"""A scooter with two inputs, speed and turn rate, and noise on both; it may stand, and turn on the spot.

cd scripts/examples/systems && pirrht run slit --robot unicycle --system scooter:SCOOTER
"""

import numpy as np

from pirrht import Dubins, Dynamics
from sim.systems import System

SHAKEN = np.diag([0.1, 0.2])  # s: noise of the speed [m/sqrt(s)] and of the turn rate [rad/sqrt(s)]


class Scooter(Dynamics):  # dx = G(x) (u dt + s dw)
    n, m, states, parameters = 3, 2, ("x", "y", "heading"), np.zeros(0)
    input_noise = SHAKEN

    @staticmethod
    def drift(x, p, out):  # compiled by numba; without inputs it stands
        out[:] = 0.0

    @staticmethod
    def input_matrix(x, p, out):  # G, (3, 2), zero before; compiled likewise
        out[0, 0], out[1, 0], out[2, 1] = np.cos(x[2]), np.sin(x[2]), 1.0

    def twist(self, x, rate):  # the inputs with their noise: forward speed [m/s] and turn rate [rad/s]
        return rate


class Bends(Dubins):  # its references: lines and arcs of at least rho, at speed V
    def controls(self, heading, curvature):
        return np.column_stack([np.full(len(curvature), self.V), self.V * curvature])


SCOOTER = System(
    name="scooter", dynamics=lambda settings: Scooter(), steering=lambda problem: Bends(V=1.0, rho=0.5),
    R=0.02 * np.linalg.inv(SHAKEN @ SHAKEN.T), states=Scooter.states, heeds=(),  # lambda = 0.02 [cost]
)  # fmt: skip
