"""A mesh as a world of its convex parts: MuJoCo collides with hulls, so a room of one mesh would be a block."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from sim.importing.meshes import Meshes, MeshKey
from sim.importing.sdf import World, part_solid

SUFFIXES = (".dae", ".obj", ".stl")
CONCAVITY = 0.05  # that a part may have, as a share of the size of the mesh: CoACD's own default


def read_mesh(source: Path) -> World:
    """Read a mesh, cut along its own faces, or by CoACD where that leaves parts that are not convex.

    Raises:
        SceneError: the file holds no mesh, or one that is too large.
        OptionError: CoACD is needed and not installed.
    """
    meshes = Meshes()
    parts = meshes.parts(MeshKey(source))
    corners = _by_coacd(source, meshes.triangles(source)) if parts.rough else parts.vertices
    flat = np.vstack(corners)[:, :2]
    ground = np.stack([flat.min(axis=0), flat.max(axis=0)], axis=1).ravel()
    solids = tuple(part_solid(f"part {number}", np.eye(4), one) for number, one in enumerate(corners, 1))
    return World(solids=solids, ground=ground)


def _by_coacd(source: Path, triangles: Array) -> Sequence[Array]:
    try:
        import coacd
    except ImportError:
        raise OptionError(
            f"{source}: convex parts of this mesh need CoACD; install it with `pip install 'pirrht[decompose]'`"
        ) from None
    import trimesh

    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    coacd.set_log_level("error")
    closed = "off" if mesh.is_watertight else "auto"  # what is open is closed first, on a coarse grid
    try:
        found = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=CONCAVITY, preprocess_mode=closed)
    except Exception as error:  # of a library in C++
        raise SceneError(f"{source}: CoACD finds no convex parts ({' '.join(str(error).split())})") from None
    return [np.asarray(corners, dtype=float) for corners, _ in found]
