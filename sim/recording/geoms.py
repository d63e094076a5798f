"""Solids of a MuJoCo model as Rerun archetypes, and poses of the bodies of the robot.

The root follows the state. Wheels are bodies whose names end with "wheel", or that turn by a hinge of their own about
a level axis; they roll without slipping by what their centres have moved ahead, physics step by physics step, with
the radius that takes them to the ground.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pirrht.arrays import Array
from sim.drawing.colors import Color
from sim.mjcf import Loaded
from sim.mjcf.coordinates import stance_of

_GEOM = mujoco.mjtGeom
_UNSET = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's colour of a geom that names none
_SHOWN_GROUPS = 3  # MuJoCo draws groups 0 to 2 unless asked for more

Indices = NDArray[np.int64]
ROOT = "robot/robot"
HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


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
    """Name the chosen geoms (ngeom,) as the file does: by the geom, else by its body; empty where by neither."""
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """A body of the robot other than its root, as it sits in the root."""

    name: str  # in the model
    place: Array  # (3,) [m]
    turn: Array  # (4,) quaternion, w first
    radius: float  # of a wheel [m]; 0 of what does not roll
    axis: Array  # (3,) of a wheel, in its own frame


class Bodies:
    """Poses of the robot's bodies along a drive."""

    def __init__(self, loaded: Loaded) -> None:
        self._model, self._data = loaded.model, mujoco.MjData(loaded.model)
        self._stance = stance_of(loaded.model, loaded.states)
        self._root = int(loaded.model.body(ROOT).id)
        mujoco.mj_resetDataKeyframe(self._model, self._data, 0)
        mujoco.mj_kinematics(self._model, self._data)
        inside = np.flatnonzero(self._model.body_rootid == self._root)
        self.parts = tuple(self._part(int(body)) for body in inside if body != self._root)
        self.wheels = tuple(part for part in self.parts if part.radius > 0.0)
        self._rolled = np.zeros(len(self.wheels))
        self._before: Array | None = None

    def _part(self, body: int) -> Part:
        model, data, back = self._model, self._data, np.empty(4)
        mujoco.mju_negQuat(back, data.xquat[self._root])
        place, turn = np.empty(3), np.empty(4)
        mujoco.mju_rotVecQuat(place, data.xpos[body] - data.xpos[self._root], back)
        mujoco.mju_mulQuat(turn, back, data.xquat[body])
        joint = int(model.body_jntadr[body])
        hinged = joint >= 0 and int(model.jnt_type[joint]) == HINGE
        axis = np.array(model.jnt_axis[joint]) if hinged else np.array([0.0, 1.0, 0.0])
        level = abs(data.xmat[body].reshape(3, 3)[2] @ axis) < 0.1
        rolls = level and (hinged or model.body(body).name.endswith("wheel"))
        radius = float(data.xpos[body, 2]) if rolls else 0.0
        return Part(name=model.body(body).name, place=place, turn=turn, radius=max(radius, 0.0), axis=axis)

    def root(self, states: Array) -> Array:
        """Poses (k, 7) of the root at states (k, n): x, y, z [m] and a quaternion, w last."""
        poses = np.empty((len(states), 7))
        still, rest = np.zeros(2), np.zeros(self._model.nu)
        for pose, state in zip(poses, states, strict=True):
            self._stance.place(self._data, state, still, rest)
            mujoco.mj_kinematics(self._model, self._data)
            pose[:3], pose[3:] = self._data.xpos[self._root], np.roll(self._data.xquat[self._root], -1)
        return poses

    def roll(self, states: Array, headings: Array) -> None:
        """Turn the wheels along states (k, n) with headings (k,) [rad], which follow those of the last call."""
        here = np.column_stack([states[:, :2], headings])
        whole = here if self._before is None else np.vstack([self._before, here])
        self._before = here[-1:]
        for i, wheel in enumerate(self.wheels):
            self._rolled[i] += _ahead(whole, wheel.place) / wheel.radius

    def turned(self) -> Array:
        """Quaternions (w, 4) of the wheels in the root, w last."""
        found, spin = np.empty((len(self.wheels), 4)), np.empty(4)
        for row, wheel, angle in zip(found, self.wheels, self._rolled, strict=True):
            mujoco.mju_axisAngle2Quat(spin, wheel.axis, float(angle))
            mujoco.mju_mulQuat(row, wheel.turn, spin)
        return np.roll(found, -1, axis=1)


def _ahead(poses: Array, place: Array) -> float:
    """Measure how far a point of the robot moves along its heading over poses x, y, heading (k, 3) [m]."""
    x, y, heading = poses.T
    c, s = np.cos(heading), np.sin(heading)
    points = np.column_stack([x + c * place[0] - s * place[1], y + s * place[0] + c * place[1]])
    steps, middle = np.diff(points, axis=0), 0.5 * (heading[1:] + heading[:-1])
    return float(np.sum(steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)))
