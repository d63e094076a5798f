"""Keep what a robot senses in MuJoCo until it plans: scans, and where it believes to be."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.mapping.scan import Scan
from sim.sensing.lidar import LidarSensor

EARLY = 1e-9  # by which sums of physics steps may miss the time of a scan [s]


class Senses:
    """A lidar that turns at its rate, and a pose that may be wrong.

    Args:
        sensor: in the model that is simulated.
        deviation: standard deviation of the believed place, in x and y [m], and of the heading [rad]; drawn for every
            scan.
        rng: of all noise.
    """

    def __init__(self, sensor: LidarSensor, deviation: float, rng: np.random.Generator) -> None:
        self.sensor = sensor
        self.deviation = deviation
        self.rng = rng

        self.error = np.zeros(3)  # of the believed pose: x, y [m] and yaw [rad]
        self._scans = deque[Scan]()
        self._next = 0.0  # time of the next scan [s]

    def begin(self, data: mujoco.MjData, pose: Array, time: float) -> None:
        """Forget all scans, and take one at a pose (3,) and a time [s]."""
        self._scans.clear()
        self._next = time
        self.sense(data, pose, time)

    def sense(self, data: mujoco.MjData, pose: Array, time: float) -> None:
        """Take a scan at a pose (3,) if it is time [s] for one."""
        if time < self._next - EARLY:
            return
        self._next += self.sensor.lidar.period
        self.error = self.deviation * self.rng.standard_normal(3)
        scan = self.sensor.scan(data, pose, time, self.rng)
        self._scans.append(replace(scan, pose=self.sensor.lidar.mounted(pose + self.error)))

    def take(self) -> Sequence[Scan]:
        """Return the scans since it was last called."""
        return [self._scans.popleft() for _ in range(len(self._scans))]
