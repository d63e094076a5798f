"""Meshes that are not convex: MuJoCo collides with their hulls, so hulls take their places, to be seen as well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.obstacle import Obstacle
from sim.mjcf.library import compile_spec
from sim.mjcf.obstacles import geom_label

CONVEX = 0.99  # share of its hull that a mesh fills at least to count as convex


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Concave:
    """A geom whose mesh is not convex."""

    label: str
    corners: Array  # (k, 3) of the hull, in the frame of the mesh's file [m]
    volume: float  # that the mesh encloses [m^3]
    hull: float  # volume of the hull [m^3]

    @property
    def volumes(self) -> str:
        """Both volumes in words."""
        return f"{self.hull:.3g} m3, of which the mesh fills {self.volume:.3g}"

    @property
    def words(self) -> str:
        """Geom and volumes."""
        return f"{self.label} ({self.volumes})"


def concave_meshes(model: mujoco.MjModel, mask: NDArray[np.bool_], solids: Sequence[Obstacle]) -> dict[int, Concave]:
    """The obstacles whose meshes fill less than `CONVEX` of their hulls, by geom.

    Args:
        mask: the obstacles' geoms, (ngeom,).
        solids: the obstacles in that order.
    """
    found = {}
    for geom, solid in zip(np.flatnonzero(mask).tolist(), solids, strict=True):
        if solid.vertices is None or solid.faces is None:
            continue
        mesh = int(model.geom_dataid[geom])
        vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]].astype(float)
        faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
        volume, hull = _enclosed(vertices, faces), _enclosed(solid.vertices, solid.faces)
        if volume < CONVEX * hull:
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, model.mesh_quat[mesh])
            corners = solid.vertices @ turn.reshape(3, 3).T + model.mesh_pos[mesh]
            found[geom] = Concave(label=geom_label(model, geom), corners=corners, volume=volume, hull=hull)
    return found


def use_hulls(spec: mujoco.MjSpec, model: mujoco.MjModel, concave: Mapping[int, Concave], path: Path) -> mujoco.MjModel:
    """The model with hulls in place of meshes; its geoms keep their numbers and places."""
    geoms = {geom.id: geom for geom in spec.geoms}
    for number, (geom, one) in enumerate(concave.items()):
        mesh = spec.add_mesh(name=f"hull {number} of {model.mesh(model.geom_dataid[geom]).name}")
        mesh.uservert = one.corners.ravel()
        geoms[geom].meshname = mesh.name
    return compile_spec(spec, path)


def _enclosed(vertices: Array, faces: NDArray[np.int_]) -> float:
    """The volume [m^3] that faces (k, 3) enclose: of tetrahedra from their middle."""
    a, b, c = np.moveaxis(vertices[faces] - vertices.mean(axis=0), 1, 0)
    return float(abs(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6.0
