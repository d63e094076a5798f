"""Robot files: what they must declare, and how a radius and a physics step are applied to them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.systems.dynamics import Dynamics
from sim.mjcf.coordinates import GROUND, rolls, settled
from sim.mjcf.forces import check_actuators
from sim.mjcf.library import compile_spec, find, parse
from sim.systems import System, named, names
from sim.text import counted

_GEOM = mujoco.mjtGeom
_SINKAGE = 0.002  # of a robot at rest: height [m], and 1 - cosine of half the tilt
_SLIDE, _HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Robot:
    """A robot file that keeps the conventions of `sim.mjcf`, ready to be joined to a scene."""

    name: str
    path: Path
    spec: mujoco.MjSpec
    system: System  # what moves
    command: Array  # (nu, k) M of ctrl = M @ twist
    radius: float  # of the footprint [m]
    reach: float  # of what collides, off the footprint's centre [m]
    height: float  # of the footprint's centre above the ground [m]
    rest: Array  # (nq,) joint positions at the origin, heading along x
    rolling: bool  # whether wheels carry it, instead of joints

    def tune(self, timestep: float) -> None:
        """Carry the servos over to another physics step [s].

        kv * timestep is kept, so deadbeat stays so; wheels have slow servos, whose time constant is kept. Motors stay
        as they are: what the noise asks of them is told per step already.
        """
        ratio = 1.0 if self.rolling else self.spec.option.timestep / timestep
        for actuator in self.spec.actuators:
            if actuator.gainprm[0] == -actuator.biasprm[2]:
                actuator.gainprm[0] *= ratio
                actuator.biasprm[2] *= ratio
        self.spec.option.timestep = timestep


def read_robot(which: str | Path, radius: float | None, system: System | None = None, *, margin: float = 0.0) -> Robot:
    """The robot of that name or path, with its footprint changed to `radius` > 0 [m] and its system if they are given.

    Args:
        margin: by which the footprint is larger than that, and than what collides [m].

    Raises:
        SceneError: the file breaks a convention, or the radius is too small for what the robot collides with.
    """
    path = find("robot", which)
    spec = parse(path)
    body = next((b for b in spec.worldbody.bodies if b.name == "robot"), None)
    if body is None:
        raise SceneError(f'{path}: no body "robot" in the worldbody; give the robot\'s root body that name')
    foot = next((g for g in body.geoms if g.name == "footprint"), None)
    if foot is None or foot.type != _GEOM.mjGEOM_SPHERE:
        raise SceneError(f'{path}: body "robot" needs a sphere geom "footprint", as which it plans')
    named_here = system is None
    system = _named_system(spec, path) if system is None else system
    if radius is not None:
        _resize(spec, body, foot, radius)
    if margin > 0.0:
        _widen(body, foot, margin)
    model = compile_spec(spec, path)
    (_check_wheels if rolls(model) else _check_joints)(model, system, path)
    if named_here:  # another system may do without MuJoCo; `check_motion` sees to it where it does not
        check_actuators(model, system, path)
    reach = _checked_reach(model, path)
    centre = model.geom("footprint").pos
    return Robot(
        name=path.stem,
        path=path,
        spec=spec,
        system=system,
        command=_command(spec, int(model.nu), system.twists if named_here else None, path),
        radius=float(model.geom("footprint").size[0]),
        reach=reach,
        height=float(centre[2]),
        rest=_rest(model, path),
        rolling=rolls(model),
    )


def control_limits(model: mujoco.MjModel, command: Array, dynamics: Dynamics) -> tuple[Array, Array]:
    """Least and greatest control (m,) that no actuator cuts off at its ctrlrange; infinite where none would.

    Actuators that several controls share bound none of them.
    """
    x, still = np.zeros(dynamics.n), np.zeros(dynamics.m)
    per_control = np.eye(dynamics.m) if dynamics.input_form else dynamics.G_c(x).T
    rates = dynamics.idle(x) + np.vstack([still, per_control])
    still, *moved = (command @ dynamics.twist(x, rate) for rate in rates)
    slopes = np.column_stack(moved) - still[:, None]
    low, high = np.full(dynamics.m, -np.inf), np.full(dynamics.m, np.inf)
    for i in np.flatnonzero(model.actuator_ctrllimited):
        owners = np.flatnonzero(slopes[i])
        if len(owners) == 1:
            j = owners[0]
            ends = np.sort((model.actuator_ctrlrange[i] - still[i]) / slopes[i, j])
            low[j], high[j] = max(low[j], ends[0]), min(high[j], ends[1])
    return low, high


def _resize(spec: mujoco.MjSpec, body: mujoco.MjsBody, foot: mujoco.MjsGeom, radius: float) -> None:
    """A robot that collides with its footprint grows as a whole; for any other only the footprint does."""
    ratio = radius / foot.size[0]
    if not (foot.contype or foot.conaffinity):
        foot.size = np.asarray(foot.size) * ratio
        return
    for mesh in spec.meshes:
        mesh.scale = np.asarray(mesh.scale) * ratio
    for part in [body, *body.find_all("body")]:
        if part is not body:
            part.pos = np.asarray(part.pos) * ratio
        for geom in part.geoms:
            geom.size = np.asarray(geom.size) * ratio
            geom.pos = np.asarray(geom.pos) * ratio


def _widen(body: mujoco.MjsBody, foot: mujoco.MjsGeom, margin: float) -> None:
    """Plans keep a distance [m]; where the footprint was what collides, a ball of its size inside it is now."""
    if foot.contype or foot.conaffinity:
        body.add_geom(
            name="inner footprint", type=_GEOM.mjGEOM_SPHERE, size=foot.size, pos=foot.pos, group=foot.group,
            rgba=foot.rgba, contype=foot.contype, conaffinity=foot.conaffinity, mass=foot.mass, density=foot.density,
        )  # fmt: skip
        foot.contype, foot.conaffinity, foot.mass, foot.density = 0, 0, 0.0, 0.0
    foot.size = np.asarray(foot.size) + margin * np.array([1.0, 0.0, 0.0])


def meant_system(which: str) -> str:
    """The system that a robot's file names.

    Raises:
        SceneError: it names none.
    """
    path = find("robot", which)
    return _named_system(parse(path), path).name


def _named_system(spec: mujoco.MjSpec, path: Path) -> System:
    name = next((str(t.data) for t in spec.texts if t.name == "pirrht_dynamics"), None)
    if name is None or name not in names():
        wanted = " or ".join(f'"{known}"' for known in names())
        found = "missing" if name is None else f'"{name}"'
        raise SceneError(
            f'{path}: custom text "pirrht_dynamics" is {found}; write {wanted}, or choose a system with --system'
        )
    return named(name)


def _command(spec: mujoco.MjSpec, nu: int, twists: int | None, path: Path) -> Array:
    """The robot's command matrix (nu, k), of as many columns as a twist has numbers, if that is known."""
    data = next((np.array(list(n.data)) for n in spec.numerics if n.name == "pirrht_command"), None)
    if twists is None:
        twists = max(2, data.size // nu) if data is not None and nu else 2
    if data is None or nu == 0 or data.size != twists * nu:
        found = "missing" if data is None else f"of {counted(data.size, 'number')}"
        raise SceneError(
            f'{path}: custom numeric "pirrht_command" is {found}; write {twists * nu} numbers, row by row the '
            f"({nu}, {twists}) matrix M of ctrl = M @ (twist of the dynamics) for the robot's {nu} actuators"
        )
    return data.reshape(nu, twists)


def _check_joints(model: mujoco.MjModel, system: System, path: Path) -> None:
    count = len(system.joints)
    types = [_HINGE if name == "heading" else _SLIDE for name in system.joints]
    good = model.nq == count and list(model.jnt_type) == types and not np.any(model.qpos0)
    good = good and np.allclose(model.jnt_axis, np.eye(3)[:count]) and not np.any(model.jnt_pos[:, :2])
    if not (good and _at_origin(model)):
        joints = "slide along x, slide along y" + (", hinge about z" if count == 3 else "")
        raise SceneError(
            f'{path}: body "robot" must stand at the origin and have these joints, without ref, for the states '
            f"({', '.join(system.states)}) of {system.name}: {joints}"
            + ("; or a free joint and wheels" if count == 3 else "")
        )


def _at_origin(model: mujoco.MjModel) -> bool:
    body = model.body("robot")
    return np.allclose(body.pos, 0) and np.allclose(body.quat, [1, 0, 0, 0])


def _check_wheels(model: mujoco.MjModel, system: System, path: Path) -> None:
    if len(system.joints) != 3:
        raise SceneError(
            f'{path}: a robot with a free joint has a heading, and {system.name} has none: it moves as a "unicycle"; '
            "name that as its dynamics"
        )
    if int(model.jnt_bodyid[0]) != model.body("robot").id or not _at_origin(model):
        raise SceneError(f'{path}: body "robot" must stand at the origin and have the free joint itself')
    ground = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, GROUND)
    if ground < 0 or model.geom_type[ground] != _GEOM.mjGEOM_PLANE or np.any(model.geom_pos[ground]):
        raise SceneError(f'{path}: a robot on wheels needs a plane geom "{GROUND}" of its own, at the origin')
    if model.geom_contype[ground] or model.geom_conaffinity[ground]:
        raise SceneError(
            f'{path}: geom "{GROUND}" must meet the wheels in contact pairs; write contype="0" conaffinity="0"'
        )
    joints = model.actuator_trnid[:, 0]
    if np.any(model.actuator_trntype != mujoco.mjtTrn.mjTRN_JOINT) or np.any(model.jnt_type[joints] != _HINGE):
        raise SceneError(f"{path}: every actuator of a robot on wheels must drive a hinge joint")


def _rest(model: mujoco.MjModel, path: Path) -> Array:
    if not rolls(model):
        return model.qpos0.copy()  # type: ignore[no-any-return]
    rest = settled(model)
    if not (abs(rest[2]) < _SINKAGE and rest[3] > 1 - _SINKAGE):  # also when the simulation has diverged
        raise SceneError(
            f'{path}: body "robot" does not come to rest on wheels (height {rest[2]:.2g} m); let them and '
            f'casters touch the plane z = 0 and give each a contact pair with geom "{GROUND}"'
        )
    return rest


def _checked_reach(model: mujoco.MjModel, path: Path) -> float:
    """Distance from the footprint's centre to the farthest point of what collides, which lies inside it [m]."""
    foot = int(model.geom("footprint").id)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    centre, radius = data.geom_xpos[foot], float(model.geom_size[foot, 0])
    if np.any(np.abs(centre[:2]) > 1e-9):
        raise SceneError(f'{path}: geom "footprint" must lie above its body\'s origin; write pos="0 0 z"')
    solid = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    if solid.size == 0:
        raise SceneError(f'{path}: no geom collides; give "footprint" or another geom contype="1"')
    reaches = [_reach(model, data, int(geom), centre) for geom in solid]
    for geom, reach in zip(solid, reaches, strict=True):
        if reach > radius + 1e-9:
            raise SceneError(
                f'{path}: geom "{model.geom(geom).name}" reaches {reach:.4g} m off the "footprint" centre, '
                f"beyond its radius {radius:g}; choose a --radius of at least {np.ceil(reach * 1e3) / 1e3:g}"
            )
    return max(reaches)


def _reach(model: mujoco.MjModel, data: mujoco.MjData, geom: int, centre: Array) -> float:
    """Distance from `centre` to the farthest point of the geom, or a bound of it [m]."""
    kind, size = _GEOM(int(model.geom_type[geom])), model.geom_size[geom]
    offset = (centre - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
    if kind == _GEOM.mjGEOM_MESH:
        first, count = (int(v[model.geom_dataid[geom]]) for v in (model.mesh_vertadr, model.mesh_vertnum))
        return float(np.linalg.norm(model.mesh_vert[first : first + count] - offset, axis=1).max())
    if kind == _GEOM.mjGEOM_BOX:
        return float(np.linalg.norm(np.abs(offset) + size))
    if kind == _GEOM.mjGEOM_CYLINDER:
        return float(np.hypot(np.hypot(*offset[:2]) + size[0], abs(offset[2]) + size[1]))
    if kind == _GEOM.mjGEOM_CAPSULE:
        return float(np.hypot(np.hypot(*offset[:2]), abs(offset[2]) + size[1]) + size[0])
    return float(np.linalg.norm(offset) + size.max())
