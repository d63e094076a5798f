"""Moving obstacles: mocap bodies whose motions stand in the scene as custom numerics `pirrht_motion_BODY`.

In MuJoCo they move about the vertical through where they stand.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, remainder, tau

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.obstacle import Motion, Mover, Obstacle, about_vertical
from pirrht.geometry.scene import Scene
from sim.mjcf.coordinates import heading_of
from sim.mjcf.limits import listed, refuse_far
from sim.mjcf.obstacles import MOTION, Mask

NEAR = 1e-6  # by which a first row may miss the place where its body stands [m]
TURNED = 1e-3  # and its yaw there [rad]: people write pi/2 with four digits
ROWS = "rows of four numbers: t x y yaw [s, m, m, rad]"
_ABOUT_VERTICAL = np.array([-1.0, -1.0, 1.0, 1.0])  # k (w, x, y, z) = (-z, -y, x, w)


def read_motions(spec: mujoco.MjSpec) -> dict[str, Motion]:
    """The motions of a scene by the names of their bodies, in the order of the file."""
    rows = {n.name: np.array(list(n.data)) for n in spec.numerics if n.name.startswith(MOTION)}
    texts = {t.name: str(t.data) for t in spec.texts if t.name.startswith(MOTION)}
    for name, text in texts.items():
        if name not in rows or text != "repeat":
            known = listed([f'"{one}"' for one in rows]) or "none"
            raise SceneError(
                f'custom text "{name}" is "{text}"; write "repeat" for one of the motions here, which are {known}, add '
                f'<numeric name="{name}" data="0 x y yaw  t x y yaw ..."/>, or remove it: a body stops at its last row'
            )
    return {name.removeprefix(MOTION): _motion(spec, name, data, name in texts) for name, data in rows.items()}


def _motion(spec: mujoco.MjSpec, name: str, data: Array, repeat: bool) -> Motion:
    """The motion that a numeric of that name gives a body, which must be able to move so."""
    label, called = f'custom numeric "{name}"', name.removeprefix(MOTION)
    body, why = spec.body(called), ""
    if body is None:
        why = "is not there"
    elif joints := body.find_all(mujoco.mjtObj.mjOBJ_JOINT):
        why = f'has joint "{joints[0].name}"' if joints[0].name else "has a joint"
    elif not body.mocap:
        why = "is no mocap body"
    if why:
        known = listed([f'"{b.name}"' for b in spec.bodies if b.mocap and b.name]) or "none"
        raise SceneError(
            f'{label} moves body "{called}", which {why}; write <body name="{called}" mocap="true" ...> without joints '
            f"in the worldbody, or name another; bodies that can move are {known}"
        )
    if data.size % 4 or not (data.any() or data.size == 4):
        zeros = "" if data.any() else " that are all 0"
        raise SceneError(f"{label} is of {data.size} numbers{zeros}; write {ROWS}")
    try:
        motion = Motion(rows=data.reshape(-1, 4), repeat=repeat)
    except SceneError as error:
        raise SceneError(f"{label}: {error}; write {ROWS}, in order") from None
    refuse_far(label, motion.rows)
    return motion


def moved_geoms(model: mujoco.MjModel, motions: Mapping[str, Motion]) -> Mask:
    """The geoms that move with bodies of these names, those of bodies inside them too, (ngeom,)."""
    roots = [model.body(name).id for name in motions]
    return np.asarray(np.isin(model.body_rootid[model.geom_bodyid], roots))


def read_movers(
    model: mujoco.MjModel, data: mujoco.MjData, motions: Mapping[str, Motion], solids: Mapping[int, Obstacle]
) -> tuple[Mover, ...]:
    """Moving obstacles, in the order of the motions by body, given whatever the robot can collide with by geom."""
    roots = model.body_rootid[model.geom_bodyid]
    movers = []
    for name, motion in motions.items():
        body = int(model.body(name).id)
        (x, y, z), yaw = data.xpos[body].tolist(), heading_of(data.xquat[body])
        _, x0, y0, yaw0 = motion.rows[0]
        if max(abs(x0 - x), abs(y0 - y)) > NEAR or abs(remainder(yaw0 - yaw, tau)) > TURNED:
            raise SceneError(
                f'body "{name}" stands at ({x:g}, {y:g}) with yaw {yaw:.6g}, and the first row of "{MOTION}{name}" is '
                f"({x0:g}, {y0:g}) with yaw {yaw0:.6g}, a jump at the start; let it stand there, "
                f'pos="{x0:g} {y0:g} {z:g}" and turned so, or begin with "0 {x:g} {y:g} {yaw:.6g}"'
            )
        turn = about_vertical(-yaw0)  # into the frame of the body at yaw 0
        mine = tuple(
            replace(one, position=turn @ (one.position - np.array([x0, y0, 0.0])), rotation=turn @ one.rotation)
            for geom, one in solids.items()
            if roots[geom] == body
        )
        if not mine:
            raise SceneError(
                f'body "{name}" moves, and none of its geoms can touch the robot; match their contype and conaffinity '
                f'and let them reach into its height, or remove "{MOTION}{name}"'
            )
        movers.append(Mover(name=name, solids=mine, motion=motion))
    return tuple(movers)


def clearance_at_start(scene: Scene) -> tuple[float, str]:
    """Clearance of the footprint from the nearest moving obstacle where the robot starts [m], and the body's name."""
    if not scene.movers:
        return inf, ""
    from pirrht.moving.collision import MovingObstacles  # FCL is slow to import, and few scenes move

    crowds = {mover.name: MovingObstacles([mover], scene.footprint) for mover in scene.movers}
    return min((float(crowd.clearance(scene.start[:2], 0.0)), name) for name, crowd in crowds.items())


class Mocap:
    """Places the J moving bodies of a model: x, y and yaw by the motion, height and tilt as the file has them."""

    def __init__(self, model: mujoco.MjModel, movers: Sequence[Mover]) -> None:
        bodies = [int(model.body(mover.name).id) for mover in movers]
        self._motions = [mover.motion for mover in movers]
        self._rows = model.body_mocapid[bodies]
        self._heights = model.body_pos[bodies, 2]
        yaws = np.array([motion.rows[0, 3] for motion in self._motions])
        self._upright = _turned(model.body_quat[bodies], -yaws)  # at yaw 0

    def place(self, data: mujoco.MjData, time: float) -> None:
        """Place the bodies as they are at a time [s]."""
        poses = np.array([motion.pose_at(time) for motion in self._motions])
        data.mocap_quat[self._rows] = _turned(self._upright, poses[:, 2])
        poses[:, 2] = self._heights
        data.mocap_pos[self._rows] = poses

    def poses(self, times: Array) -> tuple[Array, Array]:
        """Places (k, J, 3) [m] and quaternions (k, J, 4), w first, at times (k,) [s]."""
        found = np.stack([motion.pose(times) for motion in self._motions], axis=1)
        heights = np.broadcast_to(self._heights, found.shape[:2])
        return np.dstack([found[..., :2], heights]), _turned(self._upright, found[..., 2])


def _turned(quaternions: Array, yaws: Array) -> Array:
    """Quaternions (..., 4), w first, turned about the vertical by yaws (...) [rad]."""
    half = 0.5 * yaws[..., None]
    return np.asarray(np.cos(half) * quaternions + np.sin(half) * (_ABOUT_VERTICAL * quaternions[..., ::-1]))
