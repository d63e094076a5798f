"""Robots whose velocity is state: forces drive them, and MuJoCo must accelerate them as their equation says."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.systems.dynamics import Dynamics
from sim.mjcf.coordinates import rolls, stance_of
from sim.systems import POSE, SPEED, VELOCITIES, System

TURN = 0.05  # by which heading and speed change in the step that is tried [rad], [m/s]
TOLERANCE = 1e-6  # relative to the acceleration, or in m/s^2 if that is more
BARE = "leave out damping, friction, gravity and narrow ctrlranges"


def check_actuators(model: mujoco.MjModel, system: System) -> None:
    """Refuse velocity servos where velocity is state, and motors where the state is but a place."""
    if wrong := _wrong_actuator(model, system.states, system.name):
        raise SceneError(wrong)


def _wrong_actuator(model: mujoco.MjModel, states: Sequence[str], system: str) -> str:
    """What is wrong with actuators; empty if nothing is."""
    motors = [  # whose force is their command times a constant, at once
        model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE
        and model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_NONE
        for i in range(model.nu)
    ]
    forced = set(states) & {*VELOCITIES, *SPEED}
    if "speed" in states and not any(motors):
        return (
            f"no actuator is a motor, and the speed is a state of {system}, which forces change; write one that drives "
            'the body ahead, <motor name="..." site="..." gear="1 0 0 0 0 0"/>'
        )
    if "speed" in states or (all(motors) if forced else not all(motors) or not motors or set(states) - set(POSE)):
        return ""
    name = model.actuator(motors.index(not forced)).name
    short = name.rpartition("/")[2]
    if forced:
        return (
            f'actuator "{name}" is no motor, and velocity is a state of {system}, which forces change; write '
            f'<motor name="{short}" joint="..."/>, or choose dynamics that are commanded velocities'
        )
    return (
        f'actuator "{name}" is a motor, and {system} is commanded velocities, not forces; write <velocity '
        f'name="{short}" joint="..." kv="..."/>, or choose dynamics whose states are velocities too, like '
        '"double_integrator"'
    )


def check_motion(model: mujoco.MjModel, system: str, dynamics: Dynamics, command: Array) -> None:
    """Refuse states that the robot of a joined model does not have, and accelerations that it does not make so.

    Args:
        system: what errors call the dynamics.
        command: (nu, k) M of ctrl = M @ twist.
    """
    able = () if rolls(model) else (*VELOCITIES, *(SPEED if model.nq > 2 else ()))
    has = POSE if rolls(model) else (*POSE[: model.nq], *able)
    missing = [name for name in dynamics.states if name not in has]
    if missing:
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
    if rolls(model):
        return
    check = _check_turning if set(dynamics.states) & set(SPEED) else _check_accelerations
    for wanted in np.vstack([np.zeros(dynamics.m), np.eye(dynamics.m)]):
        check(model, system, dynamics, command, wanted)


def _check_accelerations(model: mujoco.MjModel, system: str, dynamics: Dynamics, command: Array, wanted: Array) -> None:
    """Refuse robots that do not accelerate as they are commanded, at rest and at 1 m/s."""
    speeds = [i for i, name in enumerate(dynamics.states) if name in VELOCITIES]
    actuated = speeds if dynamics.input_form else range(dynamics.n - dynamics.m, dynamics.n)
    if not set(actuated) <= set(speeds):
        return
    for speed in (0.0, 1.0) if actuated else ():
        x = dynamics.state_of(np.array([*model.key_qpos[0, :2], 0.0]))
        x[speeds] = speed
        data = _stepped(model, dynamics, x, command.dot(dynamics.twist(x, wanted)))
        made = data.qacc[[VELOCITIES.index(dynamics.states[i]) for i in actuated]]
        meant = (dynamics.f(x) + dynamics.G_c(x) @ wanted)[actuated] if dynamics.input_form else wanted
        if not np.allclose(made, meant, rtol=TOLERANCE, atol=TOLERANCE):
            raise OptionError(
                f"at {speed:g} m/s, commanded to accelerate by {_text(meant)} m/s^2 as a {system}, the robot "
                f"accelerates by {_text(made)} m/s^2: make pirrht_command its mass over the gears of its motors, and "
                f"{BARE} along its slides, or name a --system whose drift has them"
            )


def _check_turning(model: mujoco.MjModel, system: str, dynamics: Dynamics, command: Array, wanted: Array) -> None:
    """Refuse robots whose step, as far as heading and speed go, is not that of the equation, in a turn as well."""
    h, still = model.opt.timestep, np.zeros(dynamics.m)
    kept = [dynamics.states.index(name) for name in ("heading", "speed") if name in dynamics.states]
    x = dynamics.state_of(np.array([*model.key_qpos[0, :2], 0.0]))
    x[dynamics.states.index("speed")] = 1.0
    u = wanted * TURN / h / max(1.0, float(np.abs(dynamics.G_c(x)).max()))
    data = _stepped(model, dynamics, x, command.dot(dynamics.twist(x, dynamics.rate(x, u, still, h))))
    made = stance_of(model, dynamics.states).read(data, x)[kept]
    meant = dynamics.step(x, u, still, h)[kept]
    if not np.allclose(made, meant, rtol=0.0, atol=0.1 * TURN**2):
        raise OptionError(
            f"at 1 m/s, under the control {_text(u)} of a {system} for {h:g} s, the robot comes to the heading and "
            f"speed {_text(made)} instead of {_text(meant)}: make pirrht_command its mass over the gears of its "
            f"motors, let half of the sideways acceleration keep its speed in turns, and {BARE}"
        )


def _stepped(model: mujoco.MjModel, dynamics: Dynamics, x: Array, ctrl: Array) -> mujoco.MjData:
    """MuJoCo's data after a step from a state (n,) under commands (nu,); its accelerations are those at x."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    stance_of(model, dynamics.states).place(data, x, np.zeros(2), ctrl)
    data.ctrl[:] = ctrl
    mujoco.mj_step(model, data)
    return data


def _text(numbers: Array) -> str:
    return "(" + ", ".join(f"{v + 0.0:.4g}" for v in numbers) + ")"
