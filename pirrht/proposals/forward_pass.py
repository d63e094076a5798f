"""Forward pass of the optimisation: simulating a law from the start, and its cost."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.geometry.arcs import entry_of_piece
from pirrht.jit.jit import borrowing, kernel
from pirrht.jit.vectors import copy_row
from pirrht.proposals.clearance_cost import clearance_costs
from pirrht.proposals.step_map import step_of
from pirrht.rollouts.general.kind import KernelSpec, diffusion_of
from pirrht.systems.dynamics import no_homing
from pirrht.systems.heading import wrapped


@cache
def passes_of(kind: KernelSpec) -> tuple[Any, Any]:
    """Build the kernels of one kind of dynamics: `arrival`, the cost of the rest to the goal's rim, and `forward`."""
    velocity, advance, _ = step_of(kind)
    n, m, noisy_position, angles, homing_of = kind.n, kind.m, kind.noisy_position, kind.angles, kind.homing
    rows, by_inputs = kind.rows, kind.input_form
    through_inputs = by_inputs and kind.diffusion_block is not None
    noise_at: Any = diffusion_of(kind) if through_inputs else kind.drift
    scratch_walls, clearance_cost, _ = clearance_costs(kind.moving)
    stranded = noisy_position and homing_of is no_homing

    @borrowing
    def arrival(setup, task, x, f):  # type: ignore[no-untyped-def]
        """Return the cost of the rest to the goal's rim from x (n,), straight ahead, or per meter where noise acts."""
        gx, gy = setup.arena.goal[0] - x[0], setup.arena.goal[1] - x[1]
        if noisy_position:
            gap = math.sqrt(gx * gx + gy * gy) - setup.arena.radius
            # A kink at the rim would be a wall to a guide whose last step ends on it.
            return task.far * (gap if by_inputs else max(gap, 0.0))
        rate = velocity(setup, x, f)
        speed = max(math.sqrt(f[0] * f[0] + f[1] * f[1]), 1e-3)
        along, square = (gx * f[0] + gy * f[1]) / speed, setup.arena.radius**2
        off = max(square - gx * gx - gy * gy + along * along, 1e-4 * square)
        return rate * (along - math.sqrt(off)) / speed

    @borrowing
    def _enters(setup, x, y, dx, dy):  # type: ignore[no-untyped-def]
        """Check whether a straight line of (dx, dy) [m] from (x, y) [m] enters the goal."""
        length, (gx, gy) = math.sqrt(dx * dx + dy * dy), setup.arena.goal
        radius = setup.arena.radius
        if math.sqrt((gx - x) ** 2 + (gy - y) ** 2) - radius >= length:
            return False
        return entry_of_piece(x, y, math.atan2(dy, dx), 0.0, length, gx, gy, radius) < np.inf

    @borrowing
    def _control(setup, task, course, length, i, step, x, B, u):  # type: ignore[no-untyped-def]
        """Write the modes of step i at x (n,) to u: the law's, or past its length those of homing."""
        modes = u.shape[0]
        if i >= length:
            for j in range(modes):  # a system with neither drift nor homing goes on as before
                u[j] = course.control[length - 1, j] if stranded and length > 0 else 0.0
            if through_inputs:
                noise_at(x, setup.parameters, setup.inverse, B[1], B[0])
            if not stranded:
                homing_of(x, setup.parameters, B[0], setup.arena.goal, setup.arena.radius, setup.least_rate, u[:m])
        else:
            for j in range(modes):
                u[j] = course.control[i, j] + step * course.change[i, j]
            for k in range(n):
                off = x[k] - course.states[i, k]
                if (angles >> k) & 1:
                    off = wrapped(off)
                for j in range(modes):
                    u[j] += course.gains[i, j, k] * off
        for j in range(modes):
            u[j] = max(-task.steep, min(task.steep, u[j]))

    @kernel
    def forward(setup, task, times, course, length, step, points, tried):  # type: ignore[no-untyped-def]
        """Simulate a = control + step * change + K (x - states) from the start, and `homing` past `length`.

        Where aims are held to (`Task.hold`) it ends after `length` steps.

        States (T+1, n) and controls (T, modes) go to `tried`, whose first state is the start; `times` (T+1,) [s];
        the clearance of each step is priced at so many points.
        Returns: steps that end outside the goal (-1 if it is never entered), cost, cost with clearance priced [cost].
        """
        states, applied, aims = tried.states, tried.control, course.aims
        f, B, x, bow, walls = np.zeros(n), np.zeros((2, rows, m)), np.empty(n), np.zeros(2), scratch_walls(setup)
        cost, priced, held = 0.0, 0.0, task.hold > 0.0
        bends = not noisy_position and applied.shape[1] > m
        advance(setup, states[0], applied[0], 0.0, B, f, x)  # for B
        for i in range(length if held else times.shape[0] - 1):
            dt, u, ahead = times[i + 1] - times[i], applied[i], False
            copy_row(states[i], x)
            if not noisy_position:
                velocity(setup, x, f)
                ahead = not held and _enters(setup, x[0], x[1], f[0] * dt, f[1] * dt)
            if not ahead:
                _control(setup, task, course, length, i, step, x, B, u)
                bow[0], bow[1] = f[0], f[1]
                running = advance(setup, x, u, dt, B, f, states[i + 1])
                dx, dy = states[i + 1, 0] - x[0], states[i + 1, 1] - x[1]
                if bends:
                    velocity(setup, states[i + 1], f)
                ahead = not held and _enters(setup, x[0], x[1], dx, dy)
            if ahead:
                rest = arrival(setup, task, x, f)
                applied[i] = 0.0
                return i, cost + rest, priced + rest
            for j in range(u.shape[0]):
                running += 0.5 * task.temperature * u[j] * u[j] * dt
            bx, by = (bow[0] - f[0], bow[1] - f[1]) if bends else (0.0, 0.0)
            cost, priced = cost + running, priced + running
            priced += clearance_cost(setup, task, (x[0], x[1], dx, dy, bx, by, times[i], dt), points, walls)
            if held:
                priced += (
                    task.hold
                    * ((states[i + 1, 0] - aims[i + 1, 0]) ** 2 + (states[i + 1, 1] - aims[i + 1, 1]) ** 2)
                    * dt
                )
            if not priced < 1e12:  # diverged
                return -1, np.inf, np.inf
        if held:
            return length, cost, priced
        return -1, np.inf, np.inf

    return arrival, forward
