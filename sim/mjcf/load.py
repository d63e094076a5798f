"""Scenes and robots from MJCF files, joined and read by convention; there are no side files.

A scene file declares
  site `goal`       cylinder or sphere; its first size is the radius
  site `start`      position, and the direction of its x-axis as heading
  site `workspace`  box that bounds the robot's centre; without it the horizontal floor plane does
  obstacles         every static geom, whatever body it hangs in, whose contact bits match the robot's and
                    whose height range meets the robot's; the floor is none. A mocap body stands still; one with
                    a motion (`pirrht_motion_BODY`) is refused
  custom            `<numeric name="pirrht_noise" data="0.1"/>`: defaults of options (- becomes _);
                    `<text name="pirrht_robot" data="unicycle"/>`: the robot it is meant for;
                    `<text name="pirrht_about" data="..."/>`: a sentence, which `pirrht scenes` shows

A robot file declares
  body `robot`      its root, at the origin, moved by a slide along x, a slide along y [and a hinge about z],
                    so that the joint positions are the state (and the speeds of the slides, if it has
                    velocities); or by a free joint and wheels that stand on
                    the robot's own infinite plane `ground`, which they touch by contact pairs
  geom `footprint`  a sphere: radius and height with which the robot plans; if it collides, another radius
                    scales the robot as a whole, else whatever collides must lie inside it
  actuators         velocity servos tuned for the file's own timestep and integrator; `motor`s where velocities
                    (vx, vy, speed) are states of the system: a force must accelerate the robot as the command says
  custom            `<text name="pirrht_dynamics" data="single_integrator"/>`, "unicycle" or
                    whatever else is registered (`sim.systems`);
                    `<numeric name="pirrht_command" size="k*nu" data="..."/>`: row by row the (nu, k) matrix
                    M of ctrl = M @ twist with `Dynamics.twist`: (vx, vy), (forward speed, turn rate),
                    accelerations along x and y, or (acceleration ahead, to the left, turn rate), k = 3

The joined model takes timestep and looks from the scene; gravity, contact model, integrator, flags and medium
(none) from the robot, whose servos are carried over to the timestep. The robot's elements get the prefix
`robot/`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.scene import ROUNDING, Goal, Scene
from sim.mjcf.coordinates import stance_of, standing
from sim.mjcf.faults import Faults
from sim.mjcf.frozen import freeze as freeze_bodies
from sim.mjcf.frozen import leave_out, listed
from sim.mjcf.hulls import Concave, concave_meshes, use_hulls
from sim.mjcf.library import compile_spec, find, models_folder, parse, robot_names, scene_names
from sim.mjcf.loose import loosen
from sim.mjcf.motions import MOVES, check_start, moved_geoms, read_motions, read_movers, shortfall
from sim.mjcf.numbers import MOTION, option_defaults
from sim.mjcf.obstacles import Mask, geom_label, read_obstacles, read_workspace, refuse_turns
from sim.mjcf.robot import Robot, meant_system, read_robot
from sim.settings import SceneOptions
from sim.text import counted

__all__ = ["Loaded", "load", "models_folder", "robot_names", "scene_names"]

_FROM_ROBOT = (
    *("integrator", "disableflags", "enableflags", "density", "viscosity", "gravity"),
    *("cone", "impratio", "solver", "iterations", "tolerance", "noslip_iterations"),
)  # options of the physics
_GEOM = mujoco.mjtGeom
DECOMPOSE = "`pirrht import MESH --decompose` makes convex parts of a mesh"
REACH = 1e4  # of a goal at most [m]
DEFAULT = "puck"  # the robot of scenes that name none
ABOUT = "pirrht_about"  # what a scene says of itself
TURNED = 1e3  # heading of a start at most [rad]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loaded:
    """A scene as plain values beside the MuJoCo model it was read from, with the robot in it."""

    scene: Scene
    model: mujoco.MjModel  # its keyframe "start" places the robot
    obstacle_geoms: Mask  # (ngeom,) what counts as a collision; those that stand in the order of scene.obstacles
    moving_geoms: Mask  # (ngeom,) whatever moves with a body of scene.movers, whether it collides or not
    robot_geoms: Mask  # (ngeom,)
    dynamics_name: str  # name of a registered system
    states: tuple[str, ...]  # (n,) of that system
    command: Array  # (nu, k) M of ctrl = M @ twist
    robot: str  # name of the robot
    meant: str  # name of the system that the scene's numbers are meant for
    path: Path  # the scene's file
    about: str = ""  # a sentence on the scene, by itself
    notes: tuple[str, ...] = ()  # lines on what of the file was changed, or is not what it looks like
    margin: float = 0.0  # by which the footprint has been made larger [m]

    def __repr__(self) -> str:
        return f"Loaded({self.scene!r}, robot {self.robot!r}, {self.path})"


def load(scene: str | Path, *, loose: bool = False, **options: Any) -> Loaded:
    """A scene with a robot in it.

    Args:
        scene: a built-in name or the path of an MJCF file.
        loose: whether what stands is made of mocap bodies, which can be moved, and a body shows the goal.
        options: fields of `SceneOptions`, of which `system` is a `System`. Without a robot there is the scene's
            `pirrht_robot`, else the puck; without a radius [m] its `pirrht_radius`, else the robot's own; without a
            margin [m] its `pirrht_margin`, else 0. Where a moving obstacle leaves less at the start, the margin is half
            of what it leaves. Bodies that `freeze` welds are where the first keyframe, else the default pose, has them;
            actuators, sensors, tendons and equalities are dropped.

    Raises:
        SceneError: a file is unreadable or breaks a convention; the message names element and remedy.
    """
    task, path = SceneOptions(**options), find("scene", scene)
    spec, faults = parse(path), Faults(path)
    notes = [leave_out(spec, task.without, path)] if task.without else []
    motions = read_motions(spec, path)
    notes += [freeze_bodies(spec, motions, path)] if task.freeze else []
    defaults = faults.of(option_defaults, spec, path) or {}
    if loose:
        loosen(spec)
    meant, about = faults.of(_meant_robot, spec, path) or DEFAULT, _about(spec)
    length = defaults.get("radius") if task.radius is None else task.radius
    room = defaults.get("margin") if task.margin is None else task.margin
    machine = read_robot(task.robot or meant, length, task.system, margin=room or 0.0)
    model = _join(spec, machine, path)
    data = _posed(model)
    robot_geoms = np.asarray(model.body_rootid[model.geom_bodyid] == model.body("robot/robot").id)
    span = max(machine.height - machine.radius, 0.0), machine.height + machine.radius
    faults.of(_refuse_actuators, model, machine, path)
    faults.of(refuse_turns, model, path)
    mask, solids = read_obstacles(model, data, robot_geoms, span, path, faults)
    moving, numbers = moved_geoms(model, motions), np.flatnonzero(mask)
    borders = faults.of(read_workspace, model, data, task.workspace, path)
    disc, place = faults.of(_goal, model, data, task.goal, path), faults.of(_start, model, data, task.start, path)
    faults.settle()
    assert borders is not None and disc is not None  # noqa: PT018
    assert place is not None
    concave = concave_meshes(model, mask, solids)
    if concave:
        model = use_hulls(spec, model, concave, path)
        data = _posed(model)
        notes.append(_on_hulls(list(concave.values())))
    values = Scene(
        name=path.stem,
        lower=borders[0],
        upper=borders[1],
        obstacles=tuple(solid for solid, geom in zip(solids, numbers, strict=True) if not moving[geom]),
        goal=disc,
        start=place,
        robot_radius=machine.radius,
        robot_height=machine.height,
        margin=max(machine.radius - machine.reach, 0.0),
        defaults=defaults,
        movers=read_movers(model, data, motions, dict(zip(numbers.tolist(), solids, strict=True)), path),
    )
    if room and 0.0 < (left := room - shortfall(values)) <= room:
        return load(scene, loose=loose, **{**options, "margin": 0.5 * left})
    _leave_only(model, mask, robot_geoms)
    _place(model, data, machine, values.start)
    _check_start(model, data, mask, moving, concave, path)
    check_start(values, path)
    return Loaded(
        scene=values,
        model=model,
        obstacle_geoms=mask,
        moving_geoms=moving,
        robot_geoms=robot_geoms,
        dynamics_name=machine.system.name,
        states=machine.system.states,
        command=machine.command,
        robot=machine.name,
        meant=meant_system(meant),
        path=path,
        about=about,
        margin=room or 0.0,
        notes=tuple(note for note in notes if note),
    )


def _posed(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data


def _on_hulls(concave: Sequence[Concave]) -> str:
    """A line on meshes that are not convex."""
    return (
        f"MuJoCo collides with the convex hulls of meshes, and so do plans: {listed([one.words for one in concave])}; "
        f"{DECOMPOSE}"
    )


def _join(spec: mujoco.MjSpec, robot: Robot, path: Path) -> mujoco.MjModel:
    if not spec.option.timestep > 0:
        raise SceneError(f"{path}: option timestep is {spec.option.timestep:g}; write a positive number [s]")
    robot.tune(spec.option.timestep)
    for name in _FROM_ROBOT:
        setattr(spec.option, name, getattr(robot.spec.option, name))
    spec.attach(robot.spec, prefix="robot/", frame=spec.worldbody.add_frame())
    for key in list(spec.keys):
        spec.delete(key)
    spec.add_key(name="start")
    return compile_spec(spec, path)


def _refuse_actuators(model: mujoco.MjModel, robot: Robot, path: Path) -> None:
    own = len(robot.command)
    if model.nu != own:
        names = [model.actuator(i).name for i in range(model.nactuator)]
        called = listed([f'"{name}"' for name in names if name and not name.startswith("robot/")])
        raise SceneError(
            f"{path}: the scene has {counted(model.nu - own, 'actuator')}{f' ({called})' if called else ''}; only the "
            "robot may have some: remove them, or load it with --freeze"
        )


def _leave_only(model: mujoco.MjModel, obstacles: Mask, robot: Mask) -> None:
    """Let the robot touch obstacles and nothing else, without margins, which the planner does not know."""
    bystanders = ~(obstacles | robot)
    model.geom_contype[bystanders] = 0
    model.geom_conaffinity[bystanders] = 0
    model.geom_margin[:] = 0
    model.geom_gap[:] = 0


def _place(model: mujoco.MjModel, data: mujoco.MjData, robot: Robot, start: Array) -> None:
    """Make the keyframe the robot at rest at the start."""
    model.key_qpos[0] = robot.rest
    states = robot.system.states
    stance_of(model, states).place(data, standing(start, states), np.zeros(2), np.zeros(model.nu))
    model.key_qpos[0] = data.qpos


def _meant_robot(spec: mujoco.MjSpec, path: Path) -> str:
    robot = DEFAULT
    for text in spec.texts:
        if text.name == "pirrht_robot":
            robot = str(text.data)
            if robot not in robot_names():
                known = ", ".join(robot_names())
                raise SceneError(f'{path}: custom text "pirrht_robot" is "{robot}"; write one of {known}')
        elif text.name.startswith("pirrht_") and text.name != ABOUT and not text.name.startswith(MOTION):
            raise SceneError(
                f'{path}: custom text "{text.name}" is no option; those are pirrht_robot and {ABOUT}, and {MOTION}BODY'
            )
    return robot


def _about(spec: mujoco.MjSpec) -> str:
    return next((" ".join(str(text.data).split()) for text in spec.texts if text.name == ABOUT), "")


def _goal(model: mujoco.MjModel, data: mujoco.MjData, given: Sequence[float] | None, path: Path) -> Goal:
    if given is not None:
        if len(given) != 3:
            more = ", since a goal has no heading: it is reached in whatever direction" if len(given) > 3 else ""
            raise SceneError(f"{path}: the goal has {counted(len(given), 'number')}; give three: x, y and radius{more}")
        return _disc(np.array(given[:2], dtype=float), float(given[2]), "the goal", path)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "goal")
    remedy = '<site name="goal" type="cylinder" pos="x y 0" size="radius 0.005"/>'
    if site < 0:
        raise SceneError(f'{path}: no site "goal"; add {remedy} or give --goal X Y R')
    kind, tilt = _GEOM(int(model.site_type[site])), abs(data.site_xmat[site, 8])
    if kind != _GEOM.mjGEOM_SPHERE and (kind != _GEOM.mjGEOM_CYLINDER or tilt < 1 - 1e-6):
        shape = kind.name.removeprefix("mjGEOM_").lower()
        raise SceneError(f'{path}: site "goal" is no sphere or upright cylinder: {shape}; write {remedy}')
    return _disc(np.array(data.site_xpos[site, :2]), float(model.site_size[site, 0]), 'site "goal"', path)


def _disc(center: Array, radius: float, what: str, path: Path) -> Goal:
    if radius > REACH:
        raise SceneError(f"{path}: {what} has a radius of {radius:g}; write at most {REACH:g} m")
    return Goal(center=center, radius=radius)


def _start(model: mujoco.MjModel, data: mujoco.MjData, given: Sequence[float] | None, path: Path) -> Array:
    if given is not None and len(given) not in (2, 3):
        raise SceneError(f"{path}: the start has {counted(len(given), 'number')}; give x, y and optionally a heading")
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "start")
    if given is None and site < 0:
        raise SceneError(f'{path}: no site "start"; add <site name="start" pos="x y 0"/> or give --start X Y')
    heading = float(np.arctan2(data.site_xmat[site, 3], data.site_xmat[site, 0])) if site >= 0 else 0.0
    place = data.site_xpos[site, :2] if given is None else given
    heading = place[2] if given is not None and len(place) == 3 else heading
    if not abs(heading) <= TURNED:
        raise SceneError(
            f"{path}: the start has the heading {heading:g}; write radians, from -{TURNED:g} to {TURNED:g}"
        )
    return np.array([*place[:2], heading], dtype=float)


def _check_start(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    obstacles: Mask,
    moving: Mask,
    concave: Mapping[int, Concave],
    path: Path,
) -> None:
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_fwdPosition(model, data)
    touched = [g for pair in data.contact.geom[data.contact.dist < -ROUNDING] for g in pair if obstacles[g]]
    if touched:
        (x, y), geom = model.key_qpos[0, :2], int(touched[0])
        where = f"{path}: at the start ({x:g}, {y:g}) the robot touches {geom_label(model, geom)}"
        if moving[geom]:
            body = f'body "{model.body(model.body_rootid[model.geom_bodyid[geom]]).name}"'
            raise SceneError(f"{where}{'' if body in where else f' of {body}'}, and {MOVES}")
        if geom in concave:
            where = where.replace("touches", "touches the convex hull of")
            where += f" ({concave[geom].volumes}), with which MuJoCo collides: {DECOMPOSE}"
        body = model.body(model.body_rootid[model.geom_bodyid[geom]]).name
        spare = f', leave out body "{body}" (--without)' if body and body != "world" else ""
        raise SceneError(f'{where}; move site "start"{spare}, or choose another --start or a smaller --radius')
