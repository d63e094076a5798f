"""Where a state in space sits in MuJoCo's coordinates: in slides along x, y and z, or in a free body with rotors."""

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.states import rotors
from sim.states.adapter import Joints, StateAdapter


class Slides:
    """Translates states to slides along x, y and z."""

    rolls = False
    fly = None

    def __init__(self, states: StateAdapter) -> None:
        self.names = states.pose
        self.rates = states.velocities
        known = [(k, states.states.index(name)) for k, name in enumerate(self.rates) if name in states.states]
        self._axes = [axis for axis, _ in known]  # of which the speed is a state
        self._speeds = [place for _, place in known]

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Place the robot at `state` (n,)."""
        data.qpos[:] = state[:3]
        data.qvel[:] = 0.0
        data.qvel[self._axes] = state[self._speeds]

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """Return the state now, (n,)."""
        state = before.copy()
        state[:3] = data.qpos
        state[self._speeds] = data.qvel[self._axes]
        return state


def joints_of(model: mujoco.MjModel, states: StateAdapter) -> Joints:
    """Return what translates states to the joints of the robot in a joined model."""
    return rotors.Rotors(model, states) if _free(model) else Slides(states)


def unfit(model: mujoco.MjModel, states: StateAdapter, system: str) -> str:
    """Refuse a robot that moves by other joints than slides along x, y and z, or a free joint with rotors."""
    if _free(model):
        return rotors.unfit(model, states, system)
    slides = [mujoco.mjtJoint.mjJNT_SLIDE] * 3
    if list(model.jnt_type) == slides and np.allclose(model.jnt_axis, np.eye(3)) and not np.any(model.qpos0):
        return ""
    raise SceneError(
        f'body "robot" must have these joints, without ref, for the states ({", ".join(states.states)}) of {system}: '
        "slide along x, slide along y, slide along z; or a free joint and rotors"
    )


def _free(model: mujoco.MjModel) -> bool:
    return bool(model.njnt > 0 and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE)
