"""Compiled local optimisation of any system's trajectory, and the linear feedback that holds noisy paths near it.

Differential dynamic programming (Mayne, Int. J. Control 1966) on the steps that rollouts take. In noise units
a = B_c^-1 G_c u (in input form s^-1 u) the control costs lambda a'a / 2, whatever G, B and R are; beside q there is the
price on clearances that noise would use up (`ddp`). The quadratic model of the cost-to-go yields
a = a_ref + K (x - x_ref) and what covariance it leaves to the noise of a step: lambda dt Q_aa^-1 of the passive one.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.geometry.arcs import entry_of_piece
from pirrht.guidance.ddp import HALVINGS, LEAST_CURVATURE, class_of
from pirrht.guidance.priced import expand_price, price_of
from pirrht.guidance.priced_among import expand_among, expand_point, point_price, price_among, touches
from pirrht.guidance.spectra import diagonalise, recompose
from pirrht.guidance.step_map import NUDGE, step_of
from pirrht.rollouts.first_exit import COLLISION, sweep_exit, turn_of
from pirrht.rollouts.general.kind import Kind, diffusion_of, is_gated
from pirrht.rollouts.homing import wrapped
from pirrht.rollouts.listed import held_of
from pirrht.systems.dynamics import no_homing
from pirrht.topology.marks import key_of_path


class Task(NamedTuple):
    """The numbers of a problem that guides are optimised for."""

    temperature: float  # lambda [cost]
    margin: float  # clearance below which a point costs something [m]
    least: float  # clearance below which the barrier goes on as a parabola [m]
    price: float  # cost rate of the barrier at a clearance of 1 m [cost/s]
    spacing: float  # at most, of the points of a step whose clearance is priced [m]
    tolerance: float  # an expected gain below this ends the iterations [cost]
    steep: float  # |a| stays below this [1/sqrt(s)]
    far: float  # cost per meter that is left to the goal where noise acts on the position [cost/m]
    active: int  # bit k tells whether drift or q depends on the k-th state
    curved: bool  # whether steps have second derivatives
    hold: float = 0.0  # cost rate of being 1 m off the course's aims, over a fixed time [cost/s]; 0: to the goal


class Course(NamedTuple):
    """A trajectory of T steps and the feedback around it, in noise units; kernels write into it."""

    states: Array  # (T+1, n); its first row is the start
    control: Array  # (T, modes) a [1/sqrt(s)]
    gains: Array  # (T, modes, n) K of a = control + K (x - states)
    share: Array  # (T, modes, modes) L, symmetric; the noise of a step has the covariance L L' dt
    inverse: Array  # (T, modes, modes) of L
    volume: Array  # (T,) log det L
    change: Array  # (T, modes) the best change of each control
    aims: Array  # (T+1, 2) where to be at which time, if that is held to [m]


def empty_course(T: int, n: int, modes: int) -> Course:
    """A course of T steps from zeros, states (T+1, n); its noise is the passive one."""
    unit = np.tile(np.eye(modes), (T, 1, 1))
    return Course(
        states=np.zeros((T + 1, n)), control=np.zeros((T, modes)), gains=np.zeros((T, modes, n)), share=unit,
        inverse=unit.copy(), volume=np.zeros(T), change=np.zeros((T, modes)),
        aims=np.zeros((T + 1, 2)),
    )  # fmt: skip


COURSE: Any = Course


class Optimiser(NamedTuple):
    """Compiled passes of one kind of dynamics."""

    forward: Any
    backward: Any
    optimise: Any
    arrival: Any
    expand: Any


@cache
def optimiser(kind: Kind) -> Optimiser:
    """Kernels that optimise trajectories of one kind of dynamics; built once per kind."""
    velocity, advance, expand = step_of(kind)
    n, m, noisy_position, angles, homing_of = kind.n, kind.m, kind.noisy_position, kind.angles, kind.homing
    rows, by_inputs = kind.rows, kind.input_form
    through_inputs = by_inputs and kind.diffusion_block is not None
    noise_at: Any = diffusion_of(kind) if through_inputs else kind.drift

    moving = kind.moving
    point = is_gated(kind)
    stranded = noisy_position and homing_of is no_homing

    @kernel
    def arrival(setup, task, x, f):  # type: ignore[no-untyped-def]
        """Cost of what is left to the goal's rim from x (n,): straight ahead, or where noise acts, per meter [cost]."""
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

    @kernel
    def _enters(setup, x, y, dx, dy):  # type: ignore[no-untyped-def]
        """Whether a straight way of (dx, dy) [m] from (x, y) [m] enters the goal."""
        length, (gx, gy) = math.sqrt(dx * dx + dy * dy), setup.arena.goal
        radius = setup.arena.radius
        if math.sqrt((gx - x) ** 2 + (gy - y) ** 2) - radius >= length:
            return False
        return entry_of_piece(x, y, math.atan2(dy, dx), 0.0, length, gx, gy, radius) < np.inf

    @kernel
    def _control(setup, task, course, length, i, step, x, B, u):  # type: ignore[no-untyped-def]
        """Write the modes of step i at x (n,) to u: the law's, or past its length what homes in on the goal."""
        modes = u.shape[0]
        if i >= length:
            for j in range(modes):  # what neither drifts nor knows its way home goes on as before
                u[j] = course.control[length - 1, j] if stranded and length > 0 else 0.0
            if through_inputs:
                noise_at(x, setup.parameters, setup.inverse, B[1], B[0])
            if not stranded:
                homing_of(x, setup.parameters, B[0], setup.arena.goal, setup.arena.radius, setup.pace, u[:m])
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
        """Drive from the start under a = control + step * change + K (x - states), and past `length` as `homing` does.

        Where aims are held to (`Task.hold`) it ends after `length` steps, wherever that is.

        States (T+1, n) and controls (T, modes) go to `tried`, whose first state is the start; `times` (T+1,) [s];
        the clearance of each step is priced at so many points.
        Returns: steps that end outside the goal (-1 if it is never entered), cost, cost with clearance priced [cost].
        """
        states, applied = tried.states, tried.control
        f, B, x, bow = np.zeros(n), np.zeros((2, rows, m)), np.empty(n), np.zeros(2)
        cost, priced, held = 0.0, 0.0, task.hold > 0.0
        bends = not noisy_position and applied.shape[1] > m
        advance(setup, states[0], applied[0], 0.0, B, f, x)  # for B
        for i in range(times.shape[0] - 1):
            if held and i >= length:
                return i, cost, priced
            dt = times[i + 1] - times[i]
            for j in range(n):
                x[j] = states[i, j]
            ahead = False
            if not noisy_position:
                velocity(setup, x, f)
            if not noisy_position and not held:
                ahead = _enters(setup, x[0], x[1], f[0] * dt, f[1] * dt)
            if not ahead:
                u = applied[i]
                _control(setup, task, course, length, i, step, x, B, u)
                if bends:
                    bow[0], bow[1] = f[0], f[1]
                running = advance(setup, x, u, dt, B, f, states[i + 1])
                dx, dy = states[i + 1, 0] - x[0], states[i + 1, 1] - x[1]
                if bends:
                    velocity(setup, states[i + 1], f)
                    bow[0], bow[1] = bow[0] - f[0], bow[1] - f[1]
                ahead = not held and _enters(setup, x[0], x[1], dx, dy)
            if ahead:
                rest = arrival(setup, task, x, f)
                applied[i] = 0.0
                return i, cost + rest, priced + rest
            for j in range(u.shape[0]):
                running += 0.5 * task.temperature * u[j] * u[j] * dt
            cost, priced = cost + running, priced + running
            if point:
                priced += point_price(setup.arena.field, task, x[0], x[1], dx, dy, dt, points)
            else:
                priced += price_of(setup.arena.field, task, x[0], x[1], dx, dy, bow[0], bow[1], dt, points)
            if moving:
                now, bow_x, bow_y = times[i], bow[0], bow[1]
                priced += price_among(setup.traffic, task, x[0], x[1], dx, dy, bow_x, bow_y, now, dt, points, point)
            if held:
                off_x, off_y = states[i + 1, 0] - course.aims[i + 1, 0], states[i + 1, 1] - course.aims[i + 1, 1]
                priced += task.hold * (off_x * off_x + off_y * off_y) * dt
            if not priced < 1e12:
                return -1, np.inf, np.inf
        if held:
            return times.shape[0] - 1, cost, priced
        return -1, np.inf, np.inf

    @kernel
    def _end(setup, task, x, v, W):  # type: ignore[no-untyped-def]
        """Gradient v (n,) and Hessian W (n, n) of `arrival` at x (n,), by central differences if it has no kink."""
        if noisy_position and not by_inputs:
            ax, ay = x[0] - setup.arena.goal[0], x[1] - setup.arena.goal[1]
            away = math.sqrt(ax * ax + ay * ay)
            v[:], W[:, :] = 0.0, 0.0
            if away > setup.arena.radius:
                v[0], v[1], bent = task.far * ax / away, task.far * ay / away, task.far / (away * away * away)
                W[0, 0], W[1, 1], W[0, 1] = bent * ay * ay, bent * ax * ax, -bent * ax * ay
                W[1, 0] = W[0, 1]
            return
        z, f, up, down = x.copy(), np.zeros(n), np.empty(n), np.empty(n)
        here, h = arrival(setup, task, x, f), NUDGE
        for i in range(n):
            z[i] = x[i] + h
            up[i] = arrival(setup, task, z, f)
            z[i] = x[i] - h
            down[i] = arrival(setup, task, z, f)
            z[i] = x[i]
            v[i], W[i, i] = 0.5 * (up[i] - down[i]) / h, (up[i] - 2.0 * here + down[i]) / (h * h)
            for k in range(i):
                z[i], z[k] = x[i] + h, x[k] + h
                total = 2.0 * here - up[i] - up[k] - down[i] - down[k] + arrival(setup, task, z, f)
                z[i], z[k] = x[i] - h, x[k] - h
                total += arrival(setup, task, z, f)
                z[i], z[k] = x[i], x[k]
                W[i, k] = 0.5 * total / (h * h)
                W[k, i] = W[i, k]

    @kernel
    def _follow(setup, x, z, bends, chain):  # type: ignore[no-untyped-def]
        """Write how positions and loss of velocity of a step follow from its states x, z (n,) to `chain` (6, 2 n)."""
        for k in range(2):
            chain[k, k] = chain[2 + k, n + k] = 1.0
        if not bends:
            return
        up, down = np.zeros(n), np.zeros(n)
        for end in range(2):
            at, sign = x.copy() if end == 0 else z.copy(), 1.0 - 2.0 * end
            for i in range(n):
                here = at[i]
                at[i] = here + NUDGE
                velocity(setup, at, up)
                at[i] = here - NUDGE
                velocity(setup, at, down)
                at[i] = here
                for k in range(2):
                    chain[4 + k, end * n + i] = 0.5 * sign * (up[k] - down[k]) / NUDGE

    @kernel
    def backward(setup, task, times, course, length, points, damping):  # type: ignore[no-untyped-def]
        """Backward pass: the best change of each control and its feedback; returns the gain expected [cost].

        Written are the first `length` rows of change, gains, share, inverse and volume; `times` (T+1,) are ends of
        steps [s], `damping` is what is added to the controls' curvature, as a share of lambda dt.
        """
        states, control, gains, share, inverse, volume, change, aims = course
        modes = control.shape[1]
        N = n + modes
        v, W, costate, P = np.zeros(n), np.zeros((n, n)), np.zeros(n), np.zeros((n, n))
        J, S, Q, g = np.zeros((n + 1, N)), np.zeros((N, N)), np.zeros((N, N)), np.zeros(N)
        lead, stiff, bows = np.zeros((n, N)), np.zeros((modes, modes)), np.zeros(modes)
        vectors, inverted = stiff.copy(), stiff.copy()
        slope, bend, chain, bent = np.zeros(6), np.zeros((6, 6)), np.zeros((6, 2 * n)), np.zeros((6, 2 * n))
        f, other, cross, bends = np.zeros(n), np.zeros(n), np.zeros((n, n)), not noisy_position and modes > m
        if task.hold == 0.0:
            _end(setup, task, states[length], v, W)
        expected = 0.0
        for i in range(length - 1, -1, -1):
            dt = times[i + 1] - times[i]
            x, y = states[i, 0], states[i, 1]
            dx, dy = states[i + 1, 0] - x, states[i + 1, 1] - y
            bx, by = 0.0, 0.0
            if bends:
                velocity(setup, states[i], f)
                velocity(setup, states[i + 1], other)
                bx, by = f[0] - other[0], f[1] - other[1]
            # The price on clearance is a function of the states before and after the step.
            if point:
                near = expand_point(setup.arena.field, task, x, y, dx, dy, dt, points, slope, bend)
            else:
                near = expand_price(setup.arena.field, task, x, y, dx, dy, bx, by, dt, points, slope, bend)
            if moving:
                near = expand_among(
                    setup.traffic, task, x, y, dx, dy, bx, by, times[i], dt, points, point, near, slope, bend
                )
            if near:
                _follow(setup, states[i], states[i + 1], bends, chain)
            for j in range(n):
                costate[j] = v[j]
                for k in range(n):
                    P[j, k] = W[j, k]
            if task.hold > 0.0:
                for j in range(2):
                    costate[j] += 2.0 * task.hold * dt * (states[i + 1, j] - aims[i + 1, j])
                    P[j, j] += 2.0 * task.hold * dt
            if near:
                for j in range(2 * n):
                    for e in range(6):
                        total = 0.0
                        for k in range(6):
                            total += bend[e, k] * chain[k, j]
                        bent[e, j] = total
                for j in range(n):
                    for e in range(6):
                        costate[j] += slope[e] * chain[e, n + j]
                    for k in range(n):
                        for e in range(6):
                            P[j, k] += chain[e, n + j] * bent[e, n + k]
            expand(setup, states[i], control[i], dt, costate, task.active, task.curved, J, S)
            for j in range(n):
                for k in range(N):
                    total = 0.0
                    for e in range(n):
                        total += P[j, e] * J[e, k]
                    lead[j, k] = total
            for j in range(N):
                g[j] = J[n, j]
                for e in range(n):
                    g[j] += costate[e] * J[e, j]
                for k in range(j + 1):
                    total = S[j, k]
                    for e in range(n):
                        total += J[e, j] * lead[e, k]
                    Q[j, k] = total
            if near:  # what the state before has to do with that after
                for j in range(n):
                    for k in range(n):
                        cross[j, k] = 0.0
                        for e in range(6):
                            cross[j, k] += chain[e, j] * bent[e, n + k]
                for j in range(n):
                    for e in range(6):
                        g[j] += slope[e] * chain[e, j]
                    for k in range(j + 1):
                        for e in range(6):
                            Q[j, k] += chain[e, j] * bent[e, k]
                    for k in range(N):
                        total = 0.0
                        for e in range(n):
                            total += cross[j, e] * J[e, k]
                        Q[max(j, k), min(j, k)] += total if k != j else 2.0 * total
            passive = task.temperature * dt
            for j in range(modes):
                g[n + j] += passive * control[i, j]
                Q[n + j, n + j] += passive
            for j in range(N):
                for k in range(j):
                    Q[k, j] = Q[j, k]
            for j in range(modes):
                for k in range(modes):
                    stiff[j, k] = Q[n + j, n + k]
            diagonalise(stiff, vectors)
            volume[i] = 0.0
            for j in range(modes):
                bow = max(stiff[j, j] + damping * passive, LEAST_CURVATURE * passive)
                left = min(1.0, passive / bow)
                volume[i] += 0.5 * math.log(left)
                bows[j], stiff[j, j] = bow, math.sqrt(left)
            recompose(stiff, vectors, share[i])
            for j in range(modes):
                stiff[j, j] = 1.0 / stiff[j, j]
            recompose(stiff, vectors, inverse[i])
            for j in range(modes):
                stiff[j, j] = 1.0 / bows[j]
            recompose(stiff, vectors, inverted)
            for j in range(modes):
                change[i, j] = 0.0
                for e in range(modes):
                    change[i, j] -= inverted[j, e] * g[n + e]
                for k in range(n):
                    total = 0.0
                    for e in range(modes):
                        total -= inverted[j, e] * Q[n + e, k]
                    gains[i, j, k] = total
                expected -= 0.5 * g[n + j] * change[i, j]
            # With the curvature above, the best response leaves the Schur complement.
            for j in range(n):
                v[j] = g[j]
                for e in range(modes):
                    v[j] += Q[n + e, j] * change[i, e]
                for k in range(n):
                    total = Q[j, k]
                    for e in range(modes):
                        total += Q[n + e, j] * gains[i, e, k]
                    W[j, k] = total
            for j in range(n):
                for k in range(j):
                    W[j, k] = 0.5 * (W[j, k] + W[k, j])
                    W[k, j] = W[j, k]
        return expected

    @kernel
    def _is_free(setup, states, length, times, bows):  # type: ignore[no-untyped-def]
        """Whether the first `length` steps of states (T+1, n), straight or bows, touch nothing; `times` (T+1,) [s]."""
        f, turn = np.zeros((2, n)), 0.0
        if moving:
            held, listed = held_of(setup.traffic.J), np.empty(setup.traffic.J, np.int64)
        for i in range(length):
            x, y, dx, dy = states[i, 0], states[i, 1], states[i + 1, 0] - states[i, 0], states[i + 1, 1] - states[i, 1]
            if bows:
                velocity(setup, states[i], f[0])
                velocity(setup, states[i + 1], f[1])
                turn = turn_of(f[0, 0], f[0, 1], f[1, 0], f[1, 1], dx, dy, times[i + 1] - times[i])
            outcome, _ = sweep_exit(setup.arena, x, y, states[i + 1, 0], states[i + 1, 1], turn)
            if outcome == COLLISION:
                return False
            if moving:
                dt = times[i + 1] - times[i]
                if touches(setup.traffic, x, y, states[i + 1, 0], states[i + 1, 1], turn, times[i], dt, held, listed):
                    return False
        return True

    @kernel
    def key_of(setup, states, length):  # type: ignore[no-untyped-def]
        """Additive class key of the first `length` steps of states (T+1, n)."""
        key = class_of(setup, states, length)
        if moving:
            key += key_of_path(setup.marks, setup.arena.goal, states, length)
        return key

    @kernel
    def optimise(setup, task, times, key, rounds, course, length):  # type: ignore[no-untyped-def]
        """Improve a trajectory of class `key` in place; once it is of its class, or touches nothing too, it stays so.

        Args:
            times: (T+1,) ends of the steps [s]; where bodies move, on their clock.
            key: additive class key that the result must have; asked unless aims are held to.
            rounds: at most so many backward passes.
            course: the trajectory followed, its gains used until the first backward pass; overwritten.
            length: steps that it prescribes.

        Returns: steps that end outside the goal (-1: it does not get there), cost, cost with clearance priced [cost],
            backward passes, whether it is of its class and touches nothing.
        """
        states, control = course.states, course.control
        other, tried = np.zeros(states.shape), np.zeros(control.shape)
        trial = COURSE(
            other, tried, course.gains, course.share, course.inverse, course.volume, course.change, course.aims
        )
        other[0] = states[0]
        steps, _, _ = forward(setup, task, times, course, length, 0.0, 1, trial)
        if steps < 0:
            return -1, np.inf, np.inf, 0, False
        fastest = 0.0
        for i in range(steps):
            way = math.sqrt((other[i + 1, 0] - other[i, 0]) ** 2 + (other[i + 1, 1] - other[i, 1]) ** 2)
            fastest = max(fastest, way + (setup.traffic.speed * (times[i + 1] - times[i]) if moving else 0.0))
        points = max(1, min(8, math.ceil(1.2 * fastest / task.spacing)))
        steps, cost, priced = forward(setup, task, times, course, length, 0.0, points, trial)
        control[:], states[:] = tried, other
        held = task.hold > 0.0
        bows = not noisy_position and control.shape[1] > m
        right = held or key_of(setup, states, steps) == key
        sound = right and (held or _is_free(setup, states, steps, times, bows))
        damping, done, again = 0.0, 0, False
        for _ in range(rounds):
            done += 1
            expected = backward(setup, task, times, course, steps, points, damping)
            if expected < task.tolerance:
                break
            better, step = False, 1.0
            for _ in range(HALVINGS):
                k, c, p = forward(setup, task, times, course, steps, step, points, trial)
                if k >= 0 and p < priced - 0.1 * step * expected:
                    same = held or key_of(setup, other, k) == key
                    clear = same and (held or _is_free(setup, other, k, times, bows))
                    if clear or (not sound and (same or not right)):
                        better, right, sound, steps, cost, priced = True, same, clear, k, c, p
                        break
                step *= 0.5
            if better:
                control[:], states[:] = tried, other
                damping = 0.0 if damping < 0.01 else damping / 8.0
                again = damping > 0.0
            else:
                damping = max(0.1, 8.0 * damping)
                if damping > 1e4:
                    if not again:
                        break
                    damping, again = 0.0, False  # what was too bold where the damping rose may not be so here
        backward(setup, task, times, course, steps, points, 0.0)
        return steps, cost, priced, done, sound

    return Optimiser(forward, backward, optimise, arrival, expand)
