"""A tug of 20 kg that two thrusters push through water, which brakes it: velocity is state, force is control.

cd scripts/examples/systems && pirrht run slit --robot tug.xml --system tug:TUG
"""

import numpy as np

from pirrht.steering.double_integrator import MassSteering
from pirrht.systems.double_integrator import DoubleIntegrator
from sim.systems import System

DRAG = 0.4  # of the water over the mass, as `damping` 8 N s/m over 20 kg in tug.xml [1/s]


class Tug(DoubleIntegrator):  # dp = v dt, dv = (u - DRAG v) dt + b dw
    parameters = np.array([DRAG])

    @staticmethod
    def drift(x, p, out):  # compiled by numba
        out[0], out[1], out[2], out[3] = x[2], x[3], -p[0] * x[2], -p[0] * x[3]

    def twist(self, x, rate):  # `rate` is dv/dt [m/s^2]; the water brakes by itself, so thrust is what is left
        return rate + DRAG * x[2:]


TUG = System(
    name="tug",
    dynamics=lambda settings: Tug(b=settings.noise),
    steering=MassSteering.of,  # without drag: guides make up for it
    R=2.0 * np.eye(2),
    states=("x", "y", "vx", "vy"),
    defaults={"samples": 300, "period": 0.05},
    own=("samples", "period"),  # scenes for other robots do not set these
)
