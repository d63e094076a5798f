"""Closed forms that the grid of a point must reproduce, and how fast it does with finer spacing.

Around a goal of radius r0 in a round room of radius r1 whose wall costs phi, psi(r) = a I0(kr) + c K0(kr) with
psi(r0) = 1 and psi(r1) = exp(-phi/lambda). The room is handed over as a clearance, since no solid is hollow.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import ive, kve

from pirrht.arrays import Array
from pirrht.exact import point
from pirrht.exact.grid import Domain
from pirrht.geometry.scene import Goal

INNER, OUTER = 0.3, 1.0  # r0 and r1 [m]
CENTER = np.array([0.03, -0.02])  # of both, off the grid points [m]


def annulus(r: Array, wavenumber: float, wall: float = np.inf) -> tuple[Array, Array]:
    """log psi and its radial derivative [1/m] at radii (k,) between r0 and r1, for k [1/m] and wall = phi/lambda."""
    k = wavenumber
    grow = np.exp(k * (r - OUTER)) / ive(0, k * OUTER)
    decay = np.exp(-k * (r - INNER)) / kve(0, k * INNER)
    first_to_inner = ive(0, k * INNER) / ive(0, k * OUTER) * np.exp(k * (INNER - OUTER))
    second_to_outer = kve(0, k * OUTER) / kve(0, k * INNER) * np.exp(-k * (OUTER - INNER))
    a, c = np.linalg.solve([[first_to_inner, 1.0], [1.0, second_to_outer]], [1.0, np.exp(-wall)])
    psi = a * ive(0, k * r) * grow + c * kve(0, k * r) * decay
    slope = k * (a * ive(1, k * r) * grow - c * kve(1, k * r) * decay)
    return np.log(psi), slope / psi


def convergence(noise: float, spacings: Sequence[float], *, points: int = 1000, seed: int = 0) -> list[dict[str, Any]]:
    """Errors of the continuous-time grid in the round room with R = 2 I and q = 1, one row per spacing [m].

    A row has the spacing, the same in units of 1/k, the greatest relative errors of v and of u, |u - u*| over the
    greater of |u*| and 1/2, at random points a centimeter or more away from wall and rim, and the order in which the
    latter falls.
    """
    k = 1.0 / noise**2
    rng = np.random.default_rng(seed)
    r = np.sqrt(rng.uniform((INNER + 0.01) ** 2, (OUTER - 0.01) ** 2, points))
    angle = rng.uniform(-np.pi, np.pi, points)
    radial = np.column_stack([np.cos(angle), np.sin(angle)])
    log_psi, slope = annulus(r, k)
    exact = noise**2 * slope[:, None] * radial
    margin = OUTER + 0.05
    room = Domain(
        lower=CENTER - margin, upper=CENTER + margin, goal=Goal(center=CENTER, radius=INNER),
        clearance=lambda p: OUTER - np.hypot(*(p - CENTER).T),
    )  # fmt: skip
    rows: list[dict[str, Any]] = []
    for h in spacings:
        grid = point.solve(room, wavenumber=k, wall=np.inf, spacing=h)
        found, gradient = np.empty(points), np.empty((points, 2))
        for i, x in enumerate(CENTER + r[:, None] * radial):
            found[i] = point.evaluate(grid, x, gradient[i])
        off = np.hypot(*(noise**2 * gradient - exact).T) / np.maximum(np.hypot(*exact.T), 0.5)
        row = {
            "noise": noise,
            "spacing": h,
            "kh": k * h,
            "value_error": float(np.max(np.abs(found / log_psi - 1.0))),
            "control_error": float(np.max(off)),
            "order": None,
        }
        if rows:
            ratio = rows[-1]["control_error"] / row["control_error"]
            row["order"] = float(np.log(ratio) / np.log(rows[-1]["spacing"] / h))
        rows.append(row)
    return rows
