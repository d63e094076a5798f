"""Voxel grids as solids: arrays of NumPy (.npy, .npz) and binary trees of OctoMap (.bt). Unknown voxels are free.

An array (nx, ny, nz) holds booleans, or chances of which those above one half are occupied. In an .npz file it is
called `occupied`, or is alone; `cell` is the side of a voxel and `origin` its least corner [m], if they are there.

A tree halves a cube of 2^16 cells about the origin into eight, over and over, x being the lowest bit of the number of
a part. Of each cube two bytes have two bits for each part, the least first: 1 is free, 2 is occupied, and a part of 3
has parts of its own, which follow, one after the other.
"""

import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.errors import OptionError, SceneError
from pirrht.geometry.rectangles import blocks
from pirrht.geometry.solids import occupancy
from sim.importing.solids import Solid, World
from sim.mjcf.library import FARTHEST, FINEST, LARGEST_FILE, content_of, refused

SUFFIXES = (".npy", ".npz", ".bt")
MOST_PARTS = 3000  # boxes of a grid: plans among so many take more than a minute
DEPTH = 16  # of a tree's voxels below its root
FREE, OCCUPIED, INNER = 1, 2, 3  # of a part of a cube


def read_voxels(path: Path, cell: float | None = None) -> World:
    """Read occupied voxels as few boxes; `cell` is the side of one [m], which only a file of NumPy may lack."""
    data = content_of(path, "a grid of voxels", "join voxels")
    tree = path.suffix.lower() == ".bt"
    if tree and cell is not None:
        raise OptionError(f"{path}: a tree states the side of its voxels; leave out --cell")
    occupied, side, origin = _tree(path, data) if tree else _array(path, data, cell)
    boxes = blocks(occupied)
    if not len(boxes):
        raise SceneError(f"{path}: none of its {occupied.size} voxels is occupied; give a map with obstacles")
    if len(boxes) > MOST_PARTS:
        raise SceneError(
            f"{path}: its voxels make {len(boxes)} boxes, and at most {MOST_PARTS} are taken; cut out a part, or join "
            "2 x 2 x 2 voxels to one that is occupied if one of them is"
        )
    solids = []
    for number, corners in enumerate((side * boxes).reshape(-1, 2, 3) + origin, start=1):
        pose = np.eye(4)
        pose[:3, 3] = corners.mean(axis=0)
        solids.append(Solid(f"block {number}", "box", 0.5 * np.ptp(corners, axis=0), pose))
    bounds = np.column_stack([origin, origin + side * np.array(occupied.shape)]).ravel()
    return World(kind="grid", solids=tuple(solids), ground=bounds)


def _array(path: Path, data: bytes, cell: float | None) -> tuple[BoolArray, float, Array]:
    """Read voxels, their side [m] and least corner (3,) [m] from a file of NumPy."""
    wrong = (ValueError, LookupError, OSError, EOFError, TypeError, OverflowError, zipfile.BadZipFile, MemoryError)
    with refused(f"{path}: this is no array of NumPy (", "); write it with np.save", *wrong, most=100):
        parts = zipfile.ZipFile(BytesIO(data)).infolist() if path.suffix.lower() == ".npz" else []
        if sum(one.file_size for one in parts) > LARGEST_FILE:
            raise ValueError(f"more than {LARGEST_FILE >> 20} MiB")
        held: Any = np.load(BytesIO(data), allow_pickle=False)
        held = {"occupied": held} if isinstance(held, np.ndarray) else dict(held)
        grid = held["occupied"] if "occupied" in held else next(one for one in held.values() if one.ndim == 3)
        side = float(held.get("cell", np.nan) if cell is None else cell)
        origin = np.array(held.get("origin", np.zeros(3)), dtype=float)
    if not (FINEST <= side <= FARTHEST):
        known = "not stated" if np.isnan(side) else f"{side:g}"
        raise SceneError(f"{path}: the side of its voxels is {known}; give it in metres, --cell M")
    if origin.shape != (3,) or not np.all(np.abs(origin) <= FARTHEST):
        raise SceneError(f"{path}: origin is {origin.tolist()}; write the least corner x, y, z [m]")
    with refused(f"{path}: ", "", SceneError):
        return occupancy(grid if grid.dtype == np.bool_ else grid > 0.5, ("nx", "ny", "nz")), side, origin


def _tree(path: Path, data: bytes) -> tuple[BoolArray, float, Array]:
    """Read what `_array` reads from a tree, within the bounds of what is known."""
    head, found, body = data.partition(b"\ndata\n")
    words = dict(line.split(None, 1) for line in head.decode(errors="replace").splitlines() if " " in line.strip())
    with refused(f"{path}: this is no binary tree of OctoMap; write it with writeBinary()", "", ValueError, most=0):
        side = float(words.get("res", "nan"))
        if not (found and words.get("id", "").strip() == "OcTree" and FINEST <= side <= FARTHEST):
            raise ValueError
        known = _leaves(body)
    if not len(known):
        raise SceneError(f"{path}: none of its voxels is known; give a map with obstacles")
    low = known[:, :3].min(axis=0)
    shape = (known[:, :3] + known[:, 3:4]).max(axis=0) - low
    with refused(f"{path}: ", "", SceneError):
        grid = occupancy(np.broadcast_to(np.False_, shape), ("nx", "ny", "nz")).copy()
    for x, y, z, width, kind in known - [*low, 0, 0]:
        grid[x : x + width, y : y + width, z : z + width] = kind == OCCUPIED
    return grid, side, side * (low - 2 ** (DEPTH - 1))


def _leaves(body: bytes) -> IntArray:
    """Return the known leaves of a tree (k, 5): least corner and width in cells, FREE or OCCUPIED."""
    leaves = []
    todo = [(0, 0, 0, 2**DEPTH)]
    for at in range(0, len(body), 2):
        if not todo:
            break
        x, y, z, width = todo.pop()
        bits = int.from_bytes(body[at : at + 2], "little")
        half = width // 2
        inner = []
        for part in range(8):
            corner = x + half * (part & 1), y + half * (part >> 1 & 1), z + half * (part >> 2)
            kind = bits >> 2 * part & 3
            if kind == INNER:
                inner.append((*corner, half))
            elif kind:
                leaves.append((*corner, half, kind))
        todo += reversed(inner)
    if (todo and body) or any(width == 0 for *_, width, _ in leaves):
        raise ValueError("it ends early, or goes too deep")
    return np.array(leaves, dtype=np.int64).reshape(-1, 5)
