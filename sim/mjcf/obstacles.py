"""Obstacles of a compiled MuJoCo model, and how far the workspace reaches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.scene import Kind, Obstacle
from sim.mjcf.coordinates import GROUND
from sim.mjcf.limits import FARTHEST, Faults, listed, prefixed, refuse_far

Mask = NDArray[np.bool_]
Faces = NDArray[np.int64]

MOTION = "pirrht_motion_"  # with the name of a body: how it moves (`sim.mjcf.motions`)
_GEOM = mujoco.mjtGeom
CONVEX = 0.99  # share of its hull that a mesh fills at least to count as convex
_UNIT = 1e-6  # by which the norm of a rotation's quaternion may be off 1
_UP = 1 - 1e-9  # the upward part of the normal of a horizontal plane, at least
_TOUCH = 1e-9  # what only touches the robot's height range, like a slab it stands on, is not in its way [m]


def read_obstacles(
    model: mujoco.MjModel, data: mujoco.MjData, robot: Mask, span: tuple[float, float], faults: Faults
) -> dict[int, Obstacle]:
    """The geoms that would collide with the robot and reach into its height range `span` [m], in their order.

    Args:
        robot: mask of the robot's geoms, (ngeom,).
        faults: takes moving bodies, flexes, planes that are no floor, height fields, and meshes without volume.
    """
    faults.of(_refuse_turns, model)
    faults.of(_refuse_moving, model, robot)
    found = {}
    offered, accepted = model.geom_contype, model.geom_conaffinity
    match = (offered[:, None] & accepted[robot]) | (offered[robot] & accepted[:, None])
    for geom in np.flatnonzero(~robot & np.any(match != 0, axis=1)).tolist():
        obstacle = faults.of(_obstacle, model, data, geom)
        if obstacle is not None:
            low, high = _height_range(obstacle)
            if low < span[1] - _TOUCH and high > span[0] + _TOUCH:
                found[geom] = obstacle
    return found


def read_workspace(model: mujoco.MjModel, data: mujoco.MjData, given: Sequence[float] | None) -> tuple[Array, Array]:
    """Least and greatest corner (2,) [m]: as given, else of the site `workspace`, else of the first floor plane."""
    if given is not None:
        bounds = np.array(given, dtype=float)
        if bounds.shape != (4,) or not np.all(np.abs(bounds) <= FARTHEST) or not np.all(bounds[::2] < bounds[1::2]):
            raise SceneError(f"the workspace {bounds.tolist()} is none; give x0 < x1 and y0 < y1")
        return bounds[::2], bounds[1::2]
    site = site_of(model, "workspace")
    if site >= 0:
        if model.site_type[site] != _GEOM.mjGEOM_BOX:
            raise SceneError('site "workspace" must be a box; write type="box" and its half sizes')
        return _extent('site "workspace"', data.site_xpos[site], data.site_xmat[site], model.site_size[site])
    remedy = '<site name="workspace" type="box" pos="x y z" size="half-x half-y half-z"/>'
    remedy = f"add {remedy} or give --workspace X0 X1 Y0 Y1"
    planes = np.flatnonzero((model.geom_type == _GEOM.mjGEOM_PLANE) & (data.geom_xmat[:, 8] > _UP)).tolist()
    floor = next((geom for geom in planes if model.geom(geom).name != f"robot/{GROUND}"), None)
    if floor is None:
        raise SceneError(f'no site "workspace" and no horizontal floor plane; {remedy}')
    size = model.geom_size[floor, :2]
    if not np.all(size > 0):
        raise SceneError(f"{geom_label(model, floor)} is infinite and bounds nothing; give it half sizes or {remedy}")
    return _extent(geom_label(model, floor), data.geom_xpos[floor], data.geom_xmat[floor], np.append(size, 0.0))


def site_of(model: mujoco.MjModel, name: str) -> int:
    """The number of a site; -1 if there is none."""
    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name))


def geom_label(model: mujoco.MjModel, geom: int) -> str:
    """How messages call a geom, by its name or by its place."""
    name, body = model.geom(geom).name, model.body(model.geom_bodyid[geom]).name
    return f'geom "{name}"' if name else f'unnamed geom number {geom} (in body "{body}")'


def _refuse_turns(model: mujoco.MjModel) -> None:
    """Refuse compiled rotations that are none, which would vanish from all checks."""
    for kind in ("body", "geom", "site"):
        norms = np.linalg.norm(getattr(model, f"{kind}_quat"), axis=1)
        wrong = np.flatnonzero(~(np.abs(norms - 1.0) < _UNIT))
        if len(wrong):
            name = getattr(model, kind)(wrong[0]).name
            label = f'{kind} "{name}"' if name else f"unnamed {kind} number {wrong[0]}"
            raise SceneError(
                f"{label} has a rotation that is not finite after compilation; write finite numbers of ordinary size "
                "in its orientation, its mesh, and the frames and bodies around it"
            )


def _refuse_moving(model: mujoco.MjModel, robot: Mask) -> None:
    """Refuse what deforms, and bodies with joints."""
    if model.nflex:
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_FLEX, 0)
        raise SceneError(f'flex "{name}" deforms; obstacles must be static: remove it')
    own = set(model.body_rootid[model.geom_bodyid[robot]].tolist())
    joints: dict[int, list[str]] = {}
    for joint, root in enumerate(model.body_rootid[model.jnt_bodyid].tolist()):
        if root not in own:
            kind = mujoco.mjtJoint(int(model.jnt_type[joint])).name.removeprefix("mjJNT_").lower()
            name = model.joint(joint).name
            joints.setdefault(root, []).append(f'joint "{name}"' if name else f"a {kind} joint")
    if joints:
        moving = [f'body "{model.body(root).name}" moves by {listed(names)}' for root, names in joints.items()]
        name = model.body(next(iter(joints))).name or "NAME"
        raise SceneError(
            f"{listed(moving)}; obstacles stand, or move by rows: remove joints, load it with --freeze or "
            f'--without {name}, or write <body mocap="true" ...> and a numeric "{MOTION}{name}"'
        )


def _obstacle(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Obstacle | None:
    """The plain values of a geom; None for a horizontal floor."""
    label, shape = geom_label(model, geom), _GEOM(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
    if shape == "plane":
        if data.geom_xmat[geom, 8] > _UP and data.geom_xpos[geom, 2] <= _TOUCH:
            return None
        raise SceneError(f"{label} is a plane, but no horizontal floor at 0; move it, or write a box")
    if shape not in {kind.value for kind in Kind}:
        raise SceneError(f"{label} is of type {shape}; remove it or write one of {', '.join(k.value for k in Kind)}")
    refuse_far(label, data.geom_xpos[geom], model.geom_size[geom])
    vertices, faces, size = None, None, np.array(model.geom_size[geom])
    if shape == Kind.MESH.value:
        with prefixed(f"the mesh of {label} "):
            vertices, faces = _hull_of(mesh_of(model, geom)[0])
        refuse_far(label, vertices)
        size = np.zeros(3)
    return Obstacle(
        name=model.geom(geom).name or f"geom{geom}", kind=Kind(shape), size=size, vertices=vertices, faces=faces,
        position=np.array(data.geom_xpos[geom]), rotation=np.array(data.geom_xmat[geom]).reshape(3, 3),
    )  # fmt: skip


def _height_range(obstacle: Obstacle) -> tuple[float, float]:
    """Lowest and highest point [m]."""
    up, size, middle = obstacle.rotation[2], obstacle.size, float(obstacle.position[2])
    if obstacle.vertices is not None:
        heights = obstacle.vertices @ up
        return middle + float(heights.min()), middle + float(heights.max())
    half = {
        Kind.BOX: np.abs(up) @ size,
        Kind.CYLINDER: size[0] * np.hypot(up[0], up[1]) + size[1] * abs(up[2]),
        Kind.SPHERE: size[0],
        Kind.CAPSULE: size[0] + size[1] * abs(up[2]),
        Kind.ELLIPSOID: np.linalg.norm(up * size),
    }[obstacle.kind]
    return middle - float(half), middle + float(half)


def _extent(what: str, centre: Array, rotation: Array, size: Array) -> tuple[Array, Array]:
    refuse_far(what, centre, size)
    turn = np.abs(rotation.reshape(3, 3))
    if np.any(np.minimum(turn, np.abs(1 - turn)) > 1e-6):
        raise SceneError(f"{what} is askew; the domain is aligned with the axes: turn it by quarter turns")
    half = turn @ size
    return np.array(centre[:2] - half[:2]), np.array(centre[:2] + half[:2])


def mesh_of(model: mujoco.MjModel, geom: int) -> tuple[Array, Faces]:
    """Corners (v, 3) [m] in the frame of the geom, and faces (f, 3): MuJoCo recentres meshes, and poses with them."""
    mesh = int(model.geom_dataid[geom])
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]].astype(float)
    return vertices, model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]


def _hull_of(vertices: Array) -> tuple[Array, Faces]:
    """Corners and faces of the convex hull of points (v, 3); SceneError if they have no volume."""
    import trimesh  # slow to import, and few scenes have meshes

    try:
        hull = trimesh.convex.convex_hull(vertices)
    except Exception as error:  # whatever Qhull says of points without volume
        raise SceneError(f"has no hull ({str(error).partition(chr(10))[0]}); give it volume") from None
    return np.array(hull.vertices, dtype=float), np.array(hull.faces, dtype=np.int64)


def concave_meshes(model: mujoco.MjModel, solids: Mapping[int, Obstacle]) -> dict[int, str]:
    """How messages call meshes, by geom, that fill less than `CONVEX` of their hulls, with which MuJoCo collides."""
    found = {}
    for geom, hull in solids.items():
        if hull.vertices is not None:
            from trimesh import Trimesh

            parts = mesh_of(model, geom), (hull.vertices, hull.faces)
            mine, whole = (abs(float(Trimesh(*part, process=False).volume)) for part in parts)
            if mine < CONVEX * whole:
                found[geom] = f"{geom_label(model, geom)} ({whole:.3g} m3, of which the mesh fills {mine:.3g})"
    return found
