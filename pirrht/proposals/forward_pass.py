"""Forward pass of the optimisation: noise-free steps of any system, their derivatives, and simulating a law by them.

A step has m modes of control in noise units, a = B_c^-1 G_c u (in input form s^-1 u), or 2 m where it sways: with
u + 2 sqrt(3) r (t/dt - 1/2) at t within a step, r leaves the end of the step and moves the mean over it, as the noise
of rollouts does (`rollouts.step`).
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.geometry.arcs import entry_of_piece
from pirrht.geometry.pieces import share_into_ball
from pirrht.geometry.space import pose_at
from pirrht.jit import vectors
from pirrht.jit.jit import borrowing, kernel
from pirrht.jit.vectors import copy_row, copy_rows
from pirrht.proposals.tuning import TUNING
from pirrht.proposals.walls import clearance_costs
from pirrht.rollouts.step import SWAY, KernelSpec, algebra, diffusion_of
from pirrht.systems.dynamics import no_homing, wrapped


class ForwardPass(NamedTuple):
    """Kernels of one kind of dynamics."""

    velocity: Any
    expand: Any
    expand_end: Any
    forward: Any


@cache
def entering(d: int) -> Any:
    """Build the kernel (setup, place, way) that tells whether a straight way from a place [m] enters the goal."""
    between, _ = algebra(d)

    @borrowing
    def in_plane(setup, place, way):  # type: ignore[no-untyped-def]
        (x, y), (dx, dy) = place, way
        length, (gx, gy), radius = math.sqrt(dx * dx + dy * dy), setup.world.goal, setup.world.radius
        near = math.sqrt((gx - x) ** 2 + (gy - y) ** 2) - radius < length
        return near and entry_of_piece(x, y, math.atan2(dy, dx), 0.0, length, gx, gy, radius) < np.inf

    @borrowing
    def in_space(setup, place, way):  # type: ignore[no-untyped-def]
        end = between(1.0, place, 1.0, way)
        return share_into_ball(place, end, setup.world.goal, setup.world.radius) < np.inf

    return in_plane if d == 2 else in_space


@cache
def forward_pass(kind: KernelSpec) -> ForwardPass:
    """Build the kernels of one kind of dynamics."""
    drift = kind.drift
    q = kind.q
    n, m, rows, _ = kind.sizes
    stratonovich = kind.stratonovich

    varying_rate = kind.varying_rate
    noisy_position = kind.noisy_position
    angles = kind.angles
    homing_of = kind.homing

    varying = kind.diffusion_block is not None
    noise_at: Any = diffusion_of(kind) if varying else drift

    fixed = n - rows
    through_inputs = kind.traits.input_form and varying
    all_vary = varying or stratonovich

    scratch_walls, clearance_cost, _ = clearance_costs(kind.space, len(kind.reads), kind.moving)
    pose, combined = pose_at(kind.reads), vectors.combined(len(kind.reads))
    position, d = kind.position, len(kind.position)
    place = pose_at(position)
    between, product = algebra(d)
    enters = entering(d)
    stranded = noisy_position and homing_of is no_homing
    along_line = kind.along_line

    @borrowing
    def velocity(setup, x, f):  # type: ignore[no-untyped-def]
        """Write the drift at x (n,) to f (n,) [state/s]; return q there [cost/s]."""
        f[:] = 0.0
        drift(x, setup.parameters, f)
        return q(x, setup.parameters) if varying_rate else setup.rate

    @borrowing
    def noise_input(setup, x, B):  # type: ignore[no-untyped-def]
        """Write B at x (n,) to B[0] of B (2, rows, m), whose rest is scratch."""
        if varying:
            noise_at(x, setup.parameters, setup.inverse, B[1], B[0])
        else:
            copy_rows(setup.diffusion, B[0])

    @borrowing
    def displacement(setup, x, a, dt, B, f, out):  # type: ignore[no-untyped-def]
        """Write the displacement by a step of dt [s] from x (n,) under modes a to out (n,); return q dt.

        B (2, rows, m) and f (n,) are scratch; B[0] keeps B of x, or where G is that of the middle, of the middle.
        """
        noise_input(setup, x, B)
        B, G = B[0], B[1]
        f[:] = 0.0
        copy_row(x, out)
        if setup.bridge and not noisy_position:
            for j in range(rows):
                for k in range(m):
                    out[fixed + j] += dt * B[j, k] * (0.5 * a[k] - (SWAY * a[m + k] if a.shape[0] > m else 0.0))
        drift(out, setup.parameters, f)
        if stratonovich:
            for j in range(n):
                out[j] = x[j] + 0.5 * dt * f[j]
            for j in range(rows):
                for k in range(m):
                    out[fixed + j] += 0.5 * dt * B[j, k] * a[k]
            if varying:
                noise_at(out, setup.parameters, setup.inverse, G, B)
            if noisy_position or not setup.bridge:
                drift(out, setup.parameters, f)
        for j in range(n):
            out[j] = dt * f[j]
        for j in range(rows):
            for k in range(m):
                out[fixed + j] += dt * B[j, k] * a[k]
        return dt * (q(x, setup.parameters) if varying_rate else setup.rate)

    @borrowing
    def ahead_of(setup, x, f, to_goal):  # type: ignore[no-untyped-def]
        """Write the direction in which noise moves the position at x (n,), towards a place, to f (n,)."""
        both = np.zeros((2, rows, m))
        noise_input(setup, x, both)
        B = both[0]
        size = 0.0
        for i in position:
            f[i] = 0.0
        for k in range(m):
            towards = 0.0
            for j in range(d):
                towards += to_goal[j] * B[position[j] - fixed, k]
            sign = 1.0 if towards >= 0.0 else -1.0
            for i in position:
                f[i] += sign * B[i - fixed, k]
        for i in position:
            size += f[i] * f[i]
        size = max(math.sqrt(size), 1e-12)
        for i in position:
            f[i] /= size

    @borrowing
    def arrival(setup, far, x, f):  # type: ignore[no-untyped-def]
        """Return the cost of the rest to the goal's rim from x (n,), straight ahead; `far` per meter where noise acts.

        It has no kink at the rim, which would be a wall to a guide whose last step ends on it.
        """
        to_goal = between(1.0, setup.world.goal, -1.0, place(x))

        if noisy_position and not along_line:
            return far * (math.sqrt(product(to_goal, to_goal)) - setup.world.radius)
        if along_line:
            rate, speed = far, 1.0
            ahead_of(setup, x, f, to_goal)
            ahead = place(f)
        else:
            rate = velocity(setup, x, f)
            ahead = place(f)
            speed = max(math.sqrt(product(ahead, ahead)), 1e-3)
        along = product(to_goal, ahead) / speed
        square = setup.world.radius**2
        rest = square
        for j in range(d):
            rest -= to_goal[j] * to_goal[j]
        return rate * (along - math.sqrt(max(rest + along * along, 1e-4 * square))) / speed

    @borrowing
    def probe(setup, at, i, shift, k, other, work, out):  # type: ignore[no-untyped-def]
        """Return weighted displacement and q dt with variables i and k of (x, a) shifted; of no time: 0, `arrival`."""
        (x, a, dt, costate, far), (z, c, B, f), total = at, work, 0.0
        copy_row(x, z)
        copy_row(a, c)
        if i < n:
            z[i] += shift
        else:
            c[i - n] += shift
        if k < n:
            z[k] += other
        else:
            c[k - n] += other
        if dt == 0.0:
            return 0.0, arrival(setup, far, z, f)
        rate = displacement(setup, z, c, dt, B, f, out)
        for j in range(n):
            total += costate[j] * out[j]
        return total, rate

    @kernel
    def differentiate(setup, at, which, nudge, curved, work, out):  # type: ignore[no-untyped-def]
        """Write first derivatives to J and second ones to F, of the weighted displacement, and R, of q dt."""
        J, F, R = out
        count = which.shape[0]
        up = np.empty(nudge.shape)
        down = np.empty(nudge.shape)

        up_rate = np.empty(nudge.shape)
        down_rate = np.empty(nudge.shape)
        ahead = np.zeros(n)
        behind = np.zeros(n)

        here, rate = probe(setup, at, 0, 0.0, 0, 0.0, work, ahead)
        for c in range(count):
            i = which[c]
            h = nudge[i]
            up[i], up_rate[i] = probe(setup, at, i, h, 0, 0.0, work, ahead)
            down[i], down_rate[i] = probe(setup, at, i, -h, 0, 0.0, work, behind)
            for j in range(n):
                J[j, i] = 0.5 * (ahead[j] - behind[j]) / h
            J[n, i] = 0.5 * (up_rate[i] - down_rate[i]) / h
            if not curved:
                continue
            F[i, i] = (up[i] - 2.0 * here + down[i]) / (h * h)
            R[i, i] = (up_rate[i] - 2.0 * rate + down_rate[i]) / (h * h)
            for e in range(c):
                k = which[e]
                total = 2.0 * here - up[i] - up[k] - down[i] - down[k]
                cost = 2.0 * rate
                cost -= up_rate[i] + up_rate[k] + down_rate[i] + down_rate[k]
                for sign in (1.0, -1.0):
                    more, other = probe(setup, at, i, sign * h, k, sign * nudge[k], work, ahead)
                    total = total + more
                    cost = cost + other
                F[i, k] = 0.5 * total / (h * nudge[k])
                R[i, k] = 0.5 * cost / (h * nudge[k])
                F[k, i] = F[i, k]
                R[k, i] = R[i, k]

    @kernel
    def chain(setup, dt, which, J, F, S):  # type: ignore[no-untyped-def]
        """Complete derivatives in the states where B is constant: modes move the state at which the drift is taken."""
        N = J.shape[1]
        B = setup.diffusion
        D = np.eye(n, N)
        for j in range(rows if setup.bridge and not noisy_position else 0):
            for k in range(N - n):
                D[fixed + j, n + k] = (0.5 if k < m else -SWAY) * dt * B[j, k % m]
        for j in range(n):
            for k in range(n, N):
                J[j, k] = dt * B[j - fixed, k - n] if j >= fixed and k - n < m else 0.0
                for i in which:
                    J[j, k] += J[j, i] * D[i, k]
        for i in which:
            for k in which:
                if F[i, k] != 0.0:
                    for r in range(N):
                        for s in range(N):
                            S[r, s] += D[i, r] * F[i, k] * D[k, s]

    @kernel
    def expand(setup, at, active, curved, J, S):  # type: ignore[no-untyped-def]
        """Differentiate a step in (x, a), N = n + modes: by differences in all of them, or where B is constant in x.

        A step is x (n,), a (modes,), dt [s], and weights (n,) of the next state's components. J (n+1, N) is filled with
        first derivatives of the next state and of q dt, S (N, N) with second ones of the weighted sum and q dt, if they
        are required; `active` are bits of the states that drift or q depend on.
        """
        x, a, dt, costate = at
        N, count = n + a.shape[0], 0
        which = np.empty(N, np.int64)
        work = (np.empty(n), np.empty(a.shape[0]), np.zeros((2, rows, m)), np.empty(n))
        F = np.zeros((N, N))
        nudge = np.full(N, TUNING.nudge)
        J[:, :], S[:, :] = 0.0, 0.0
        for i in range(N if all_vary else n):
            if all_vary or (active >> i) & 1:
                which[count] = i
                count += 1
        if all_vary:
            displacement(setup, x, a, dt, work[2], work[3], work[0])  # for B
            nudge[n:] = TUNING.nudge / (dt * np.abs(work[2][0]).max())
        differentiate(setup, (x, a, dt, costate, 0.0), which[:count], nudge, curved, work, (J, F, S))
        if not all_vary:
            chain(setup, dt, which[:count], J, F, S)
        for i in range(N if all_vary else 0):
            for k in range(N):
                S[i, k] += F[i, k]
        for j in range(n):
            J[j, j] += 1.0

    @kernel
    def expand_end(setup, far, x, v, W):  # type: ignore[no-untyped-def]
        """Expand `arrival` at x (n,), to v (n,) and W (n, n)."""
        work = (np.empty(n), np.empty(m), np.zeros((2, rows, m)), np.empty(n))
        at = (x, np.zeros(m), 0.0, x, far)
        J = np.zeros((n + 1, n))
        differentiate(setup, at, np.arange(n), np.full(n, TUNING.nudge), True, work, (J, np.zeros((n, n)), W))
        copy_row(J[n], v)

    @borrowing
    def _control(setup, task, law, i, x, B, u):  # type: ignore[no-untyped-def]
        """Write the modes of step i at x (n,) to u, by a law (course, length, step), or past its length by homing."""
        (course, length, step), modes = law, u.shape[0]
        if i >= length:
            for j in range(modes):  # a system with neither drift nor homing goes on as before
                u[j] = course.control[length - 1, j] if stranded and length > 0 else 0.0
            if through_inputs:
                noise_at(x, setup.parameters, setup.inverse, B[1], B[0])
            if not stranded:
                homing_of(x, setup.parameters, B[0], setup.world.goal, setup.world.radius, setup.least_rate, u[:m])
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

        Where aims are held to (`Task.hold`) it ends after `length` steps. States (T+1, n) and controls (T, modes) go to
        `tried`, whose first state is the start; `times` (T+1,) [s]; each step's clearance is priced at so many points.
        Returns: steps that end outside the goal (-1 if it is never entered), cost, cost with clearance priced [cost].
        """
        states, applied, aims = tried.states, tried.control, course.aims

        f = np.zeros(n)
        B = np.zeros((2, rows, m))
        x = np.empty(n)
        walls = scratch_walls(setup)

        cost, priced, held = 0.0, 0.0, task.hold > 0.0
        bends = not noisy_position and applied.shape[1] > m
        displacement(setup, states[0], applied[0], 0.0, B, f, x)  # for B
        for i in range(length if held else times.shape[0] - 1):
            dt = times[i + 1] - times[i]
            u = applied[i]
            ahead = False

            copy_row(states[i], x)
            if not noisy_position:
                velocity(setup, x, f)
                ahead = not held and enters(setup, place(x), between(dt, place(f), 0.0, place(f)))
            if not ahead:
                _control(setup, task, (course, length, step), i, x, B, u)
                begun = pose(f)
                running = displacement(setup, x, u, dt, B, f, states[i + 1])
                for k in range(n):
                    states[i + 1, k] += x[k]
                here = pose(x)
                change = combined(1.0, pose(states[i + 1]), -1.0, here)

                if bends:
                    velocity(setup, states[i + 1], f)
                ahead = not held and enters(setup, place(x), between(1.0, place(states[i + 1]), -1.0, place(x)))
            if ahead:
                rest = arrival(setup, task.far, x, f)
                applied[i] = 0.0
                return i, cost + rest, priced + rest
            for j in range(u.shape[0]):
                running += 0.5 * task.temperature * u[j] * u[j] * dt
            loss = combined(1.0, begun, -1.0, pose(f)) if bends else combined(0.0, here, 0.0, here)
            cost = cost + running
            priced = priced + running
            priced += clearance_cost(setup, task, (here, change, loss, times[i], dt), points, walls)
            if held:
                away = 0.0
                for j in range(d):
                    away += (states[i + 1, position[j]] - aims[i + 1, j]) ** 2
                priced += task.hold * away * dt
            if not priced < 1e12:  # diverged
                return -1, np.inf, np.inf
        return (length, cost, priced) if held else (-1, np.inf, np.inf)

    return ForwardPass(velocity, expand, expand_end, forward)
