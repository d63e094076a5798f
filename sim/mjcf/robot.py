"""Robot files: what they must declare, and how a radius, a footprint and a physics step are applied to them.

Body `robot` is the root, at the origin. Slides along x and y [and a hinge about z] move it, whose positions are the
state; or a free joint and wheels, which touch the robot's own infinite plane `ground` by contact pairs. In space these
are slides along x, y and z, or a free joint and rotors (`sim.states.rotors`), which need no command matrix. The sphere
geom `footprint` has the radius and height with which the robot plans: if it collides, another radius scales the whole
robot, else whatever collides must lie inside it. Without it a robot with a heading plans as the hull of what collides,
seen from above. Actuators are velocity servos tuned for the file's own timestep, or motors where velocities are states.
The text `pirrht_dynamics` names a registered system; the numeric `pirrht_command` is, row by row, the (nu, k) matrix M
of ctrl = M @ twist.
"""

from copy import copy
from dataclasses import dataclass, replace
from itertools import product
from math import inf
from pathlib import Path

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Obstacle
from pirrht.systems.dynamics import Dynamics
from sim.mjcf.footprint import Span, fit_looks, give_prism, of_geoms, span_of, upright
from sim.mjcf.library import compile_spec, find, parse, prefixed
from sim.mjcf.obstacles import mesh_of
from sim.states import StateAdapter, adapter_of
from sim.systems import System, named, names
from sim.text import counted

_GEOM = mujoco.mjtGeom
_FILTERS = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)  # of a command, which settles at it
NO_DISC = 'sphere geom "footprint" in its body "robot"'
_INNER = ("type", "size", "pos", "group", "rgba", "contype", "conaffinity", "mass", "density")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Robot:
    """A robot file that keeps the conventions of `sim.mjcf`, ready to be joined to a scene."""

    name: str
    spec: mujoco.MjSpec
    system: System  # its dynamics and states
    command: Array  # (nu, k) M of ctrl = M @ twist
    footprint: Footprint  # as which it plans, with the margin; its height is above the ground
    margin: float  # part of the footprint by which it is larger than what collides [m]
    span: Span  # least and greatest height at which it meets obstacles [m]
    rest: Array  # (nq,) joint positions at the origin, heading along x
    rolling: bool  # whether wheels or rotors carry it, instead of joints
    unfit: str = ""  # why MuJoCo cannot move it as a given system does

    def meets(self, obstacle: Obstacle) -> Obstacle:
        """Return an obstacle as plans see it: for a robot with corners upright over its heights."""
        return obstacle if self.footprint.is_disc else upright(obstacle, self.span)


def read_robot(
    which: str | Path, radius: float | None, system: System | None = None, *, footprint: Footprint | None = None,
    margin: float = 0.0,
) -> Robot:  # fmt: skip
    """The robot of that name or path, its radius > 0 [m] or its footprint and its system changed if they are given.

    A footprint is one with corners. By the margin [m] it, or the disc, is larger than that, and than what collides.
    """
    path = find("robot", which)
    spec = parse(path)
    with prefixed(f"{path}: "):
        body, foot = _body_and_footprint(spec)
        moved = _declared_system(spec) if system is None else system
        if footprint is not None or foot is None:
            shape, span = _corners(spec, path, body, foot, footprint, radius, moved)
            shape = shape.grown(margin)
            model = compile_spec(spec, path)
        else:
            model = _disc(spec, path, body, foot, radius, margin)
            shape, margin = _checked_disc(model)
            span = span_of(shape) if moved.adapter.dimension == 2 else (-inf, inf)
        _check_place(model)
        unfit = moved.adapter.unfit(model, moved.name)
        # Another system may do without MuJoCo; the plant sees to it where it does not.
        if system is None and (wrong := unfit or _wrong_actuator(model, moved.adapter, moved.name)):
            raise SceneError(wrong)
        joints = moved.adapter.joints(model)
        twists = moved.twists if system is None else None
        command = np.zeros((int(model.nu), 3)) if joints.fly else _command(spec, int(model.nu), twists)
        return Robot(
            name=path.stem, spec=spec, system=moved, footprint=shape, margin=margin, span=span, command=command,
            rest=moved.adapter.rest(model), rolling=joints.rolls,
            unfit=unfit and f"{path}: {unfit}",
        )  # fmt: skip


def _body_and_footprint(spec: mujoco.MjSpec) -> tuple[mujoco.MjsBody, mujoco.MjsGeom | None]:
    """Return the body `robot` of a file and the sphere geom `footprint` in it, if there is one.

    SceneError: there is no body, or none of its geoms collides.
    """
    body = next((b for b in spec.worldbody.bodies if b.name == "robot"), None)
    foot = next((g for g in (body.geoms if body else ()) if g.name == "footprint"), None)
    solid = body is not None and any(g.contype or g.conaffinity for g in body.find_all("geom"))
    if body is None or (foot is None and not solid) or (foot is not None and foot.type != _GEOM.mjGEOM_SPHERE):
        raise SceneError(_lacking('body "robot" in its worldbody' if body is None else NO_DISC))
    return body, foot


def _lacking(element: str) -> str:
    """Return why a file is no robot, which lacks an element."""
    form = (
        'a robot is a body "robot" with a sphere geom "footprint", of the size with which plans keep clear, or one '
        "with a heading and geoms that collide, whose hull keeps clear"
    )
    return f"this file has no {element}; add it: {form}"


def _corners(
    spec: mujoco.MjSpec, path: Path, body: mujoco.MjsBody, foot: mujoco.MjsGeom | None, given: Footprint | None,
    radius: float | None, system: System,
) -> tuple[Footprint, Span]:  # fmt: skip
    """Return shape and heights [m] of a robot with corners, as given, else of what collides; a given one does then."""
    if radius is not None:
        raise SceneError("a robot with corners has no radius to change; give --footprint instead of --radius")
    if not system.adapter.turns:
        if given is None:
            raise SceneError(_lacking(NO_DISC))
        raise SceneError(
            f"a footprint with corners needs a heading, and {system.called} has none; choose a robot that has one, "
            "such as the rover, or a disc (--radius)"
        )
    own, span = of_geoms(compile_spec(spec, path))
    if given is not None and foot is not None:
        span = span_of(replace(given, height=float(foot.pos[2])))
    if given is not None:
        fit_looks(spec, body, own, given)
        give_prism(spec, body, given, span)
    return replace(given or own, height=0.5 * (span[0] + span[1])), span


def _disc(
    spec: mujoco.MjSpec, path: Path, body: mujoco.MjsBody, foot: mujoco.MjsGeom, radius: float | None, margin: float
) -> mujoco.MjModel:
    """Return the model of a robot whose disc has another radius, if one is given, and a margin [m]."""
    if radius is not None:
        _resize(spec, body, foot, radius)
    if margin > 0.0:
        _widen(body, foot, margin)
    return compile_spec(spec, path)


def _checked_disc(model: mujoco.MjModel) -> tuple[Footprint, float]:
    """Return the disc as which a robot plans, and by how much it is larger than what collides [m]."""
    radius, height = float(model.geom("footprint").size[0]), float(model.geom("footprint").pos[2])
    return Footprint.disc(radius, height=height), max(radius - _checked_reach(model), 0.0)


def _declared_system(spec: mujoco.MjSpec) -> System:
    """Return the system that a file names; SceneError: it names none that is known."""
    called = next((str(text.data) for text in spec.texts if text.name == "pirrht_dynamics"), None)
    if called not in names():
        wanted = " or ".join(f'"{known}"' for known in names())
        found = "missing" if called is None else f'"{called}"'
        raise SceneError(f'custom text "pirrht_dynamics" is {found}; write {wanted}, or choose a system with --system')
    return named(called)


def control_limits(model: mujoco.MjModel, command: Array, dynamics: Dynamics) -> tuple[Array, Array]:
    """Least and greatest control (m,) that no actuator cuts off at its ranges; infinite where none would.

    They are its ctrlrange and, where it filters its command, its actrange. Actuators that several controls share bound
    none of them.
    """
    x = np.zeros(dynamics.n)
    per_control = np.eye(dynamics.m) if dynamics.input_form else dynamics.G_c(x).T
    rates = dynamics.idle(x) + np.vstack([np.zeros(dynamics.m), per_control])
    still, *moved = (command @ dynamics.twist(x, rate) for rate in rates)
    slopes = np.column_stack(moved) - still[:, None]
    low = np.full(dynamics.m, -np.inf)
    high = np.full(dynamics.m, np.inf)

    filtered = model.actuator_actlimited & np.isin(model.actuator_dyntype, _FILTERS)
    for limited, ranges in (
        (model.actuator_ctrllimited, model.actuator_ctrlrange), (filtered, model.actuator_actrange)
    ):  # fmt: skip
        for i in np.flatnonzero(limited & (np.count_nonzero(slopes, axis=1) == 1)):
            j = np.flatnonzero(slopes[i])[0]
            least, most = np.sort((ranges[i] - still[i]) / slopes[i, j])
            low[j] = max(low[j], least)
            high[j] = min(high[j], most)
    return low, high


def _resize(spec: mujoco.MjSpec, body: mujoco.MjsBody, foot: mujoco.MjsGeom, radius: float) -> None:
    """A robot that collides with its footprint grows as a whole; for any other only the footprint does."""
    ratio = radius / foot.size[0]
    scaled = [(foot, "size")]

    if foot.contype or foot.conaffinity:
        scaled = [*product(spec.meshes, ["scale"]), *product(body.find_all("body"), ["pos"])]
        scaled += product(body.find_all("geom"), ["size", "pos"])
    for part, measure in scaled:
        setattr(part, measure, np.asarray(getattr(part, measure)) * ratio)


def _widen(body: mujoco.MjsBody, foot: mujoco.MjsGeom, margin: float) -> None:
    """Plans keep a distance [m]; where the footprint was what collides, a ball of its size inside it is now."""
    if foot.contype or foot.conaffinity:
        body.add_geom(name="inner footprint", **{name: getattr(foot, name) for name in _INNER})
        foot.contype = 0
        foot.conaffinity = 0
        foot.mass = 0.0
        foot.density = 0.0
    foot.size = np.asarray(foot.size) + margin * np.array([1.0, 0.0, 0.0])


def _command(spec: mujoco.MjSpec, nu: int, twists: int | None) -> Array:
    """The robot's command matrix (nu, k), of as many columns as a twist has numbers, if that is known."""
    data = next((np.array(list(n.data)) for n in spec.numerics if n.name == "pirrht_command"), np.empty(0))
    twists = twists or max(2, data.size // max(nu, 1))
    if nu == 0 or data.size != twists * nu:
        found = f"of {counted(data.size, 'number')}" if data.size else "missing"
        raise SceneError(
            f'custom numeric "pirrht_command" is {found}; write {twists * nu} numbers, row by row the '
            f"({nu}, {twists}) matrix M of ctrl = M @ (twist of the dynamics) for the robot's {nu} actuators"
        )
    return data.reshape(nu, twists)


def _check_place(model: mujoco.MjModel) -> None:
    """Refuse a robot that does not stand at the origin."""
    root = model.body("robot")
    if not (np.allclose(root.pos, 0) and np.allclose(root.quat, [1, 0, 0, 0])):
        raise SceneError('body "robot" must stand at the origin')


def _checked_reach(model: mujoco.MjModel) -> float:
    """Distance from the footprint's centre to the farthest point of what collides, which lies inside it [m]."""
    foot = int(model.geom("footprint").id)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    centre = data.geom_xpos[foot]
    radius = float(model.geom_size[foot, 0])

    if np.any(np.abs(centre[:2]) > 1e-9):
        raise SceneError('geom "footprint" must lie above its body\'s origin; write pos="0 0 z"')
    solid = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0)).tolist()
    if not solid:
        raise SceneError('no geom collides; give "footprint" or another geom contype="1"')
    reach, farthest = max((_reach(model, data, geom, centre), geom) for geom in solid)
    if reach > radius + 1e-9:
        raise SceneError(
            f'geom "{model.geom(farthest).name}" reaches {reach:.4g} m off the "footprint" centre, beyond its radius '
            f"{radius:g}; choose a --radius of at least {np.ceil(reach * 1e3) / 1e3:g}"
        )
    return reach


def _reach(model: mujoco.MjModel, data: mujoco.MjData, geom: int, centre: Array) -> float:
    """Distance from `centre` to the farthest point of the geom, or a bound of it [m]."""
    kind = _GEOM(int(model.geom_type[geom]))
    size = model.geom_size[geom]
    offset = (centre - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
    if kind == _GEOM.mjGEOM_MESH:
        return float(np.linalg.norm(mesh_of(model, geom)[0] - offset, axis=1).max())
    x, y, z = offset = np.abs(offset)
    if kind == _GEOM.mjGEOM_CYLINDER:
        return float(np.hypot(np.hypot(x, y) + size[0], z + size[1]))
    if kind in (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_CAPSULE):  # a sphere has the half length 0
        return float(np.hypot(np.hypot(x, y), z + size[1]) + size[0])
    return float(np.linalg.norm(offset + size))


def _wrong_actuator(model: mujoco.MjModel, states: StateAdapter, system: str) -> str:
    """What is wrong with actuators: servos where velocity is state, or motors where it is not; empty if nothing is."""
    motors = (  # whose force is their command times a constant, at once
        (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED)
        & (model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE)
        & (model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE)
    )
    forced = bool(states.rates)
    steered = bool(set(states.speeds) & set(states.rates))  # by other actuators, perhaps
    enough = motors.any() if steered else motors.all()
    if enough if forced else not enough or not states.bare:
        return ""
    name = model.actuator(int(np.argmax(motors != forced))).name
    is_now, moved_by, other = ("no motor", "forces", "velocities") if forced else ("a motor", "velocities", "forces")
    write = '<motor joint="..."/>, or site="..."' if forced else '<velocity joint="..." kv="..."/>'
    return (
        f'actuator "{name}" is {is_now}, and {system} is commanded {moved_by}; write {write}, or choose dynamics that '
        f"are commanded {other}"
    )


def check_motion(model: mujoco.MjModel, system: str, dynamics: Dynamics, command: Array) -> None:
    """Refuse states that the robot of a joined model does not have, and velocities that do not change as they must.

    Errors call the dynamics as `system` says; `command` (nu, k) is M of ctrl = M @ twist.
    """
    states = adapter_of(dynamics.states)
    joints = states.joints(model)
    if missing := [name for name in states.states if name not in (*joints.names, *joints.rates)]:
        raise OptionError(
            f"in MuJoCo this robot has no {missing[0]}, which is a state of {system}; states that it can have are "
            f"{', '.join((*states.pose, *joints.rates))}: drive it with --plant sde"
        )
    if wrong := _wrong_actuator(model, states, system):
        raise OptionError(f"{wrong}; a robot file of your own is --robot FILE.xml, and --plant sde needs none")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    x = joints.read(data, np.zeros(dynamics.n))
    x[list(dynamics.angles)] = 0.0
    if command.shape[1] != (twists := len(dynamics.twist(x, dynamics.idle(x)))):
        raise OptionError(
            f"the robot's pirrht_command has {command.shape[1]} columns, and the twist of {system} has {twists} "
            "numbers: give it a column for each, or `twist` a number for each"
        )
    names = [*states.rates]
    if joints.rolls or not names:
        return
    # A step of MuJoCo from 1 m/s must be one of the equation, in both with the damping at its beginning. It turns by h:
    # off by half of h^2, the speed is not kept.
    model = copy(model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    x[[dynamics.states.index(name) for name in names]] = 1.0
    names += states.turns if set(states.speeds) & set(names) else ()
    kept = [dynamics.states.index(name) for name in names]

    h = model.opt.timestep
    still = np.zeros(dynamics.m)

    for u in np.vstack([still, np.eye(dynamics.m)]) / max(1.0, float(np.abs(dynamics.G_c(x)).max())):
        ctrl = command.dot(dynamics.twist(x, dynamics.rate(x, u, still, h)))
        mujoco.mj_resetDataKeyframe(model, data, 0)
        joints.place(data, x, np.zeros(2), ctrl)
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data)
        made, meant = ((after - x)[kept] / h for after in (joints.read(data, x), dynamics.step(x, u, still, h)))
        if not np.allclose(made, meant, rtol=0.0, atol=0.1 * h):
            texts = ["(" + ", ".join(f"{v + 0.0:.4g}" for v in numbers) + ")" for numbers in (u, made, meant)]
            raise OptionError(
                f"at 1 m/s, under the control {texts[0]} of {system}, the robot's {', '.join(names)} change by "
                f"{texts[1]} per second instead of {texts[2]}: make pirrht_command its mass over the gears of its "
                "motors, leave out damping, friction, gravity and narrow ctrlranges along its slides, or name a "
                "--system whose drift has them; half of the sideways acceleration keeps the speed in turns"
            )
