"""Small scenes of tilted solids of every kind, for tests that compare with FCL."""

from functools import cache

import numpy as np
from discs import scene_of
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pirrht import FreeSpace, Kind, Obstacle

RADIUS = 0.12


def solid(kind: Kind, name: str, spot: np.ndarray, rng: np.random.Generator) -> Obstacle:
    size = np.exp(rng.uniform(np.log(0.08), np.log(0.6), 3))
    vertices = faces = None
    if kind is Kind.MESH:
        corners = rng.uniform(-1, 1, (12, 3)) * size
        hull = ConvexHull(corners)
        vertices, faces = corners[hull.vertices], np.searchsorted(hull.vertices, hull.simplices)
    return Obstacle(
        name=name, kind=kind, size=size, position=np.array([*spot, 0.1 + rng.uniform(-0.2, 0.2)]),
        rotation=Rotation.random(random_state=int(rng.integers(2**31))).as_matrix(), vertices=vertices, faces=faces,
    )  # fmt: skip


@cache
def cluttered(kind: Kind | None, seed: int = 0) -> FreeSpace:
    """Five tilted solids of one kind (or of all) at random, some of which touch each other or the border."""
    rng = np.random.default_rng(seed)
    kinds = list(Kind) if kind is None else [kind] * 5
    obstacles = [solid(k, f"{k.value}{i}", rng.uniform(0.8, 3.2, 2), rng) for i, k in enumerate(kinds)]
    ends = {"start": (-0.4, -0.2), "goal": (4.3, 3.9), "lower": (-0.6, -0.4), "side": (4.5, 4.1)}
    return FreeSpace.of(scene_of(obstacles, **ends, radius=RADIUS))
