"""Scenes that a seed grows: a forest, a field of cylinders like those of BARN."""

import numpy as np
from scipy import ndimage

from sim.barn import smoothed
from worlds.page import Page, drum, seen


def forest(seed: int = 22, trees: int = 42) -> Page:
    """Trees wherever there is room, none nearer to another than 0.42 m."""
    rng, size = np.random.default_rng(seed), np.array([10.0, 7.0])
    start, goal = np.array([0.6, 3.5]), np.array([9.4, 3.5])
    found: list[tuple[float, float, float]] = []
    while len(found) < trees:
        (x, y), radius = rng.uniform((0.3, 0.3), size - 0.3), rng.uniform(0.09, 0.24)
        free = [np.hypot(x - a, y - b) - radius - other > 0.42 for a, b, other in found]
        if all(free) and np.hypot(*(start - (x, y))) > 0.8 and np.hypot(*(goal - (x, y))) > 0.9:
            found.append((round(float(x), 2), round(float(y), 2), round(float(radius), 3)))
    parts = []
    for i, (x, y, radius) in enumerate(found, 1):
        high = 0.5 + 2.0 * radius
        parts.append(drum(f"tree {i}", x, y, radius, high, "bark"))
        parts.append(
            seen(
                "ellipsoid",
                f"{x:g} {y:g} {high + radius:.4g}",
                f"{2 * radius:.4g} {2 * radius:.4g} {1.6 * radius:.4g}",
                "leaves",
            )
        )
    return Page(
        name="forest",
        about="Forty-two trees of a seed: many ways of nearly the same length, more than anyone would name.",
        why=f"Grown from seed {seed}; gaps between trunks are at least 0.42 m.",
        size=(10.0, 7.0),
        start=(0.6, 3.5),
        goal=(9.4, 3.5, 0.35),
        settings={"noise": 0.1, "vertices": 2000, "limit": 0.8},
        elements=parts,
    )


def barn(seed: int = 9, side: float = 0.15, fill: float = 0.15) -> Page:
    """A field of cells, drawn at random and smoothed once by its neighbours, every full one a cylinder."""
    rng, columns, rows = np.random.default_rng(seed), 40, 30
    full = smoothed(rng.random((rows, columns)) < fill, 1)
    full &= ~_too_narrow(full)
    centers = np.argwhere(full) * side + side / 2 + (0.0, 1.2)
    parts = [drum(f"post {i}", x, y, side / 2, 0.4) for i, (y, x) in enumerate(centers.tolist(), 1)]
    return Page(
        name="barn",
        about="A field of touching cylinders, as the BARN benchmark grows them: find the gaps that lead through.",
        why=f"Our own generator after the description of BARN (Perille et al. 2020), from seed {seed}.",
        size=(8.4, 4.5),
        start=(0.5, 2.25),
        goal=(7.9, 2.25, 0.35),
        settings={"noise": 0.08, "vertices": 2000, "limit": 0.8},
        elements=parts,
    )


def _too_narrow(full: np.ndarray) -> np.ndarray:
    """Single cells that stand alone; they would make gaps of a robot's width everywhere."""
    labels, count = ndimage.label(full, np.ones((3, 3), int))
    sizes = ndimage.sum_labels(full, labels, np.arange(count + 1))
    return (sizes < 2)[labels] & full
