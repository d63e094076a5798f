"""Solids of a MuJoCo model and the exact value on its floor as Rerun archetypes, and poses of the robot along a run."""

import copy

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.plotting.colors import Color
from sim.mjcf import Loaded
from sim.states import adapter_of

_GEOM = mujoco.mjtGeom
_UNSET = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's colour of a geom that names none
_SHOWN_GROUPS = 3  # MuJoCo draws groups 0 to 2 unless asked for more

Mask = NDArray[np.bool_]
ROOT = "robot/robot"
PIXELS, MOVING_PIXELS = 120, 48  # along the longer side of the floor: drawn once, and time and again
HEADINGS = 12  # that are tried of a robot that has one
BANDS = 24  # of equal cost
BLOCKED = (24, 27, 32)
SHADES = (44, 62, 110), (92, 105, 138), (150, 150, 140), (226, 208, 150)  # from great values to small ones


def shown(model: mujoco.MjModel) -> Mask:
    """Geoms (ngeom,) that MuJoCo would draw, planes aside."""
    mask: Mask = (model.geom_group < _SHOWN_GROUPS) & (model.geom_type != _GEOM.mjGEOM_PLANE)
    return mask


def see_through(model: mujoco.MjModel, opacity: Array, marked: Mask, color: Color) -> mujoco.MjModel:
    """Return a model whose geoms have other opacities (ngeom,), and the marked ones (ngeom,) one colour."""
    seen = copy.copy(model)
    rgba = np.array([rgba_of(model, geom) for geom in range(model.ngeom)]).reshape(-1, 4) / 255.0
    rgba[marked, :3] = np.array(color) / 255.0
    rgba[:, 3] *= opacity
    seen.geom_rgba[:], seen.geom_matid[:] = rgba, -1
    return seen


def solids(model: mujoco.MjModel, chosen: Mask, body: str | None = None) -> dict[str, rr.AsComponents]:
    """Chosen geoms (ngeom,) at zero joint positions, in the frame of a body or the world, by kind or mesh."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    if body is not None:
        frame = model.body(body).id
        turn = data.xmat[frame].reshape(3, 3)
        data.geom_xpos[:] = (data.geom_xpos - data.xpos[frame]) @ turn
        data.geom_xmat[:] = (turn.T @ data.geom_xmat.reshape(-1, 3, 3)).reshape(-1, 9)
    kinds = model.geom_type
    groups = {
        "boxes": kinds == _GEOM.mjGEOM_BOX,
        "cylinders": kinds == _GEOM.mjGEOM_CYLINDER,
        "ellipsoids": np.isin(kinds, (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_ELLIPSOID)),
        "capsules": kinds == _GEOM.mjGEOM_CAPSULE,
    }
    found = {name: np.flatnonzero(chosen & mask) for name, mask in groups.items()}
    drawn = {name: _primitives(model, data, group, name) for name, group in found.items() if len(group)}
    for geom in np.flatnonzero(chosen & (kinds == _GEOM.mjGEOM_MESH)):
        part = rr.escape_entity_path_part(f"{geom} {model.geom(geom).name}".strip())  # the number tells it from others
        drawn[f"meshes/{part}"] = _mesh(model, data, int(geom))
    return drawn


def _primitives(model: mujoco.MjModel, data: mujoco.MjData, group: NDArray[np.int64], kind: str) -> rr.AsComponents:
    size = model.geom_size[group]
    quaternions = np.zeros((len(group), 4))

    for row, geom in zip(quaternions, group, strict=True):
        mujoco.mju_mat2Quat(row, data.geom_xmat[geom])
    look = {
        "centers": data.geom_xpos[group],
        "quaternions": np.roll(quaternions, -1, axis=1),  # MuJoCo writes w first, Rerun last
        "colors": [rgba_of(model, int(geom)) for geom in group],
        "fill_mode": "solid",
    }
    if kind == "boxes":
        return rr.Boxes3D(half_sizes=size, **look)
    if kind == "ellipsoids":
        return rr.Ellipsoids3D(half_sizes=np.where(size > 0.0, size, size[:, :1]), **look)  # a ball has one size
    look |= {"lengths": 2 * size[:, 1], "radii": size[:, 0]}
    if kind == "cylinders":
        return rr.Cylinders3D(**look)
    # Rerun's capsule begins at its lower cap's centre, MuJoCo's is centred.
    axis = data.geom_xmat[group].reshape(-1, 3, 3)[:, :, 2]
    return rr.Capsules3D(translations=look.pop("centers") - axis * size[:, 1:2], **look)


def _mesh(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> rr.AsComponents:
    """A mesh with its normals, without which the viewer draws it flat; corners that share both are one."""
    mesh, turn = int(model.geom_dataid[geom]), data.geom_xmat[geom].reshape(3, 3).T
    first = int(model.mesh_faceadr[mesh])
    count = int(model.mesh_facenum[mesh])
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


def rgba_of(model: mujoco.MjModel, geom: int) -> tuple[int, int, int, int]:
    """Colour of a geom as MuJoCo would draw it, textures aside, 0..255."""
    rgba = model.geom_rgba[geom]
    material = int(model.geom_matid[geom])

    if material >= 0 and np.allclose(rgba, _UNSET):
        rgba = model.mat_rgba[material]
    red, green, blue, alpha = (round(255 * float(c)) for c in rgba)
    return red, green, blue, alpha


def on_floor(grid: Desirability, space: FreeSpace, time: float) -> rr.AsComponents:
    """Lay the value at a time [s] on the floor."""
    (x0, y0), (x1, y1) = space.scene.lower, space.scene.upper
    return rr.Mesh3D(
        vertex_positions=[(x0, y0, 0.001), (x1, y0, 0.001), (x1, y1, 0.001), (x0, y1, 0.001)],
        vertex_texcoords=[(0, 1), (1, 1), (1, 0), (0, 0)],
        triangle_indices=[(0, 1, 2), (0, 2, 3)],
        albedo_texture=painted(grid, space, time, MOVING_PIXELS if grid.moves else PIXELS),
    )


def painted(grid: Desirability, space: FreeSpace, time: float, pixels: int) -> NDArray[np.uint8]:
    """The value from above, north being up, (height, width, 3): pale at the goal, in bands darker with the value."""
    scene, extent = space.scene, space.scene.upper - space.scene.lower
    shape = np.maximum(1, np.rint(pixels * extent / extent.max())).astype(int)
    middles = [low + size * (np.arange(n) + 0.5) / n for low, size, n in zip(scene.lower, extent, shape, strict=True)]
    points = np.stack(np.meshgrid(*middles), axis=-1).reshape(-1, 2)
    free = space.collision.clearance(points) > 0.0
    free |= scene.goal.contains(points)
    colors = np.tile(np.array(BLOCKED, dtype=np.uint8), (len(points), 1))
    if free.any():
        value = values(grid, points[free], time)
        top = max(float(np.quantile(value, 0.98)), 1e-9)
        place = (1.0 - np.ceil(np.minimum(value / top, 1.0) * BANDS) / BANDS) * (len(SHADES) - 1)
        colors[free] = np.column_stack([np.interp(place, range(len(SHADES)), c) for c in zip(*SHADES, strict=True)])
    return colors.reshape(shape[1], shape[0], 3)[::-1]


def values(grid: Desirability, points: Array, time: float) -> Array:
    """Return v at points (k, 2) [m], (k,) [cost]; at the best heading if the robot has one."""
    states = adapter_of(grid.problem.dynamics.states).facing(points, HEADINGS)
    least: Array = np.min([np.asarray(grid.value(np.ascontiguousarray(x), time)) for x in states], axis=0)
    return least


class RobotPoses:
    """Poses of the robot's root, which follows the state; its other bodies stay where they are in the root."""

    def __init__(self, loaded: Loaded) -> None:
        self._model, self._data = loaded.model, mujoco.MjData(loaded.model)
        self._joints = loaded.adapter.joints(loaded.model)
        self._root = int(loaded.model.body(ROOT).id)

    def at(self, states: Array) -> Array:
        """Poses (k, 7) of the root in states (k, n), or n + 4 with attitudes: x, y, z [m] and a quaternion, w last."""
        poses = np.empty((len(states), 7))
        still = np.zeros(2)
        rest = np.zeros(self._model.nu)

        for pose, state in zip(poses, states, strict=True):
            self._joints.place(self._data, state, still, rest)
            mujoco.mj_kinematics(self._model, self._data)
            pose[:3] = self._data.xpos[self._root]
            pose[3:] = np.roll(self._data.xquat[self._root], -1)
        return poses
