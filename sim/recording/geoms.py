"""The solids of a MuJoCo model as Rerun archetypes."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pirrht.arrays import Array
from sim.drawing.colors import Color

_GEOM = mujoco.mjtGeom
_UNSET = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's colour of a geom that names none
_SHOWN_GROUPS = 3  # MuJoCo draws groups 0 to 2 unless asked for more

Indices = NDArray[np.int64]


def shown(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Geoms (ngeom,) that MuJoCo would draw, planes aside."""
    mask: NDArray[np.bool_] = (model.geom_group < _SHOWN_GROUPS) & (model.geom_type != _GEOM.mjGEOM_PLANE)
    return mask


def see_through(model: mujoco.MjModel, opacity: Array, marked: NDArray[np.bool_], color: Color) -> mujoco.MjModel:
    """Return a model whose geoms have other opacities (ngeom,), and the marked ones (ngeom,) one colour."""
    seen = copy.copy(model)
    rgba = np.array([rgba_of(model, geom) for geom in range(model.ngeom)]).reshape(-1, 4) / 255.0
    rgba[marked, :3] = np.array(color) / 255.0
    rgba[:, 3] *= opacity
    seen.geom_rgba[:], seen.geom_matid[:] = rgba, -1
    return seen


def top(model: mujoco.MjModel) -> float:
    """Return a height [m] that no geom reaches above at zero joint positions, planes aside."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return float(np.max(data.geom_xpos[:, 2] + model.geom_rbound, initial=0.0))


def solids(model: mujoco.MjModel, chosen: NDArray[np.bool_], body: str | None = None) -> dict[str, rr.AsComponents]:
    """Chosen geoms (ngeom,) as they stand at zero joint positions, by entity path: one per kind, one per mesh.

    Of a body, whose name is given, they are in its own frame.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    if body is not None:
        _into_frame(data, model.body(body).id)
    drawn: dict[str, rr.AsComponents] = {}
    for kind, name in ((_GEOM.mjGEOM_BOX, "boxes"), (_GEOM.mjGEOM_CYLINDER, "cylinders")):
        if len(group := np.flatnonzero(chosen & (model.geom_type == kind))):
            drawn[name] = _primitives(model, data, group, kind)
    round_ = chosen & np.isin(model.geom_type, (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_ELLIPSOID))
    if len(group := np.flatnonzero(round_)):
        drawn["ellipsoids"] = _ellipsoids(model, data, group)
    if len(group := np.flatnonzero(chosen & (model.geom_type == _GEOM.mjGEOM_CAPSULE))):
        drawn["capsules"] = _capsules(model, data, group)
    for geom in np.flatnonzero(chosen & (model.geom_type == _GEOM.mjGEOM_MESH)):
        drawn[f"meshes/{_part(model, int(geom))}"] = _mesh(model, data, int(geom))
    return drawn


def _into_frame(data: mujoco.MjData, body: int) -> None:
    """Express the poses of all geoms in the frame of a body."""
    turn = data.xmat[body].reshape(3, 3)
    data.geom_xpos[:] = (data.geom_xpos - data.xpos[body]) @ turn
    data.geom_xmat[:] = (turn.T @ data.geom_xmat.reshape(-1, 3, 3)).reshape(-1, 9)


def names(model: mujoco.MjModel, chosen: NDArray[np.bool_]) -> list[str]:
    """What the file calls each of the chosen geoms (ngeom,): by the geom, else by its body; empty where by neither."""
    bodies = model.geom_bodyid
    return [model.geom(g).name or (model.body(bodies[g]).name if bodies[g] else "") for g in np.flatnonzero(chosen)]


def of_body(model: mujoco.MjModel, body: str) -> NDArray[np.bool_]:
    """Geoms (ngeom,) of a body of the worldbody and of bodies inside it."""
    mask: NDArray[np.bool_] = model.body_rootid[model.geom_bodyid] == model.body(body).id
    return mask


def _primitives(model: mujoco.MjModel, data: mujoco.MjData, group: Indices, kind: mujoco.mjtGeom) -> rr.AsComponents:
    size, look = model.geom_size[group], _look(model, data, group)
    if kind == _GEOM.mjGEOM_BOX:
        return rr.Boxes3D(half_sizes=size, fill_mode="solid", **look)
    return rr.Cylinders3D(lengths=2 * size[:, 1], radii=size[:, 0], fill_mode="solid", **look)


def _ellipsoids(model: mujoco.MjModel, data: mujoco.MjData, group: Indices) -> rr.AsComponents:
    ball = model.geom_type[group] == _GEOM.mjGEOM_SPHERE
    axes = np.where(ball[:, None], model.geom_size[group][:, :1], model.geom_size[group])
    return rr.Ellipsoids3D(half_sizes=axes, fill_mode="solid", **_look(model, data, group))


def _capsules(model: mujoco.MjModel, data: mujoco.MjData, group: Indices) -> rr.AsComponents:
    size, look = model.geom_size[group], _look(model, data, group)
    axis = data.geom_xmat[group].reshape(-1, 3, 3)[:, :, 2]
    # Rerun's capsule begins at its lower cap's centre, MuJoCo's is centred.
    look["translations"] = look.pop("centers") - axis * size[:, 1:2]
    return rr.Capsules3D(lengths=2 * size[:, 1], radii=size[:, 0], fill_mode="solid", **look)


def _part(model: mujoco.MjModel, geom: int) -> str:
    """A geom as part of an entity path: its number, which tells it from all others, and its name."""
    part: str = rr.escape_entity_path_part(f"{geom} {model.geom(geom).name}".strip())
    return part


def _mesh(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> rr.AsComponents:
    """A mesh with its normals, without which the viewer draws it flat; corners that share both are one."""
    mesh, turn = int(model.geom_dataid[geom]), data.geom_xmat[geom].reshape(3, 3).T
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] :][: model.mesh_normalnum[mesh]]
    corners = np.stack([model.mesh_face[first:][:count], model.mesh_facenormal[first:][:count]], axis=-1)
    pairs, faces = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    return rr.Mesh3D(
        vertex_positions=np.float32(vertices[pairs[:, 0]] @ turn + data.geom_xpos[geom]),
        vertex_normals=np.float32(normals[pairs[:, 1]] @ turn),
        triangle_indices=faces.reshape(-1, 3),
        albedo_factor=rgba_of(model, geom),
    )


def _look(model: mujoco.MjModel, data: mujoco.MjData, group: Indices) -> dict[str, object]:
    quaternions = np.zeros((len(group), 4))
    for row, geom in zip(quaternions, group, strict=True):
        mujoco.mju_mat2Quat(row, data.geom_xmat[geom])
    return {
        "centers": data.geom_xpos[group],
        "quaternions": np.roll(quaternions, -1, axis=1),  # MuJoCo writes w first, Rerun last
        "colors": [rgba_of(model, int(geom)) for geom in group],
    }


def rgba_of(model: mujoco.MjModel, geom: int) -> tuple[int, int, int, int]:
    """Colour of a geom as MuJoCo would draw it, textures aside, 0..255."""
    rgba, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    if material >= 0 and np.allclose(rgba, _UNSET):
        rgba = model.mat_rgba[material]
    red, green, blue, alpha = (round(255 * float(c)) for c in rgba)
    return red, green, blue, alpha
