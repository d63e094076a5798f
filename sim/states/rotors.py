"""Where a state in space sits in a multicopter: a free body that rotors lift and turn, and the loop that does so.

A wanted acceleration a asks for the force F = m (a - g), within `STEEPEST` of the vertical. Rotors push along the
body's z-axis alone, so the loop turns that axis to F, with the x-axis ahead. With the attitude R, the wanted one R_d
and the rates w of the body, torques are J (-k^2 e - 2 k w) + w x J w, where e is half of the skew part of R_d' R, as a
vector: critically damped, at the rate k. Rotors thrust as much of F as lies along the axis, but for a `RESERVE` that
turns the body, also upside down; torques shrink until every rotor keeps to its ctrlrange.
"""

import copy
from math import hypot

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.states.adapter import StateAdapter

TILTING, HEADING = 40.0, 8.0  # rates k of the loop about level axes and the vertical one [1/s]
STEEPEST = 1.7  # level part of a force, at most, over its part upwards: 60 degrees
LEAST = 0.2  # part upwards, at least, over the weight
RESERVE = 0.1  # share of the range of thrusts at either end
ALIKE = 1e-6  # parts of forces [N] and torques [Nm] that count as none
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


class Rotors:
    """Translates states to the pose of a free body, level unless its quaternion follows a state; and flies it."""

    rolls = True

    def __init__(self, model: mujoco.MjModel, states: StateAdapter) -> None:
        self.names = states.pose
        self.rates = states.velocities
        self._axes = [axis for axis, name in enumerate(self.rates) if name in states.states]
        self._speeds = [states.states.index(self.rates[axis]) for axis in self._axes]
        self._n = len(states.states)

        self._root = int(model.jnt_bodyid[0])
        self._mass = float(model.body_subtreemass[self._root])
        self._gravity = model.opt.gravity.copy()
        self._inertia, wrenches = _wrenches(model)
        self._mixer = np.linalg.pinv(wrenches[:, 2:].T)  # (nu, 4) commands of thrust and torques
        limited = model.actuator_ctrllimited.astype(bool)[:, None]
        self._low, self._high = np.where(limited, model.actuator_ctrlrange, (-np.inf, np.inf)).T
        low, high = (float(wrenches[:, 2] @ ctrl) for ctrl in (self._low, self._high))
        reserve = RESERVE * (high - low) if np.isfinite(high - low) else 0.0
        self._least = low + reserve
        self._most = high - reserve

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Place the robot at `state` (n,), or with its attitude (n + 4,); without it, level."""
        data.qpos[:3] = state[:3]
        data.qpos[3:7] = state[self._n :] if len(state) == self._n + 4 else LEVEL
        data.qvel[:] = 0.0
        data.qvel[self._axes] = state[self._speeds]

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """Return the state now, (n,)."""
        state = before.copy()
        state[:3] = data.qpos[:3]
        state[self._speeds] = data.qvel[self._axes]
        return state

    def fly(self, data: mujoco.MjData, wanted: Array, made: Array) -> None:
        """Command rotors for an acceleration (3,) that is wanted; a gust adds what is `made` beyond it [m/s^2]."""
        R = data.xmat[self._root].reshape(3, 3)
        force = self._mass * (wanted - self._gravity)
        force[2] = max(force[2], LEAST * self._mass * -self._gravity[2])
        force[:2] *= min(1.0, STEEPEST * force[2] / max(hypot(force[0], force[1]), ALIKE))

        axis = force / np.sqrt(force.dot(force))
        side = np.array([0.0, axis[2], -axis[1]]) / hypot(axis[1], axis[2])
        error = np.column_stack([np.cross(side, axis), side, axis]).T @ R
        e = 0.5 * np.array([error[2, 1] - error[1, 2], error[0, 2] - error[2, 0], error[1, 0] - error[0, 1]])
        w = data.qvel[3:6]
        k = np.array([TILTING, TILTING, HEADING])
        torque = self._inertia @ (-k * k * e - 2.0 * k * w) + np.cross(w, self._inertia @ w)

        thrust = self._mixer[:, 0] * min(max(force.dot(R[:, 2]), self._least), self._most)
        turning = self._mixer[:, 1:] @ torque
        room = np.where(turning > 0.0, self._high - thrust, thrust - self._low)
        share = np.min(room / np.maximum(np.abs(turning), ALIKE), initial=1.0)
        data.ctrl[:] = np.clip(thrust + max(share, 0.0) * turning, self._low, self._high)
        data.qfrc_applied[:3] = self._mass * (made - wanted)


def unfit(model: mujoco.MjModel, states: StateAdapter, system: str) -> str:
    """Refuse a free body that rotors cannot fly; return why a system is none of such a body, or nothing."""
    _, wrenches = _wrenches(model)
    axial = not np.any(np.abs(wrenches[:, :2]) > ALIKE) and np.linalg.matrix_rank(wrenches[:, 2:], ALIKE) == 4
    if int(model.jnt_bodyid[0]) != model.body("robot").id or model.nv != 6 or not axial:
        raise SceneError(
            'body "robot" must have a free joint and no other, its mass around its origin, and at least four rotors: '
            'sites whose z-axis is upwards, each with <motor site="..." gear="0 0 1 0 0 DRAG"/>'
        )
    if not model.opt.gravity[2] < 0.0:
        raise SceneError('a robot with rotors needs gravity; write <option gravity="0 0 -9.81"/>')
    if set(states.velocities) <= set(states.states):
        return ""
    return f'rotors accelerate a robot, and {system} has no velocities: name the dynamics "drone"'


def _wrenches(model: mujoco.MjModel) -> tuple[Array, Array]:
    """Return the inertia (3, 3) of a level body, and force and torque (nu, 6) of each actuator's unit command.

    Where the mass is not around the origin, the force is infinite.
    """
    model = copy.copy(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL  # a unit may be out of the ctrlrange
    data = mujoco.MjData(model)
    data.qpos[3:7] = LEVEL
    mujoco.mj_forward(model, data)
    M = np.empty((6, model.nv))
    for row, unit in zip(M, np.eye(6, model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    wrenches = np.empty((model.nu, 6))
    for row, ctrl in zip(wrenches, np.eye(model.nu), strict=True):
        data.ctrl[:] = ctrl
        mujoco.mj_fwdActuation(model, data)
        row[:] = data.qfrc_actuator[:6]
    if np.any(np.abs(M[:3, 3:6]) > ALIKE):
        wrenches[:, 0] = np.inf
    return M[3:6, 3:6], wrenches
