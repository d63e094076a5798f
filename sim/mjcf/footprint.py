"""Footprints with corners: as options have them, as geoms of a robot file make them, and as MuJoCo collides with them.

A robot with corners is an upright prism over its range of heights. Obstacles become upright over that range as well, so
that plans, which see one height, and contacts agree.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

from pirrht.arrays import Array
from pirrht.errors import OptionError, PirrhtError, SceneError
from pirrht.freespace import MEMBERS
from pirrht.geometry.collision import Collision
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Kind, Obstacle
from pirrht.geometry.scene import Workspace
from pirrht.plotting.strokes import outline
from sim.text import suggestion

PRESETS = {
    "jackal": Footprint.rectangle(0.508, 0.430),  # Clearpath Robotics, data sheet of the Jackal: 508 x 430 x 250 mm
    "turtlebot4": Footprint.disc(0.171),  # Clearpath Robotics, TurtleBot 4: its round base is 341 mm across
    "car": Footprint.rectangle(4.5, 1.8, 1.35),  # a compact car with a wheelbase of 2.7 m, from its rear axle
}
FORM = f"LENGTHxWIDTH[@OFFSET] in m, as in 1.0x0.4 or 4.5x1.8@1.35, or one of {', '.join(PRESETS)}"
_NUMBER = r"(\d+\.?\d*|\.\d+)"
_TEXT = re.compile(rf"{_NUMBER}[xX]{_NUMBER}(?:@([+-]?{_NUMBER}))?")
_GEOM = mujoco.mjtGeom
Span = tuple[float, float]  # least and greatest height [m]
_RING = 32  # corners around what is round
_UPRIGHT = 1 - 1e-9
PRISM = "prism"  # the geom with which a robot with corners collides
_OPACITY = 0.35  # of it


def footprint_of(given: str | Footprint) -> Footprint:
    """Return a footprint as it is given, or as a text says: a preset, or length, width and offset [m]."""
    if isinstance(given, Footprint):
        return given
    if given in PRESETS:
        return PRESETS[given]
    if (found := _TEXT.fullmatch(str(given))) is None:
        raise OptionError(f"--footprint is {str(given)[:40]!r}{suggestion(str(given), PRESETS)}; it must be {FORM}")
    return rectangle_of([float(found[k]) for k in (1, 2, 3) if found[k]], f"--footprint {given}")


def rectangle_of(numbers: Sequence[float], label: str) -> Footprint:
    """Return the rectangle of a length, a width and perhaps an offset [m]; OptionError, with a label: there is none."""
    if len(numbers) not in (2, 3):
        raise OptionError(f"{label} is {list(numbers)}; write length, width and perhaps offset [m]")
    try:
        return Footprint.rectangle(*numbers)
    except PirrhtError as error:
        raise OptionError(f"{label}: {error}") from None


def collision_of(world: Workspace, footprint: Footprint) -> Collision:
    """Return exact clearances in a world: at places (k, 2) of a disc, at poses (k, 3) of a footprint with corners."""
    return MEMBERS[footprint.kind].collision(world, footprint)


def span_of(footprint: Footprint) -> Span:
    """Return the least and greatest height at which a robot meets obstacles [m], from the ground on."""
    return max(footprint.height - footprint.inscribed, 0.0), footprint.height + footprint.inscribed


def of_geoms(model: mujoco.MjModel) -> tuple[Footprint, Span]:
    """Return the hull of a robot's colliding geoms seen from above, and their heights [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    solid = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0)).tolist()
    if not solid:
        raise SceneError('no geom collides; give the robot a box contype="1", or a sphere geom "footprint"')
    points = np.vstack([_corners(model, data, geom) for geom in solid])
    hull = points[ConvexHull(points[:, :2]).vertices, :2]
    try:
        return Footprint.polygon(hull), (float(points[:, 2].min()), float(points[:, 2].max()))
    except SceneError as error:
        raise SceneError(f"the hull of the robot's colliding geoms: {error}") from None


def _corners(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """Return points (k, 3) [m] whose hull seen from above contains a geom; round parts lie in polygons around them."""
    kind = _GEOM(int(model.geom_type[geom]))
    size = model.geom_size[geom]
    turn = data.geom_xmat[geom].reshape(3, 3)
    angle = 2.0 * np.pi * np.arange(_RING) / _RING
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_RING)]) / np.cos(np.pi / _RING)
    pole = np.array([0.0, 0.0, 1.0])

    if kind == _GEOM.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        own = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]].astype(float)
    elif kind == _GEOM.mjGEOM_BOX:
        own = size * np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    elif kind == _GEOM.mjGEOM_CYLINDER:
        own = np.vstack([size[0] * ring + end * pole for end in (-size[1], size[1])])
    elif kind in (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_CAPSULE):
        ball = size[0] * np.vstack([ring, pole, -pole]) @ turn  # whatever the turn, level rings go around a ball
        own = np.vstack([ball + end * pole for end in (-size[1], size[1])])
    else:
        raise SceneError(f'geom "{model.geom(geom).name}" is of a type that no footprint is made of; write a box')
    return np.asarray(data.geom_xpos[geom] + own @ turn.T)


def give_prism(spec: mujoco.MjSpec, body: mujoco.MjsBody, footprint: Footprint, span: Span) -> None:
    """Let a robot collide with the upright prism of its footprint alone, over a range of heights [m]."""
    solid = [geom for geom in body.find_all("geom") if geom.contype or geom.conaffinity]
    middle, half = 0.5 * (span[0] + span[1]), 0.5 * (span[1] - span[0])
    hull = footprint.hull
    prism = body.add_geom(name=PRISM, mass=0.0, group=0, rgba=[*_color(body), _OPACITY])
    if footprint.is_rectangle:
        low, high = hull.min(axis=0), hull.max(axis=0)
        prism.type = _GEOM.mjGEOM_BOX
        prism.size = [*(0.5 * (high - low)), half]
        prism.pos = [*(0.5 * (low + high)), middle]
    else:
        ends = [np.column_stack([hull, np.full(len(hull), z)]) for z in (-half, half)]
        spec.add_mesh(name=PRISM, uservert=np.vstack(ends).ravel())
        prism.type = _GEOM.mjGEOM_MESH
        prism.meshname = PRISM
        prism.pos = [0.0, 0.0, middle]
    for geom in solid:
        prism.contype |= geom.contype
        prism.conaffinity |= geom.conaffinity
        geom.contype = 0
        geom.conaffinity = 0


def fit_looks(spec: mujoco.MjSpec, body: mujoco.MjsBody, own: Footprint, other: Footprint) -> None:
    """Scale and move what is drawn of a robot from its own footprint into another one; wheels that roll stay."""
    free = any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in body.joints)
    if free or not body.explicitinertial:  # geoms may be its mass
        return
    low, high = other.hull.min(axis=0), other.hull.max(axis=0)
    ratio = float(np.min((high - low) / np.ptp(own.hull, axis=0)))
    shift = np.append(0.5 * (low + high) - 0.5 * ratio * (own.hull.min(axis=0) + own.hull.max(axis=0)), 0.0)
    outer = [*body.geoms, *body.bodies]
    for mesh in spec.meshes:
        mesh.scale = ratio * np.asarray(mesh.scale)
    for part in (*body.find_all("geom"), *body.find_all("body")):
        if part.name == "footprint":
            continue
        moved = shift if any(part is one or part == one for one in outer) else np.zeros(3)
        ends = getattr(part, "fromto", np.full(6, np.nan))
        if hasattr(part, "size"):
            part.size = ratio * np.asarray(part.size)
        if ends[0] == ends[0]:  # not a number where a geom has no ends
            part.fromto = ratio * np.asarray(ends) + np.tile(moved, 2)
        else:
            part.pos = ratio * np.asarray(part.pos) + moved


def _color(body: mujoco.MjsBody) -> list[float]:
    """Return the colour of a body's first geom that names one."""
    named = (list(geom.rgba[:3]) for geom in body.find_all("geom"))
    return next((rgb for rgb in named if not np.allclose(rgb, 0.5)), [0.5, 0.5, 0.5])


def upright(obstacle: Obstacle, span: Span) -> Obstacle:
    """Return what an upright prism over a range of heights [m] meets of an obstacle that reaches into it, as upright.

    Boxes and meshes become prisms of their outline, upright cylinders and balls cylinders; what is round and lies askew
    stays as it is.
    """
    middle, half = 0.5 * (span[0] + span[1]), 0.5 * (span[1] - span[0])
    round_one = obstacle.kind in (Kind.CYLINDER, Kind.CAPSULE)
    stands = abs(obstacle.rotation[2, 2]) >= _UPRIGHT
    place = np.array([*obstacle.position[:2], middle])
    if obstacle.kind is Kind.SPHERE or (round_one and stands):
        size = np.array([obstacle.size[0], half, 0.0])
        return replace(obstacle, kind=Kind.CYLINDER, size=size, position=place, rotation=np.eye(3))
    if obstacle.kind is Kind.BOX and stands:
        return replace(obstacle, size=np.array([*obstacle.size[:2], half]), position=place)
    if obstacle.kind not in (Kind.BOX, Kind.MESH):
        return obstacle
    ring = outline(obstacle) - place[:2]
    vertices = np.vstack([np.column_stack([ring, np.full(len(ring), z)]) for z in (-half, half)])
    faces = ConvexHull(vertices).simplices.astype(np.int64)
    return replace(
        obstacle, kind=Kind.MESH, size=np.zeros(3), position=place, rotation=np.eye(3), vertices=vertices, faces=faces
    )
