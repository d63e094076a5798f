"""Scenes and robots from MJCF files, joined and read by convention; there are no side files.

A scene has the sites `goal` (its first size is the radius), `start` (its x-axis is the heading) and `workspace` (a box,
else the floor plane bounds the robot's centre). Custom elements `pirrht_...` are defaults of options, the robot that it
is meant for, and what it is about (docs/own-map.md). Robot files: `sim.mjcf.robot`.

The joined model takes timestep and looks from the scene; gravity, contact model, integrator, flags and medium
(none) from the robot, whose servos are carried over to the timestep. The robot's elements get the prefix
`robot/`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Motion, Obstacle
from pirrht.geometry.scene import ROUNDING, Scene
from sim.mjcf import obstacles
from sim.mjcf.edits import freeze, leave_out, loosen, part_meshes
from sim.mjcf.footprint import footprint_of, rectangle_of
from sim.mjcf.library import Faults, compile_spec, delete, find, listed, parse, prefixed, refused, robot_names
from sim.mjcf.obstacles import MOTION, POSES, Mask, geom_label, site_of
from sim.mjcf.robot import Robot, read_robot
from sim.options import NUMERICS
from sim.settings import SceneOptions
from sim.states import StateAdapter, adapter_of
from sim.text import counted, suggestion

_FROM_ROBOT = (
    *("integrator", "disableflags", "enableflags", "density", "viscosity", "gravity"),
    *("cone", "impratio", "solver", "iterations", "tolerance", "noslip_iterations"),
)  # options of the physics
SMALLER = ", or choose a smaller --radius or --footprint"
DECOMPOSE = "`pirrht import MESH` makes convex parts of a mesh"
DEFAULT = "puck"  # the robot of scenes that name none
ABOUT = "pirrht_about"  # a sentence on the scene


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loaded:
    """A scene as plain values, and the MuJoCo model it was read from, with the robot in it."""

    scene: Scene
    model: mujoco.MjModel  # its keyframe "start" places the robot
    obstacle_geoms: Mask  # (ngeom,) what counts as a collision; the static ones in the order of scene.obstacles
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
    unfit: str = ""  # why MuJoCo cannot move the robot as its system does

    @property
    def adapter(self) -> StateAdapter:
        """Adapter of the system's states."""
        return adapter_of(self.states)

    @property
    def overview(self) -> tuple[Array, Array]:
        """Eye of the camera "overview", else one south-east of the workspace and above it, and what it looks at [m]."""
        lower, upper = (np.append(corner, 0.0)[:3] for corner in (self.scene.lower, self.scene.upper))
        middle = 0.5 * (lower + upper)
        camera = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_CAMERA, "overview")
        if camera < 0:
            return middle + 1.6 * float((upper - lower).max()) * np.array([0.35, -0.75, 0.55]), middle
        eye, ahead = self.model.cam_pos0[camera], -self.model.cam_mat0[camera].reshape(3, 3)[:, 2]
        return eye, eye + max(1.0, float(ahead @ (middle - eye))) * ahead

    def __repr__(self) -> str:
        return f"Loaded({self.scene!r}, robot {self.robot!r}, {self.path})"


def load(scene: str | Path, *, loose: bool = False, **options: Any) -> Loaded:
    """A scene with a robot in it.

    Args:
        scene: a built-in name or the path of an MJCF file.
        loose: whether static bodies become mocap bodies, which can be moved, and a body shows the goal.
        options: fields of `SceneOptions`, of which `system` is a `System`. Without a robot there is the scene's
            `pirrht_robot`, else the puck; without a radius [m] its `pirrht_radius`, else the robot's own; without a
            margin [m] its `pirrht_margin`, else 0. Where a moving obstacle leaves less at the start, the margin is half
            of what it leaves. Bodies that `freeze` welds are where the first keyframe, else the default pose, has them;
            actuators, sensors, tendons and equalities are dropped.

    Raises:
        SceneError: a file is unreadable or breaks a convention; the message names element and remedy.
    """
    task = SceneOptions(**options)
    path = find("scene", scene)
    spec = parse(path)
    faults = Faults()

    with prefixed(f"{path}: "):
        motions, notes = _edited(spec, task, path, loose=loose)
        about, meant, defaults = faults.of(_custom, spec) or ("", DEFAULT, {})
    radius, footprint = _shape(task, defaults)
    margin = (defaults.get("margin") if task.margin is None else task.margin) or 0.0
    robot = read_robot(task.robot or meant, radius, task.system, footprint=footprint, margin=margin)
    with prefixed(f"{path}: "):
        adapter = robot.system.adapter
        model, data, mine, met = _joined(spec, robot, path, faults, notes)
        faults.of(_refuse_actuators, model, len(robot.command))
        solids = {geom: robot.meets(solid) for geom, solid in met.items()}
        borders = faults.of(obstacles.read_workspace, model, data, task.workspace, adapter.dimension)
        goal = faults.of(adapter.goal, model, data, site_of(model, "goal"), task.goal)
        start = faults.of(adapter.start, data, site_of(model, "start"), task.start)
        faults.refuse()
        assert borders is not None and goal is not None and start is not None  # noqa: PT018
        _put(model, "start", start[: adapter.dimension])
        _put(model, "goal", goal.center, goal.radius)
        if concave := obstacles.concave_meshes(model, solids):
            called = listed([*concave.values()])
            notes.append(f"MuJoCo collides with the convex hulls of meshes, and so do plans: {called}; {DECOMPOSE}")
        moving = obstacles.moved_geoms(model, motions)
        movers = obstacles.read_movers(model, data, motions, solids, adapter.dimension)
        values = Scene(
            name=path.stem, lower=borders[0], upper=borders[1], goal=goal, start=start, footprint=robot.footprint,
            obstacles=tuple(solid for geom, solid in solids.items() if not moving[geom]), movers=movers,
            robot_height=robot.footprint.height, margin=robot.margin, defaults=defaults,
        )  # fmt: skip
        if (left := _margin_left(values, margin, task, adapter.text(start))) is not None:
            return load(scene, loose=loose, **{**options, "margin": 0.5 * left})
        mask = np.isin(np.arange(model.ngeom), [*solids])
        model.geom_contype[~(mask | mine)] = model.geom_conaffinity[~(mask | mine)] = 0  # the robot touches these alone
        model.geom_margin[:] = model.geom_gap[:] = 0  # which the planner does not know
        _place(model, data, robot, start)
        _check_start(model, data, mask, concave, task, adapter.text(start))
    return Loaded(
        scene=values, model=model, obstacle_geoms=mask, moving_geoms=moving, robot_geoms=mine, path=path, about=about,
        dynamics_name=robot.system.name, states=robot.system.states, command=robot.command, robot=robot.name,
        meant=read_robot(meant, None).system.name if task.robot or task.system is not None else robot.system.name,
        notes=tuple(note for note in notes if note), unfit=robot.unfit, margin=margin,
    )  # fmt: skip


def _shape(task: SceneOptions, defaults: dict[str, Any]) -> tuple[float | None, Footprint | None]:
    """Return the radius [m] of a robot, or its footprint with corners, as a task or else a scene has it; else None."""
    of_scene = defaults.pop("footprint", None)
    if task.footprint is not None and task.radius is not None:
        raise OptionError("--footprint and --radius both say what the robot's shape is; leave one of them out")
    if task.radius is not None:
        return task.radius, None
    shape = of_scene if task.footprint is None else footprint_of(task.footprint)
    if shape is None:
        return defaults.get("radius"), None
    return (shape.radius, None) if shape.is_disc else (None, shape)


def _edited(
    spec: mujoco.MjSpec, task: SceneOptions, path: Path, *, loose: bool
) -> tuple[dict[str, Motion], list[str]]:  # fmt: skip
    """Leave out, weld or loosen bodies of a spec; return its motions by body, and notes."""
    notes = [leave_out(spec, task.without)] if task.without else []
    motions = obstacles.read_motions(spec)
    if task.freeze:
        notes.append(freeze(spec, motions, path))
    if loose:
        loosen(spec)
    return motions, notes


def _join(spec: mujoco.MjSpec, robot: Robot, path: Path) -> mujoco.MjModel:
    """Attach the robot, with servos carried over to the scene's physics step; those of wheels keep their own."""
    if not spec.option.timestep > 0:
        raise SceneError(f"option timestep is {spec.option.timestep:g}; write a positive number [s]")
    ratio = 1.0 if robot.rolling else robot.spec.option.timestep / spec.option.timestep
    for actuator in robot.spec.actuators:  # motors stay: what the noise asks of them is given per step already
        if actuator.gainprm[0] == -actuator.biasprm[2]:  # of a servo: kv * timestep is kept, so deadbeat stays so
            actuator.gainprm[0] *= ratio
            actuator.biasprm[2] *= ratio
    robot.spec.option.timestep = spec.option.timestep
    for name in _FROM_ROBOT:
        setattr(spec.option, name, getattr(robot.spec.option, name))
    spec.attach(robot.spec, prefix="robot/", frame=spec.worldbody.add_frame())
    delete(spec, spec.keys)
    spec.add_key(name="start")
    return compile_spec(spec, path)


def _joined(
    spec: mujoco.MjSpec, robot: Robot, path: Path, faults: Faults, notes: list[str]
) -> tuple[mujoco.MjModel, mujoco.MjData, Mask, dict[int, Obstacle]]:
    """Attach the robot, for one in space among convex parts of meshes, and note it.

    Returns model, places of everything, which geoms (ngeom,) are the robot's, and what it can collide with, by geom.
    """
    model = _join(spec, robot, path)
    while True:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        mine = np.asarray(model.body_rootid[model.geom_bodyid] == model.body("robot/robot").id)
        met = obstacles.read_obstacles(model, data, mine, robot.span, faults)
        concave = obstacles.concave_meshes(model, met) if robot.system.adapter.dimension == 3 else {}
        parted = part_meshes(spec, model, concave)
        if not parted:
            return model, data, mine, met
        notes += parted
        model = compile_spec(spec, path)


def _margin_left(scene: Scene, margin: float, task: SceneOptions, at: str) -> float | None:
    """Return what a moving obstacle leaves of a margin at the start [m]; None: all. SceneError: they collide."""
    clearance, body = obstacles.clearance_at_start(scene)
    if clearance > 0.0:
        return None
    if (left := margin + clearance) > 0.0:
        return left
    elsewhere = 'move site "start"' if task.start is None else "choose another --start"
    raise SceneError(
        f'at the start {at} the robot touches body "{body}" (by {-clearance:.3g} '
        f"m), and it moves: {elsewhere}, or write another first row of its motion"
    )


def _put(model: mujoco.MjModel, site: str, place: Array, radius: float | None = None) -> None:
    """Draw a site of the worldbody at a place (d,), where options may have it."""
    number = site_of(model, site)
    if number >= 0 and model.site_bodyid[number] == 0:
        model.site_sameframe[number] = 0
        model.site_pos[number, : len(place)] = place
        model.site_size[number, 0] = radius or model.site_size[number, 0]


def _place(model: mujoco.MjModel, data: mujoco.MjData, robot: Robot, start: Array) -> None:
    """Make the keyframe in which the robot is at rest at a scene's start."""
    adapter = robot.system.adapter
    model.key_qpos[0] = robot.rest
    adapter.joints(model).place(data, adapter.state_of(start), np.zeros(2), np.zeros(model.nu))
    model.key_qpos[0] = data.qpos


def _refuse_actuators(model: mujoco.MjModel, own: int) -> None:
    if model.nu != own:
        names = [model.actuator(i).name for i in range(model.nactuator)]
        called = listed([f'"{name}"' for name in names if name and not name.startswith("robot/")])
        raise SceneError(
            f"the scene has {counted(model.nu - own, 'actuator')}{f' ({called})' if called else ''}; only the robot "
            "may have some: remove them, or load it with --freeze"
        )


def _custom(spec: mujoco.MjSpec) -> tuple[str, str, dict[str, Any]]:
    """What a scene is about, the robot that it is meant for, and its defaults of options by their names."""
    texts, numerics = (
        {e.name: e for e in es if not e.name.startswith((MOTION, POSES))} for es in (spec.texts, spec.numerics)
    )
    options = {"pirrht_" + name.replace("-", "_"): name for name in (*NUMERICS, "footprint")}
    for kind, elements, known in (("text", texts, ("pirrht_robot", ABOUT)), ("numeric", numerics, options)):
        for name in elements:
            if name.startswith("pirrht_") and name not in known:
                these = f"{', '.join(known)}, and {MOTION}BODY or {POSES}BODY is the motion of a body"
                raise SceneError(f'custom {kind} "{name}" is no option{suggestion(name, known)}; those are {these}')
    about, robot = (" ".join(str(texts[n].data).split()) if n in texts else "" for n in (ABOUT, "pirrht_robot"))
    if (robot or DEFAULT) not in robot_names():
        like = suggestion(robot, robot_names())
        raise SceneError(f'custom text "pirrht_robot" is "{robot}"{like}; write one of {", ".join(robot_names())}')
    defaults: dict[str, Any] = {}
    for name in (name for name in numerics if name in options):
        label = f'custom numeric "{name}"'
        values = list(numerics[name].data)

        if options[name] == "footprint":
            with refused("", "", OptionError):
                defaults["footprint"] = rectangle_of(values, label)
            continue
        if len(values) != 1 or isnan(values[0]):
            raise SceneError(f"{label} is {values}; write one finite number")
        with refused("", "", OptionError):
            NUMERICS[options[name]].check(float(values[0]), label)
        defaults[options[name]] = float(values[0])
    return about, robot or DEFAULT, defaults


def _check_start(
    model: mujoco.MjModel, data: mujoco.MjData, solid: Mask, concave: Mapping[int, str], task: SceneOptions, at: str
) -> None:
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_fwdPosition(model, data)
    touched = [g for pair in data.contact.geom[data.contact.dist < -ROUNDING] for g in pair if solid[g]]
    if touched:
        geom = int(touched[0])
        label, body = geom_label(model, geom), model.body(model.body_rootid[model.geom_bodyid[geom]]).name
        if geom in concave:
            label = f"the convex hull of {concave[geom]}, with which MuJoCo collides: {DECOMPOSE}"
        spare = f', leave out body "{body}" (--without)' if body and body != "world" else ""
        elsewhere = 'move site "start"' if task.start is None else "choose another --start"
        raise SceneError(f"at the start {at} the robot touches {label}; {elsewhere}{spare}{SMALLER}")
