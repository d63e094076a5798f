"""Closed-form ranges of horizontal rays to boxes and upright cylinders."""

from collections.abc import Iterable

import numpy as np

from pirrht import Kind, Obstacle
from pirrht.mapping.scan import Scan


def ranges_to(solids: Iterable[Obstacle], pose: np.ndarray, angles: np.ndarray, height: float) -> np.ndarray:
    """From outside of them, inf where a ray meets none."""
    along = angles + pose[2]
    rays = np.column_stack([np.cos(along), np.sin(along), np.zeros(len(along))])
    return np.min([_range(solid, np.append(pose[:2], height), rays) for solid in solids], axis=0)


def _range(solid: Obstacle, place: np.ndarray, rays: np.ndarray) -> np.ndarray:
    at, to = (place - solid.position) @ solid.rotation, rays @ solid.rotation
    with np.errstate(all="ignore"):
        if solid.kind is Kind.BOX:
            ends = (np.sort([-solid.size, solid.size], axis=0)[:, None] - at) / to
            first, last = np.nanmax(np.min(ends, axis=0), axis=1), np.nanmin(np.max(ends, axis=0), axis=1)
        else:
            assert solid.kind is Kind.CYLINDER
            flat = to[:, :2]
            middle, off = -flat @ at[:2], at[0] * flat[:, 1] - at[1] * flat[:, 0]
            half = np.sqrt(solid.size[0] ** 2 - off**2)
            first, last = middle - half, middle + half
            first[abs(at[2]) > solid.size[1]] = np.nan
    return np.where((first <= last) & (first >= 0.0), first, np.inf)


def scan_of(
    solids: Iterable[Obstacle], pose: np.ndarray, *, rays: int = 720, fov: float = 2 * np.pi, most: float = 30.0
) -> Scan:
    """A scan without noise at a height of 0.1 m."""
    angles = np.linspace(-0.5 * fov, 0.5 * fov, rays)
    ranges = ranges_to(solids, pose, angles, 0.1)
    return Scan(pose=pose, angles=angles, ranges=np.where(ranges > most, np.inf, ranges), most=most)
