"""Furniture as small meshes, made with trimesh and written into the scene itself.

MuJoCo collides the convex hull of a mesh, and the plan knows that hull: nobody drives under a table.
"""

from collections.abc import Sequence

import numpy as np
import trimesh

Box = tuple[float, float, float, float, float, float]  # least and greatest x, y, z [m]


def asset(name: str, mesh: trimesh.Trimesh) -> str:
    """A mesh as an MJCF element, vertices to the millimetre."""
    vertices = " ".join(f"{value:.4g}" for value in np.round(mesh.vertices, 3).ravel())
    faces = " ".join(str(index) for index in mesh.faces.ravel())
    return f'<mesh name="{name}" vertex="{vertices}" face="{faces}"/>'


def placed(name: str, mesh: str, x: float, y: float, turn: float, material: str) -> str:
    """A mesh on the floor, turned by an angle [degrees]."""
    half = np.radians(turn) / 2
    turned = f' quat="{np.cos(half):.8g} 0 0 {np.sin(half):.8g}"' if turn else ""
    return f'<geom name="{name}" type="mesh" mesh="{mesh}" pos="{x:.6g} {y:.6g} 0"{turned} material="{material}"/>'


def desk(width: float = 1.4, depth: float = 0.7, high: float = 0.74) -> trimesh.Trimesh:
    """A top on two cheeks, with a panel between them; its centre is the origin."""
    w, d = width / 2, depth / 2
    return boxes(
        [
            (-w, w, -d, d, high - 0.04, high),
            (-w, -w + 0.05, -d, d, 0.0, high - 0.04),
            (w - 0.05, w, -d, d, 0.0, high - 0.04),
            (-w + 0.05, w - 0.05, -0.02, 0.02, 0.2, high - 0.04),
        ]
    )


def shelf(width: float = 1.6, depth: float = 0.4, high: float = 1.0, boards: int = 4) -> trimesh.Trimesh:
    """Cheeks, a back and boards; its centre is the origin."""
    w, d = width / 2, depth / 2
    heights = np.linspace(0.05, high, boards)
    return boxes(
        [
            (-w, -w + 0.03, -d, d, 0.0, high),
            (w - 0.03, w, -d, d, 0.0, high),
            (-w + 0.03, w - 0.03, d - 0.02, d, 0.0, high),
            *((-w + 0.03, w - 0.03, -d, d - 0.02, z - 0.03, z) for z in heights),
        ]
    )


def round_table(radius: float = 0.55, high: float = 0.72, corners: int = 24) -> trimesh.Trimesh:
    """A round top on a pedestal with a foot as wide as the top."""
    outline = [
        (0.0, 0.0),
        (radius, 0.0),
        (radius, 0.04),
        (0.08, 0.10),
        (0.06, high - 0.06),
        (radius, high - 0.04),
        (radius, high),
        (0.0, high),
    ]
    return trimesh.creation.revolve(np.array(outline), sections=corners)


def boxes(parts: Sequence[Box]) -> trimesh.Trimesh:
    """Boxes as one mesh."""
    solids = []
    for part in parts:
        low, high = np.array(part[::2]), np.array(part[1::2])
        solid = trimesh.creation.box(extents=high - low)
        solid.apply_translation((low + high) / 2)
        solids.append(solid)
    return trimesh.util.concatenate(solids)
