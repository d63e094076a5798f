"""Where a state on the ground sits in MuJoCo's coordinates: in sliding joints, or in the pose of a body on wheels.

A robot that slides has one joint per state that is its place; states "vx" and "vy" are the speeds of its slides, and
"speed" is that of its body ahead. One that rolls has a free joint and wheels; its state is x, y and the unwrapped
heading of its body. It is placed at rest on its wheels, yet at its speed: the equation knows no start from standstill.
"""

from math import atan2, cos, remainder, sin, tau

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.states.adapter import Joints, StateAdapter

GROUND = "ground"  # the plane a rolling robot brings along, in its worldbody
_GEOM, _JOINT = mujoco.mjtGeom, mujoco.mjtJoint
_SINKAGE = 0.002  # of a robot at rest: height [m], and 1 - cosine of half the tilt
_SETTLING = 2.0  # time in which a robot on wheels comes to rest [s]


class PlanarJoints:
    """Translates states to slides along x and y, perhaps with a hinge about z."""

    rolls = False
    fly = None

    def __init__(self, model: mujoco.MjModel, states: StateAdapter) -> None:
        names = states.states
        self.names = states.pose[: model.nq]
        self.rates = (*states.velocities, *(states.speeds if model.nq > 2 else ()))
        self._places = [names.index(name) for name in states.pose if name in names]
        self._dofs = [i for i, name in enumerate(states.velocities) if name in names]
        self._speeds = [names.index(states.velocities[i]) for i in self._dofs]
        self._ahead = names.index("speed") if "speed" in names else None

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Place the robot at `state` (n,); twist and commands move no wheels."""
        data.qvel[:] = 0
        x, y, heading = [*state[self._places], 0.0][:3]
        data.qpos[:] = (x, y, heading)[: data.qpos.size]
        data.qvel[self._dofs] = state[self._speeds]
        if self._ahead is not None:
            data.qvel[:2] = state[self._ahead] * cos(heading), state[self._ahead] * sin(heading)

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """Return the state now, (n,); other components are those of the step before."""
        if not self._speeds and self._ahead is None:
            return data.qpos.copy()  # type: ignore[no-any-return]
        state = before.copy()
        state[self._places] = data.qpos
        state[self._speeds] = data.qvel[self._dofs]
        if self._ahead is not None:
            state[self._ahead] = data.qvel[0] * cos(data.qpos[2]) + data.qvel[1] * sin(data.qpos[2])
        return state


class FreeJointBase:
    """Translates x, y and heading to the pose of a body on wheels."""

    rolls = True
    fly = None
    rates = ()

    def __init__(self, model: mujoco.MjModel, states: StateAdapter) -> None:
        names = states.states
        self.names = states.pose
        self._rest = (model.key_qpos[0] if model.nkey else model.qpos0).copy()
        self._wheels = model.jnt_dofadr[model.actuator_trnid[:, 0]]
        self._places = [names.index(name) for name in states.pose if name in names]

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Place the robot at `state` (n,); wheels roll with `twist` (2,) under the commands `ctrl` (nu,)."""
        data.qvel[:] = 0
        x, y, heading = [*state[self._places], 0.0][:3]
        data.qpos[:] = self._rest
        turn_to(data.qpos, heading)
        data.qpos[:2] = x, y
        data.qvel[:2] = twist[0] * cos(heading), twist[0] * sin(heading)
        data.qvel[5] = twist[1]
        np.add.at(data.qvel, self._wheels, ctrl)  # several actuators may drive a wheel

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """Return the state now, (n,), given the one of the step before, from which the heading goes on."""
        x, y, _, *quaternion = data.qpos[:7].tolist()
        return np.array([x, y, before[2] + remainder(heading_of(quaternion) - before[2], tau)])


def joints_of(model: mujoco.MjModel, states: StateAdapter) -> Joints:
    """Return what translates states to the joints of the robot in a joined model, whose keyframe 0 holds it at rest."""
    return FreeJointBase(model, states) if rolls(model) else PlanarJoints(model, states)


def rolls(model: mujoco.MjModel) -> bool:
    """Whether the robot moves by a free joint."""
    return bool(model.njnt > 0 and model.jnt_type[0] == _JOINT.mjJNT_FREE)


def unfit(model: mujoco.MjModel, states: StateAdapter, system: str) -> str:
    """Refuse a robot that moves by joints of no pose.

    Returns why they are not those of the states of a system; nothing if they are.
    """
    if rolls(model):
        _check_wheels(model)
        no = f'a robot with a free joint has a heading, and {system} has none: name the dynamics "unicycle"'
        return "" if states.turns else no
    joints = (
        f'body "robot" must have these joints, without ref, for the states ({", ".join(states.states)}) of {system}: '
        "slide along x, slide along y" + (", hinge about z; or a free joint and wheels" if states.turns else "")
    )
    if not _slides(model):
        raise SceneError(joints)
    return "" if model.nq == len(states.places) else joints


def _slides(model: mujoco.MjModel) -> bool:
    """Return whether a robot slides along x and y, perhaps turns about z at its origin, and has no other joint."""
    types = [_JOINT.mjJNT_SLIDE, _JOINT.mjJNT_SLIDE, _JOINT.mjJNT_HINGE][: model.nq]
    if model.nq < 2 or list(model.jnt_type) != types or np.any(model.qpos0):
        return False
    return np.allclose(model.jnt_axis, np.eye(3)[: model.nq]) and not np.any(model.jnt_pos[:, :2])


def _check_wheels(model: mujoco.MjModel) -> None:
    """Refuse a robot on wheels whose free joint, ground or actuators are not as they must be."""
    if int(model.jnt_bodyid[0]) != model.body("robot").id:
        raise SceneError('body "robot" must have the free joint itself')
    ground = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, GROUND)
    plane = ground >= 0 and model.geom_type[ground] == _GEOM.mjGEOM_PLANE and not np.any(model.geom_pos[ground])
    if not plane or model.geom_contype[ground] or model.geom_conaffinity[ground]:
        raise SceneError(
            f'a robot on wheels needs a plane geom "{GROUND}" of its own at the origin, contype="0" conaffinity="0", '
            "which wheels meet in contact pairs"
        )
    hinged = model.jnt_type[model.actuator_trnid[:, 0]] == _JOINT.mjJNT_HINGE
    if not np.all((model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & hinged):
        raise SceneError("every actuator of a robot on wheels must drive a hinge joint")


def rest_pose(model: mujoco.MjModel) -> Array:
    """Return joint positions (nq,) at the origin, heading along x; on wheels once the robot has come to rest."""
    rest: Array = model.qpos0.copy()
    if rolls(model):
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=max(1, round(_SETTLING / model.opt.timestep)))
        rest[2:7] = data.qpos[2:7]
        turn_to(rest, 0.0)
        if not (abs(rest[2]) < _SINKAGE and rest[3] > 1 - _SINKAGE):  # also when the simulation has diverged
            raise SceneError(
                f'body "robot" does not come to rest on wheels (height {rest[2]:.2g} m); let them and casters touch '
                f'the plane z = 0 and give each a contact pair with geom "{GROUND}"'
            )
    return rest


def turn_to(qpos: Array, heading: float) -> None:
    """Turn a free joint about the vertical to a heading [rad], in place, keeping its tilt."""
    half = 0.5 * (heading - heading_of(qpos[3:7]))
    turned = np.empty(4)
    mujoco.mju_mulQuat(turned, np.array([cos(half), 0.0, 0.0, sin(half)]), qpos[3:7])
    qpos[3:7] = turned


def heading_of(quaternion: Array | list[float]) -> float:
    """Direction of the body's x-axis seen from above, in (-pi, pi] [rad]."""
    w, x, y, z = quaternion
    return atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
