"""A lidar in MuJoCo: rays in one plane to whatever the robot collides with, where that is now.

Rays meet meshes themselves, where contacts and plans have their convex hulls. The border of a workspace is no solid, so
no ray ends there.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, fields
from math import ceil, hypot, inf

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.mapping.scan import Scan
from sim.mjcf import Loaded
from sim.text import suggestion

SEEN, UNSEEN = 0, 1  # groups of geoms
FORM = "rays=360,fov=360"  # of a lidar's text
SPARSE = 10.0  # from ray to ray at most: 0.17 m at a distance of 1 m [degrees]
_MUST: dict[str, tuple[Callable[[float], bool], str]] = {
    "fov": (lambda value: 0 < value <= 360, "above 0 and at most 360 [degrees]"),
    "rays": (lambda value: value in range(2, 100_001), "a whole number from 2 to 100000"),
    "least": (lambda value: 0 <= value < inf, "0 or more [m]"),
    "most": (lambda value: 0 < value < inf, "a positive number [m]"),
    "sigma": (lambda value: 0 <= value < inf, "0 or more [m]"),
    "rate": (lambda value: 0 < value < inf, "a positive number [Hz]"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Lidar:
    """A lidar and its place on the robot; by default that of the BARN challenge.

    Its text is a list such as `rays=360,fov=360`, with the names of fields. OptionError: a number cannot be.
    """

    fov: float = 270.0  # field of view, half of it to each side [degrees]
    rays: int = 720  # over the field of view, its ends included
    least: float = 0.1  # range from which on something is measured [m]
    most: float = 30.0  # up to which it is [m]
    sigma: float = 0.001  # standard deviation of a range [m]
    rate: float = 10.0  # of scans [Hz]
    x: float = 0.0  # from the robot's centre, ahead [m]
    y: float = 0.0  # and to the left [m]
    z: float | None = None  # above the ground [m]; None: the height at which the robot plans
    yaw: float = 0.0  # from the robot's heading [rad]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            valid, must = _MUST.get(field.name, (np.isfinite, "a finite number"))
            if not (value is None and field.default is None) and not valid(value):
                raise OptionError(f"the lidar's {field.name} is {value!r}; it must be {must}")
        if self.least >= self.most:
            raise OptionError(f"the lidar's least range is {self.least:g} m; it must be below the most, {self.most:g}")
        if self.fov > SPARSE * (self.rays - 1):
            raise OptionError(
                f"the lidar's {self.rays} rays are {self.fov / (self.rays - 1):.3g} degrees apart, and obstacles fit "
                f"in between; for a fov of {self.fov:g} write rays={ceil(self.fov / SPARSE) + 1} or more"
            )

    @classmethod
    def of(cls, text: str) -> "Lidar":
        """The lidar of a text, which names what differs from the defaults; OptionError: it is none."""
        known = [field.name for field in fields(cls)]
        given = dict[str, float]()
        for item in filter(None, text.replace(",", " ").split()):
            name, _, number = item.partition("=")
            if name not in known:
                like = suggestion(name, known) or f"; those are {', '.join(known)}"
                raise OptionError(f"a lidar has no {name[:40]!r}{like}: write {FORM}")
            if name in given:
                raise OptionError(f"the lidar's {name} is given twice: write {FORM}")
            try:
                value = float(number)
            except ValueError:
                raise OptionError(f"the lidar's {name} is {number[:40]!r}; it must be a number: write {FORM}") from None
            given[name] = int(value) if name == "rays" and value.is_integer() else value
        return cls(**given)  # type: ignore[arg-type]

    @property
    def period(self) -> float:
        """Time from scan to scan [s]."""
        return 1.0 / self.rate

    @property
    def angles(self) -> Array:
        """Angles of the rays from the sensor's x-axis, from the right to the left, (rays,) [rad]."""
        half = np.deg2rad(0.5 * self.fov)
        return np.linspace(-half, half, self.rays)

    def mounted(self, pose: Array) -> Array:
        """Pose of the sensor on a robot at x, y, yaw, (3,) [m, m, rad]."""
        c = np.cos(pose[2])
        s = np.sin(pose[2])
        return np.add(pose, (c * self.x - s * self.y, s * self.x + c * self.y, self.yaw))


class LidarSensor:
    """A lidar among the obstacles of a loaded scene, which does not see the robot, or what it cannot collide with.

    OptionError: it is not on the robot, sees no farther than that is wide, or lies above or below all obstacles.
    """

    def __init__(self, loaded: Loaded, lidar: Lidar) -> None:
        self.lidar = lidar
        self._angles = lidar.angles
        self._height = loaded.scene.robot_height if lidar.z is None else lidar.z
        model = self._model = copy(loaded.model)  # rays pass what is of another group, or drawn as transparent
        model.geom_group[:] = np.where(loaded.obstacle_geoms, SEEN, UNSEEN)
        model.geom_rgba[:, 3] = 1.0
        model.geom_matid[:] = -1
        self._refuse_blind(loaded)

    def _refuse_blind(self, loaded: Loaded) -> None:
        """Refuse a lidar that is not on the robot, or cannot see any obstacle."""
        lidar = self.lidar
        reach = loaded.scene.body.reach
        if hypot(lidar.x, lidar.y) > reach:
            raise OptionError(f"the lidar is at x={lidar.x:g}, y={lidar.y:g}; on this robot it is within {reach:.3g} m")
        if lidar.most <= reach:
            raise OptionError(f"the lidar's most is {lidar.most:g} m; it must be above the robot's reach, {reach:.3g}")
        data = mujoco.MjData(self._model)
        mujoco.mj_resetDataKeyframe(self._model, data, 0)
        mujoco.mj_kinematics(self._model, data)
        boxes = self._model.geom_aabb[loaded.obstacle_geoms]
        up = data.geom_xmat[loaded.obstacle_geoms, 6:]
        middles = data.geom_xpos[loaded.obstacle_geoms, 2] + (up * boxes[:, :3]).sum(axis=1)
        off = np.abs(self._height - middles) - (np.abs(up) * boxes[:, 3:]).sum(axis=1)
        if len(off) and off.min() > 0.0:
            near = middles[off.argmin()]
            raise OptionError(f"at z={self._height:g} the lidar sees no obstacle; one is there at z={near:.3g}")

    def scan(self, data: mujoco.MjData, pose: Array, time: float, rng: np.random.Generator) -> Scan:
        """Scan what is around the robot at x, y, yaw (3,), with bodies where MuJoCo's data has them.

        Ranges are noisy, then those beyond the greatest become inf and those below the least -inf. Each ray takes one
        number of `rng`.
        """
        lidar = self.lidar
        sensor = lidar.mounted(pose)
        along = self._angles + sensor[2]
        rays = np.column_stack([np.cos(along), np.sin(along), np.zeros(lidar.rays)])
        ranges = np.empty(lidar.rays)
        geoms = np.empty(lidar.rays, np.int32)
        group = np.arange(mujoco.mjNGROUP) == SEEN
        mujoco.mj_multiRay(
            self._model, data, np.append(sensor[:2], self._height), rays.ravel(), group.astype(np.uint8), True, -1,
            geoms, ranges, None, lidar.rays, 2.0 * lidar.most,
        )  # fmt: skip
        ranges[geoms < 0] = inf
        ranges += lidar.sigma * rng.standard_normal(lidar.rays)
        ranges[ranges > lidar.most] = inf
        ranges[ranges < lidar.least] = -inf
        return Scan(pose=sensor, angles=self._angles, ranges=ranges, most=lidar.most, time=time)
