"""Robots whose velocity is state: forces drive them, and MuJoCo must accelerate them as their equation says."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.systems.dynamics import Dynamics
from sim.mjcf.coordinates import rolls, stance_of, unread
from sim.systems import POSE, SPEED, VELOCITIES, System

TURN = 0.05  # by which heading and speed change in the step that is tried [rad], [m/s]
TOLERANCE = 1e-6  # relative to the acceleration, or in m/s^2 if that is more


def check_actuators(model: mujoco.MjModel, system: System, path: Path) -> None:
    """Refuse velocity servos where velocity is state, and motors where the state is but a place.

    Raises:
        SceneError: names file, actuator and what to write.
    """
    if wrong := _wrong_actuator(model, system.states, system.name):
        raise SceneError(f"{path}: {wrong}")


def _wrong_actuator(model: mujoco.MjModel, states: Sequence[str], system: str) -> str:
    """What is wrong with actuators; empty if nothing is."""
    motors = [_is_motor(model, i) for i in range(model.nu)]
    if set(states) & set(SPEED):
        if any(motors):
            return ""
        return (
            f"no actuator is a motor, and the speed is a state of {system}, which forces change; write one that drives "
            'the body ahead, <motor name="..." site="..." gear="1 0 0 0 0 0"/>'
        )
    if set(states) & set(VELOCITIES):
        if all(motors):
            return ""
        name = model.actuator(motors.index(False)).name
        return (
            f'actuator "{name}" is no motor, and velocity is a state of {system}, which forces change; write '
            f'<motor name="{name.rpartition("/")[2]}" joint="..."/>, or choose dynamics that are commanded velocities'
        )
    if not (motors and all(motors)) or set(states) - set(POSE):
        return ""
    name = model.actuator(0).name
    return (
        f'actuator "{name}" is a motor, and {system} is commanded velocities, not forces; write '
        f'<velocity name="{name.rpartition("/")[2]}" joint="..." kv="..."/>, or choose dynamics whose states '
        'are velocities too, like "double_integrator"'
    )


def _is_motor(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether its force is its command times a constant, at once."""
    return bool(
        model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        and model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
    )


def check_motion(model: mujoco.MjModel, system: str, dynamics: Dynamics, command: Array) -> None:
    """Refuse states that the robot of a joined model does not have, and accelerations that it does not make so.

    Args:
        system: what errors call the dynamics.
        command: (nu, 2) M of ctrl = M @ twist.

    Raises:
        OptionError: names states, actuators or accelerations, and what to mend.
    """
    missing = unread(model, dynamics.states)
    if missing:
        able = () if rolls(model) else (*VELOCITIES, *(SPEED if model.nq > 2 else ()))
        raise OptionError(
            f"in MuJoCo this robot has no {missing[0]}, which is a state of {system}; states that it can have are "
            f"{', '.join((*POSE, *able))}: drive it with --plant sde"
        )
    if wrong := _wrong_actuator(model, dynamics.states, system):
        raise OptionError(f"{wrong}; a robot file of your own is --robot FILE.xml, and --plant sde needs none")
    x = dynamics.state_of(np.zeros(3))
    twists = len(dynamics.twist(x, dynamics.idle(x)))
    if command.shape[1] != twists:
        raise OptionError(
            f"the robot's pirrht_command has {command.shape[1]} columns, and the twist of a {system} has {twists} "
            "numbers: give it a column for each, or `twist` a number for each"
        )
    actuated = dynamics.states[dynamics.n - dynamics.m :]
    if dynamics.input_form:
        actuated = tuple(name for name in dynamics.states if name in VELOCITIES)
    if set(dynamics.states) & set(SPEED) and not rolls(model):
        _check_step(model, system, dynamics, command)
        return
    if not actuated or set(actuated) - set(VELOCITIES):
        return
    data, stance = mujoco.MjData(model), stance_of(model, dynamics.states)
    dofs = [VELOCITIES.index(name) for name in actuated]
    for speed in (0.0, 1.0):
        mujoco.mj_resetDataKeyframe(model, data, 0)
        x = dynamics.state_of(np.array([*data.qpos[:2], 0.0]))
        x[[dynamics.states.index(name) for name in dynamics.states if name in VELOCITIES]] = speed
        for wanted in np.vstack([np.zeros(dynamics.m), np.eye(dynamics.m)]):
            ctrl = command.dot(dynamics.twist(x, wanted))
            stance.place(data, x, np.zeros(2), ctrl)
            data.ctrl[:] = ctrl
            mujoco.mj_forward(model, data)
            made = data.qacc[dofs]
            if dynamics.input_form:
                rates = dynamics.f(x) + dynamics.G_c(x) @ wanted
                wanted = rates[[dynamics.states.index(name) for name in actuated]]
            if not np.allclose(made, wanted, rtol=TOLERANCE, atol=TOLERANCE):
                raise OptionError(
                    f"at {speed:g} m/s, commanded to accelerate by {_told(wanted)} m/s^2 as a {system}, the robot "
                    f"accelerates by {_told(made)} m/s^2: make pirrht_command its mass over the gears of its motors, "
                    "and leave out damping, friction, gravity and narrow ctrlranges along its slides, or name a "
                    "--system whose drift has them"
                )


def _check_step(model: mujoco.MjModel, system: str, dynamics: Dynamics, command: Array) -> None:
    """Refuse robots whose step, as far as heading and speed go, is not that of the equation, in a turn as well."""
    data, h = mujoco.MjData(model), model.opt.timestep
    stance = stance_of(model, dynamics.states)
    kept = [dynamics.states.index(name) for name in ("heading", "speed") if name in dynamics.states]
    for wanted in np.vstack([np.zeros(dynamics.m), np.eye(dynamics.m)]):
        mujoco.mj_resetDataKeyframe(model, data, 0)
        x = dynamics.state_of(np.array([*data.qpos[:2], 0.0]))
        x[dynamics.states.index("speed")] = 1.0
        u = wanted * TURN / h / max(1.0, float(np.abs(dynamics.G_c(x)).max()))
        rate = dynamics.rate(x, u, np.zeros(dynamics.m), h)
        ctrl = command.dot(dynamics.twist(x, rate))
        stance.place(data, x, np.zeros(2), ctrl)
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data)
        made, meant = stance.read(data, x)[kept], dynamics.step(x, u, np.zeros(dynamics.m), h)[kept]
        if not np.allclose(made, meant, rtol=0.0, atol=0.1 * TURN**2):
            raise OptionError(
                f"at 1 m/s, under the control {_told(u)} of a {system} for {h:g} s, the robot comes to the heading and "
                f"speed {_told(made)} instead of {_told(meant)}: make pirrht_command its mass over the gears of its "
                "motors, let half of the sideways acceleration keep its speed in turns, and leave out damping, "
                "friction, gravity and narrow ctrlranges"
            )


def _told(numbers: Array) -> str:
    return "(" + ", ".join(f"{v + 0.0:.4g}" for v in numbers) + ")"
