#!/usr/bin/env python
"""Make the meshes of the built-in robots, which are drawn only: models/robots/meshes/*.stl.

    python scripts/robot_meshes.py [FOLDER]

Lengths are in metres, x is ahead and z up; wheels stand at the origin and turn about y. Collision geometry, masses and
dynamics are in the robots' MJCF files alone.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

Floats = NDArray[np.float64]
FOLDER = Path(__file__).resolve().parents[1] / "models" / "robots" / "meshes"
ROUND = 32  # corners of what is round


def turned(profile: Sequence[tuple[float, float]], sections: int = ROUND) -> trimesh.Trimesh:
    """A profile of radii and heights, from axis to axis, turned about z."""
    return trimesh.creation.revolve(np.array(profile), sections=sections)


def loft(
    stations: Sequence[tuple[float, float, float, float]], power: float = 3.0, corners: int = 20
) -> trimesh.Trimesh:
    """A hull along x through stations of x, half width, bottom and top; a greater power makes it boxier."""
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    across = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** (2.0 / power)
    up = np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** (2.0 / power)
    rings = [
        np.column_stack([np.full(corners, x), w * across, 0.5 * (low + high) + 0.5 * (high - low) * up])
        for x, w, low, high in stations
    ]
    ends = [ring.mean(axis=0)[None] for ring in (rings[0], rings[-1])]
    points, count = np.vstack([*rings, *ends]), len(rings)
    k, step = np.arange(corners), np.roll(np.arange(corners), -1)
    faces = []
    for i in range(count - 1):
        a, b, c, d = i * corners + k, i * corners + step, (i + 1) * corners + step, (i + 1) * corners + k
        faces += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    last, tail, tip = (count - 1) * corners, count * corners, count * corners + 1
    faces += [np.column_stack([step, k, np.full(corners, tail)])]
    faces += [np.column_stack([last + k, last + step, np.full(corners, tip)])]
    mesh = trimesh.Trimesh(points, np.vstack(faces), process=False)
    mesh.fix_normals()
    return mesh


def about_y(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh with its axis z laid along y."""
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    return mesh


def around(part: Callable[[], trimesh.Trimesh], count: int) -> list[trimesh.Trimesh]:
    """Copies of a part, turned evenly about z."""
    copies = []
    for angle in np.linspace(0.0, 2.0 * np.pi, count, endpoint=False):
        copy = part()
        copy.apply_transform(trimesh.transformations.rotation_matrix(angle, (0, 0, 1)))
        copies.append(copy)
    return copies


def box(size: Sequence[float], place: Sequence[float]) -> trimesh.Trimesh:
    """A box of whole sizes at a place."""
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(place))


def tyre() -> trimesh.Trimesh:
    """Of radius 0.045 and width 0.028, with blocks on it by which one sees it turn."""
    r, h = 0.0435, 0.014
    profile = [(0.028, -h), (r - 0.004, -h), (r, -0.6 * h), (r, 0.6 * h), (r - 0.004, h), (0.028, h), (0.028, -h)]
    blocks = around(lambda: box((0.003, 0.006, 1.7 * h), (r, 0.0, 0.0)), 14)
    return about_y(trimesh.util.concatenate([turned(profile, 28), *blocks]))


def rim() -> trimesh.Trimesh:
    """Five spokes, a hub and a ring, for that tyre."""
    h = 0.0135
    ring = turned([(0.024, -h), (0.029, -h), (0.029, h), (0.024, h), (0.024, -h)], 28)
    hub = turned(
        [(0.0, -h - 0.002), (0.007, -h - 0.002), (0.009, -h), (0.009, h), (0.007, h + 0.002), (0.0, h + 0.002)], 12
    )
    spokes = around(lambda: box((0.02, 0.006, 1.6 * h), (0.0165, 0.0, 0.0)), 5)
    return about_y(trimesh.util.concatenate([ring, hub, *spokes]))


def puck() -> trimesh.Trimesh:
    """A low hull of radius 0.1 with a step for its bumper."""
    return turned(
        [
            *((0.0, 0.008), (0.082, 0.008), (0.094, 0.016), (0.094, 0.026), (0.1, 0.028), (0.1, 0.042)),
            *((0.094, 0.044), (0.094, 0.054), (0.088, 0.061), (0.076, 0.065), (0.06, 0.067), (0.0, 0.068)),
        ],
        40,
    )


def turret() -> trimesh.Trimesh:
    """A lidar on a plinth, for the puck."""
    plinth = [(0.0, 0.066), (0.05, 0.066), (0.048, 0.072), (0.03, 0.074), (0.028, 0.076)]
    head = [(0.028, 0.088), (0.03, 0.09), (0.03, 0.098), (0.026, 0.102), (0.0, 0.103)]
    return turned([*plinth, *head], 28)


def car() -> trimesh.Trimesh:
    """A streamlined hull 0.25 long and 0.12 wide over wheels of radius 0.045."""
    return loft(
        [
            *((-0.125, 0.030, 0.055, 0.085), (-0.120, 0.048, 0.042, 0.098), (-0.095, 0.056, 0.034, 0.106)),
            *((-0.04, 0.059, 0.030, 0.104), (0.02, 0.059, 0.030, 0.098), (0.07, 0.056, 0.032, 0.088)),
            *((0.105, 0.049, 0.036, 0.076), (0.120, 0.038, 0.042, 0.068), (0.126, 0.024, 0.048, 0.060)),
        ],
        power=3.4,
    )


def canopy() -> trimesh.Trimesh:
    """The glass of that car."""
    return loft(
        [
            *((-0.088, 0.018, 0.088, 0.106), (-0.075, 0.036, 0.088, 0.126), (-0.045, 0.043, 0.088, 0.142)),
            *((-0.01, 0.043, 0.088, 0.143), (0.025, 0.040, 0.085, 0.130), (0.055, 0.032, 0.080, 0.104)),
            (0.07, 0.018, 0.078, 0.088),
        ],
        power=2.6,
    )


def shell() -> trimesh.Trimesh:
    """A rounded hull 0.24 long and 0.124 wide between two wheels."""
    return loft(
        [
            *((-0.12, 0.018, 0.045, 0.070), (-0.112, 0.042, 0.036, 0.086), (-0.085, 0.058, 0.030, 0.098)),
            *((-0.04, 0.062, 0.028, 0.104), (0.03, 0.062, 0.028, 0.102), (0.08, 0.057, 0.030, 0.092)),
            *((0.11, 0.040, 0.036, 0.078), (0.12, 0.018, 0.044, 0.066)),
        ],
        power=3.0,
    )


MESHES: dict[str, Callable[[], trimesh.Trimesh]] = {
    made.__name__: made for made in (tyre, rim, puck, turret, car, canopy, shell)
}


def main(folder: Path = FOLDER) -> None:
    """Write all meshes into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in MESHES.items():
        make().export(folder / f"{name}.stl")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
