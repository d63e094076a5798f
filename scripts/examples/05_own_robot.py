"""Describe a robot of your own, a balloon in the wind with gusts that are stronger one way, and run it."""

import numpy as np

from pirrht import Dynamics
from sim.scenario import prepare
from sim.systems import System, register

WIND = np.array([0.3, 0.1])  # [m/s]
GUSTS = np.array([[0.14, 0.02], [0.02, 0.08]])  # B [m/sqrt(s)]
LAMBDA = 0.02  # [cost]; R = lambda (B B')^-1


class Balloon(Dynamics):  # dx = (wind + u) dt + B dw
    n, m, parameters = 2, 2, WIND
    control_block, diffusion_block = np.eye(2), GUSTS

    @staticmethod
    def drift(x, p, out):  # compiled by numba
        out[0], out[1] = p[0], p[1]

    def twist(self, x, rate):  # the velocity command: wind, control and noise together
        return rate


register(
    System(name="balloon", dynamics=lambda settings: Balloon(), R=LAMBDA * np.linalg.inv(GUSTS @ GUSTS.T), heeds=())
)
few = {"vertices": 200, "samples": 60, "period": 0.1, "max_time": 2.0}
scenario = prepare("slit", system="balloon", given={**few, "plant": "sde"})
controller = scenario.driver(scenario.grown_tree())
for frame in scenario.drive(scenario.plant(), controller):
    last = frame
print(f"after {last.time:.2f} s at {np.round(last.state, 2)}, class {last.plan.favourite}, cost {last.cost:.3f}")
