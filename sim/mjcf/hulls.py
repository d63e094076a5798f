"""Hulls of meshes: MuJoCo collides with them, so they take the places of meshes that are not convex, to be seen too."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.obstacle import Obstacle
from sim.mjcf.library import compile_spec

CONVEX = 0.99  # share of its hull that a mesh fills at least to count as convex
Faces = NDArray[np.int64]


def mesh_of(model: mujoco.MjModel, geom: int) -> tuple[Array, Faces]:
    """Corners (v, 3) [m] in the frame of the geom, and faces (f, 3): MuJoCo recentres meshes, and poses with them."""
    mesh = int(model.geom_dataid[geom])
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]].astype(float)
    return vertices, model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]


def hull_of(vertices: Array) -> tuple[Array, Faces]:
    """Corners and faces of the convex hull of points (v, 3); SceneError if they have no volume."""
    import trimesh  # slow to import, and few scenes have meshes

    try:
        hull = trimesh.convex.convex_hull(vertices)
    except Exception as error:  # whatever Qhull says of points without volume
        reason = str(error).split("\n")[0]
        raise SceneError(f"has no hull ({reason}); give it volume") from None
    return np.array(hull.vertices, dtype=float), np.array(hull.faces, dtype=np.int64)


def concave_meshes(model: mujoco.MjModel, meshes: Mapping[int, Obstacle]) -> dict[int, str]:
    """Both volumes in words, by geom, where a mesh fills less than `CONVEX` of its hull, the obstacle."""
    found = {}
    for geom, hull in meshes.items():
        mine, whole = _enclosed(*mesh_of(model, geom)), _enclosed(hull.vertices, hull.faces)
        if mine < CONVEX * whole:
            found[geom] = f"{whole:.3g} m3, of which the mesh fills {mine:.3g}"
    return found


def use_hulls(spec: mujoco.MjSpec, model: mujoco.MjModel, hulls: Mapping[int, Obstacle], path: Path) -> mujoco.MjModel:
    """The model with hulls, by geom, in place of meshes; its geoms keep their numbers and places."""
    geoms = {geom.id: geom for geom in spec.geoms}
    for number, (geom, hull) in enumerate(hulls.items()):
        mesh, turn = int(model.geom_dataid[geom]), np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.mesh_quat[mesh])
        corners = np.asarray(hull.vertices) @ turn.reshape(3, 3).T + model.mesh_pos[mesh]
        name = f"hull {number} of {model.mesh(mesh).name}"
        spec.add_mesh(name=name, uservert=corners.ravel())
        geoms[geom].meshname = name
    return compile_spec(spec, path)


def _enclosed(vertices: Any, faces: Any) -> float:
    """The volume [m^3] that faces enclose, seen from their middle."""
    from trimesh.triangles import mass_properties

    return float(abs(mass_properties((vertices - vertices.mean(axis=0))[faces], skip_inertia=True).volume))
