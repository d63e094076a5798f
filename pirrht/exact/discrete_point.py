"""Solve the discrete-time problem in the plane: `psi(x) = exp(-q dt/lambda) E[psi(x + b dw)]`, exit where a step ends.

phi(x) = exp(-q dt/lambda) E[...] is smooth on both sides of a wall; psi jumps from phi to exp(-phi/lambda) at a wall
and to 1 at the goal's rim. Close to a jump the points of the sum weigh what their cubic interpolation polynomials
integrate to over the right part of their cells. Gaussian steps are taken until nothing changes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.exact.boundaries import step_of
from pirrht.exact.gaussian_step import smooth, taps_along
from pirrht.exact.grid import (
    TUNING,
    Domain,
    Frame,
    Progress,
    affordable,
    derivative,
    frame_at,
    ignore_progress,
    in_cells,
    in_goal,
    indices,
    largest_change,
    polynomial,
)
from pirrht.freespace import FreeSpace
from pirrht.jit.jit import kernel
from pirrht.problem import Problem

EVERY = 8  # steps from one comparison of log phi to the next


class Lattice(NamedTuple):
    """log phi on a grid that reaches beyond the border."""

    frame: Frame
    log_phi: Array  # (nx, ny) [nats]


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Return the requested spacing [m], or a share of a step's deviation in dt [s]; refuses too many points."""
    assert dt is not None
    deviation = float(problem.dynamics.B_c(np.zeros(2))[0, 0]) * math.sqrt(dt)
    default, reason = deviation / TUNING.discrete_points, f"noise carries a step {deviation:.2g} m"
    return affordable(space.scene, default if spacing is None else spacing, reason, ", a longer step dt")


def grid_of(
    problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress = ignore_progress
) -> Lattice:
    """Solve for log phi, (nx, ny) [nats], with steps of dt [s] and a spacing [m]; OptionError if it does not settle."""
    assert not callable(problem.q)
    assert dt is not None
    rate, wall = problem.q / problem.temperature, problem.phi / problem.temperature
    step, domain = step_of(dt, float(problem.dynamics.B_c(np.zeros(2))[0, 0]), rate, wall), Domain.of(space)
    margin = math.ceil(step.cutoff / spacing) + 1
    corner = domain.lower - margin * spacing
    size = np.ceil((domain.upper - corner) / spacing).astype(int) + 1 + margin
    into, at_goal = np.zeros(tuple(size)), np.zeros(tuple(size))
    clearance = np.maximum(domain.clearance(corner + spacing * indices(size)), -1.0).reshape(into.shape)
    frame = frame_at(corner, spacing, domain.goal)
    _integrate(clearance, frame, into, at_goal)
    known = at_goal + math.exp(-wall) * (1.0 - into - at_goal)
    taps = [taps_along(n, 0.0, spacing, -math.inf, math.inf, step) for n in size]
    now, before = np.full(into.shape, -np.inf), np.full(into.shape, -np.inf)
    for _ in range(TUNING.discrete_steps // EVERY):
        for _ in range(EVERY):
            out = np.empty_like(now)
            smooth(now, into, known, taps[0], taps[1], rate * dt, out)
            now = out
        if largest_change(now, before) < EVERY * TUNING.discrete_settled:
            return Lattice(frame, now)
        before = now
    raise OptionError(f"the solution has not settled after {TUNING.discrete_steps} rounds; choose a longer dt")


@kernel
def _integrate(clearance, frame, into, at_goal):  # type: ignore[no-untyped-def]
    """Integrate the cubic Lagrange polynomials of points over free space outside the goal, and over the goal.

    `clearance` (nx, ny) [m] is interpolated linearly within cells; results are `into` and `at_goal`, 2 x (nx, ny).
    """
    parts, h = TUNING.cell_parts, frame.spacing
    base, one = np.empty((parts, 4)), np.zeros(4)
    for a in range(parts):
        for k in range(4):
            base[a, k] = polynomial((a + 0.5) / parts, k - 1) / parts
            one[k] += base[a, k]
    whole = np.outer(one, one)
    for i in range(1, clearance.shape[0] - 2):
        for j in range(1, clearance.shape[1] - 2):
            corners = clearance[i : i + 2, j : j + 2]
            x, y = frame.x0 + (i + 0.5) * h - frame.goal_x, frame.y0 + (j + 0.5) * h - frame.goal_y
            rim = math.sqrt(x * x + y * y) - frame.radius
            if corners.max() <= 0.0:
                continue
            if corners.min() >= 0.0 and abs(rim) > h:
                target = into if rim > 0.0 else at_goal
                target[i - 1 : i + 3, j - 1 : j + 3] += whole
                continue
            for a in range(parts):
                for b in range(parts):
                    u, v = (a + 0.5) / parts, (b + 0.5) / parts
                    c = (corners[0, 0] * (1.0 - u) + corners[1, 0] * u) * (1.0 - v)
                    c += (corners[0, 1] * (1.0 - u) + corners[1, 1] * u) * v
                    r = math.sqrt((x + (u - 0.5) * h) ** 2 + (y + (v - 0.5) * h) ** 2)
                    free = min(max(0.5 + c * parts / h, 0.0), 1.0)
                    inside = min(max(0.5 + (frame.radius - r) * parts / h, 0.0), 1.0)
                    part = np.outer(base[a], base[b]) * free
                    into[i - 1 : i + 3, j - 1 : j + 3] += part * (1.0 - inside)
                    at_goal[i - 1 : i + 3, j - 1 : j + 3] += part * inside


@kernel
def evaluate(grid, x, slope):  # type: ignore[no-untyped-def]
    """log phi [nats] at x (2,), 0 in the goal; its gradient [1/m] goes to slope (2,)."""
    slope[0], slope[1] = 0.0, 0.0
    if in_goal(grid.frame, x):
        return 0.0
    nx, ny = grid.log_phi.shape
    fx, fy = in_cells(grid.frame, x)
    i, j = min(max(int(fx), 1), nx - 3), min(max(int(fy), 1), ny - 3)
    value, h = 0.0, grid.frame.spacing
    for k in range(-1, 3):
        px, dx = polynomial(fx - i, k), derivative(fx - i, k)
        for e in range(-1, 3):
            py, dy = polynomial(fy - j, e), derivative(fy - j, e)
            entry = grid.log_phi[i + k, j + e]
            value += px * py * entry
            slope[0] += dx * py * entry / h
            slope[1] += px * dy * entry / h
    if not math.isfinite(value):
        slope[0], slope[1] = 0.0, 0.0
        return -math.inf
    return value
