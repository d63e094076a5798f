"""Meshes as convex parts: MuJoCo collides with hulls, so a room of one mesh would be a block."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from sim.importing.limits import FARTHEST, content_of
from sim.importing.target import text
from sim.mjcf.limits import MOST_ELEMENTS

SUFFIXES = (".obj", ".stl", ".ply", ".off")
CONCAVITY = 0.05  # that a part may have, as a share of the size of the mesh: CoACD's own default
Part = tuple[Array, NDArray[np.int64]]  # corners (k, 3) [m] and faces (l, 3)


def read_parts(source: Path) -> list[Part]:
    """The convex parts that CoACD finds in a mesh, the same every time.

    Raises:
        SceneError: the file holds no mesh, or one that is too large.
        OptionError: CoACD is not installed.
    """
    try:
        import coacd
    except ImportError:
        raise OptionError("convex parts need CoACD; install it with `pip install 'pirrht[decompose]'`") from None
    mesh = _mesh(source)
    coacd.set_log_level("error")
    closed = "off" if mesh.is_watertight else "auto"  # what is open is closed first, on a coarse grid
    try:
        found = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=CONCAVITY, preprocess_mode=closed)
    except Exception as error:  # of a library in C++
        raise SceneError(f"{source}: CoACD finds no convex parts ({' '.join(str(error).split())})") from None
    return [(np.asarray(corners, dtype=float), np.asarray(faces)) for corners, faces in found]


def assets(parts: Sequence[Part]) -> Iterator[str]:
    """MJCF elements of the meshes."""
    for number, (corners, _) in enumerate(parts, 1):
        yield f'<mesh name="part {number}" vertex="{text(*corners.ravel())}"/>'


def geoms(parts: Sequence[Part]) -> Iterator[str]:
    """MJCF elements of the geoms."""
    for number in range(1, len(parts) + 1):
        yield f'<geom name="part {number}" type="mesh" mesh="part {number}" material="crate"/>'


def ground(parts: Sequence[Part]) -> Array:
    """Left, right, low and high border of all parts (4,) [m]."""
    corners = np.vstack([part[0][:, :2] for part in parts])
    return np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1).ravel()


def _mesh(source: Path) -> Any:
    import trimesh  # slow to import

    content = content_of(source, f"a mesh, {', '.join(SUFFIXES)}")
    try:
        mesh = trimesh.load_mesh(BytesIO(content), file_type=source.suffix[1:].lower(), skip_materials=True)
        corners, faces = np.asarray(mesh.vertices, dtype=float), len(mesh.faces)
    except Exception as error:  # whatever a reader makes of bytes
        reason = " ".join(str(error).split())[:80]
        raise SceneError(f"{source}: this is no mesh ({reason}); give one of {', '.join(SUFFIXES)}") from None
    if not 4 <= faces <= MOST_ELEMENTS:
        raise SceneError(f"{source}: the mesh has {faces} faces; it must have 4 to {MOST_ELEMENTS}")
    if not np.all(np.abs(corners) <= FARTHEST):
        raise SceneError(f"{source}: a corner of the mesh is no finite place up to {FARTHEST:g} m; write metres")
    return mesh
