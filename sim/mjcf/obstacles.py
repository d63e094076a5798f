"""What of a compiled MuJoCo model stands in the robot's way, and how far the workspace reaches."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.scene import Kind, Obstacle
from sim.mjcf.coordinates import GROUND
from sim.mjcf.faults import Faults
from sim.mjcf.frozen import listed
from sim.mjcf.numbers import FAR, MOTION, refuse_far

Mask = NDArray[np.bool_]

_GEOM = mujoco.mjtGeom
_PLANE = int(_GEOM.mjGEOM_PLANE)
_KINDS = {
    int(_GEOM.mjGEOM_BOX): Kind.BOX,
    int(_GEOM.mjGEOM_CYLINDER): Kind.CYLINDER,
    int(_GEOM.mjGEOM_SPHERE): Kind.SPHERE,
    int(_GEOM.mjGEOM_CAPSULE): Kind.CAPSULE,
    int(_GEOM.mjGEOM_ELLIPSOID): Kind.ELLIPSOID,
    int(_GEOM.mjGEOM_MESH): Kind.MESH,
}
_UNIT = 1e-6  # by which the norm of a rotation's quaternion may be off 1
_TOUCH = 1e-9  # what only touches the robot's height range, like a slab it stands on, is not in its way [m]


def read_obstacles(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    robot: Mask,
    span: tuple[float, float],
    path: Path,
    faults: Faults,
) -> tuple[Mask, tuple[Obstacle, ...]]:
    """The static geoms that would collide with the robot and reach into its height range.

    Args:
        model: the robot joined to its scene.
        data: its data after kinematics.
        robot: mask of the robot's geoms, (ngeom,).
        span: the robot's height range [m].
        path: the scene's file, for messages.
        faults: takes moving bodies, flexes, planes that are no floor, height fields, and meshes without volume.

    Returns:
        The mask of the obstacles' geoms, (ngeom,), and their plain values in the order of the model.
    """
    faults.of(_refuse_moving, model, robot, path)
    faults.of(_refuse_flexes, model, path)
    mask = np.zeros(model.ngeom, dtype=bool)
    obstacles = []
    for geom in np.flatnonzero(~robot & _collides(model, robot)):
        if int(model.geom_type[geom]) == _PLANE:
            faults.of(_check_floor, model, data, int(geom), path)
            continue
        obstacle = faults.of(_obstacle, model, data, int(geom), path)
        if obstacle is None:
            continue
        low, high = _height_range(obstacle)
        if low < span[1] - _TOUCH and high > span[0] + _TOUCH:
            mask[geom] = True
            obstacles.append(obstacle)
    return mask, tuple(obstacles)


def read_workspace(
    model: mujoco.MjModel, data: mujoco.MjData, given: Sequence[float] | None, path: Path
) -> tuple[Array, Array]:
    """Least and greatest corner (2,) [m]: as given, else of the site `workspace`, else of the first horizontal plane.

    Args:
        given: x0, x1, y0, y1 [m], or None.

    Raises:
        SceneError: there is none, it is askew or no box, or what is given is empty; names the remedy.
    """
    if given is not None:
        bounds = np.array(given, dtype=float)
        if bounds.shape != (4,) or not np.all(np.abs(bounds) <= FAR) or not np.all(bounds[::2] < bounds[1::2]):
            raise SceneError(f"{path}: the workspace {bounds.tolist()} is none; give x0 < x1 and y0 < y1")
        return bounds[::2], bounds[1::2]
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "workspace")
    if site >= 0:
        if int(model.site_type[site]) != int(_GEOM.mjGEOM_BOX):
            raise SceneError(f'{path}: site "workspace" must be a box; write type="box" and its half sizes')
        pose = data.site_xpos[site], data.site_xmat[site]
        return _extent(*pose, model.site_size[site], 'site "workspace"', path)
    site_text = '<site name="workspace" type="box" pos="x y z" size="half-x half-y half-z"/>'
    remedy = f"add {site_text} or give --workspace X0 X1 Y0 Y1"
    planes = [g for g in np.flatnonzero(model.geom_type == _PLANE) if _faces_up(data, int(g))]
    planes = [g for g in planes if model.geom(g).name != f"robot/{GROUND}"]
    if not planes:
        raise SceneError(f'{path}: no site "workspace" and no horizontal floor plane; {remedy}')
    floor = int(planes[0])
    size, what = model.geom_size[floor], geom_label(model, floor)
    if not np.all(size[:2] > 0):
        raise SceneError(f"{path}: {what} is infinite and bounds nothing; give it half sizes or {remedy}")
    return _extent(data.geom_xpos[floor], data.geom_xmat[floor], np.array([*size[:2], 0.0]), what, path)


def geom_label(model: mujoco.MjModel, geom: int) -> str:
    """How messages call a geom, by its name or by its place."""
    name = model.geom(geom).name
    if name:
        return f'geom "{name}"'
    body = model.body(model.geom_bodyid[geom]).name
    return f'unnamed geom number {geom} (in body "{body}")'


def _collides(model: mujoco.MjModel, robot: Mask) -> Mask:
    """MuJoCo's rule of contact bits, against any of the robot's geoms."""
    offered, accepted = model.geom_contype, model.geom_conaffinity
    match = (offered[:, None] & accepted[robot]) | (offered[robot] & accepted[:, None])
    return np.asarray(np.any(match != 0, axis=1))


def refuse_turns(model: mujoco.MjModel, path: Path) -> None:
    """Refuse bodies, geoms and sites whose compiled rotations are none, which would vanish from all checks.

    Raises:
        SceneError: names the first of each kind.
    """
    for kind, turns, name in (
        ("body", model.body_quat, model.body),
        ("geom", model.geom_quat, model.geom),
        ("site", model.site_quat, model.site),
    ):
        wrong = np.flatnonzero(~(np.abs(np.linalg.norm(turns, axis=1) - 1.0) < _UNIT))
        if len(wrong):
            label = f'{kind} "{name(wrong[0]).name}"' if name(wrong[0]).name else f"unnamed {kind} number {wrong[0]}"
            raise SceneError(
                f"{path}: {label} has a rotation that is not finite after compilation; write finite numbers of "
                "ordinary size in its orientation, its mesh, and the frames and bodies around it"
            )


def _refuse_moving(model: mujoco.MjModel, robot: Mask, path: Path) -> None:
    own = set(model.body_rootid[model.geom_bodyid[robot]].tolist())
    joints: dict[int, list[str]] = {}
    for joint in range(model.njnt):
        root = int(model.body_rootid[model.jnt_bodyid[joint]])
        if root not in own:
            joints.setdefault(root, []).append(_joint_label(model.joint(joint)))
    if joints:
        moving = [f'body "{model.body(root).name}" moves by {listed(names)}' for root, names in joints.items()]
        name = model.body(next(iter(joints))).name or "NAME"
        raise SceneError(
            f"{path}: {listed(moving)}; obstacles stand, or move by rows: remove joints, load it with --freeze or "
            f'--without {name}, or write <body mocap="true" ...> and a numeric "{MOTION}{name}"'
        )


def _joint_label(joint: Any) -> str:
    kind = mujoco.mjtJoint(int(joint.type[0])).name.removeprefix("mjJNT_").lower()
    return f'joint "{joint.name}"' if joint.name else f"a {kind} joint"


def _refuse_flexes(model: mujoco.MjModel, path: Path) -> None:
    if model.nflex:
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_FLEX, 0)
        raise SceneError(f'{path}: flex "{name}" deforms; obstacles must be static: remove it')


def _check_floor(model: mujoco.MjModel, data: mujoco.MjData, geom: int, path: Path) -> None:
    label, height = geom_label(model, geom), float(data.geom_xpos[geom, 2])
    if not _faces_up(data, geom):
        raise SceneError(f"{path}: {label} is a plane that is not a horizontal floor; write a box instead")
    if height > _TOUCH:
        raise SceneError(f"{path}: {label} is a floor at height {height:g}; robots stand at 0: move it there")


def _faces_up(data: mujoco.MjData, geom: int) -> bool:
    return bool(data.geom_xmat[geom, 8] > 1 - 1e-9)


def _obstacle(model: mujoco.MjModel, data: mujoco.MjData, geom: int, path: Path) -> Obstacle:
    label = geom_label(model, geom)
    kind = _KINDS.get(int(model.geom_type[geom]))
    if kind is None:
        shape = _GEOM(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
        known = ", ".join(k.value for k in Kind)
        raise SceneError(f"{path}: {label} is of type {shape}; remove it or write one of {known}")
    refuse_far(label, path, data.geom_xpos[geom], model.geom_size[geom])
    vertices, faces = _hull(model, geom, path) if kind is Kind.MESH else (None, None)
    if vertices is not None:
        refuse_far(label, path, vertices)
    return Obstacle(
        name=model.geom(geom).name or f"geom{geom}",
        kind=kind,
        size=np.zeros(3) if kind is Kind.MESH else np.array(model.geom_size[geom]),
        position=np.array(data.geom_xpos[geom]),
        rotation=np.array(data.geom_xmat[geom]).reshape(3, 3),
        vertices=vertices,
        faces=faces,
    )


def _hull(model: mujoco.MjModel, geom: int, path: Path) -> tuple[Array, NDArray[np.int64]]:
    """Convex hull in the frame of the geom: MuJoCo recentres meshes, and its geom poses account for that."""
    import trimesh  # slow to import, and few scenes have meshes

    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    points = np.array(model.mesh_vert[first : first + count], dtype=float)
    try:
        hull = trimesh.convex.convex_hull(points)
    except Exception as error:  # whatever Qhull says of points without volume
        reason, label = str(error).split("\n")[0], geom_label(model, geom)
        raise SceneError(f"{path}: the mesh of {label} has no hull ({reason}); give it volume") from None
    return np.array(hull.vertices, dtype=float), np.array(hull.faces, dtype=np.int64)


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


def _extent(centre: Array, rotation: Array, size: Array, what: str, path: Path) -> tuple[Array, Array]:
    refuse_far(what, path, centre, size)
    turn = np.abs(rotation.reshape(3, 3))
    if np.any(np.minimum(turn, np.abs(1 - turn)) > 1e-6):
        raise SceneError(f"{path}: {what} is askew; the domain is aligned with the axes: turn it by quarter turns")
    half = turn @ size
    return np.array(centre[:2] - half[:2]), np.array(centre[:2] + half[:2])
