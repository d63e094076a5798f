"""Simulate one path of any dynamics, under any proposal control and either exit rule.

Steps are Euler-Maruyama's. Where no noise acts on the position, the drift is that of the middle of the step's noise: a
car moves along the heading it has half-way. A Stratonovich equation takes B and drift of the middle too; the increments
y stay. One control per step would make v too high, so fitted steps draw the state at their end and its mean over the
step together: the mean is off the middle by -B sway / sqrt(12), `sway` being noise of equal variance, with a control of
its own. For a mass that is exact.

Systems other than points follow a law (`LawRows`): the noise of a step, m numbers or with sways 2 m, has the mean
(a + K (x - x_ref)) dt and the covariance L L' dt. Where noise acts on the position, steps end at crossings, up to which
only passive noise has a likelihood ratio: steps that are split near walls, or may enter the goal, draw without L.
Without moving obstacles the nearest row counts, since noise moves a mass early or late; with them the row that is due.
Beyond the last one `Dynamics.homing` takes over.

The control now is the mean of what paths apply on top of the fast-changing part of their proposal control, which is
taken at the start. Among moving obstacles that is only a share of a point's linear law (`law_weight`), since close to
walls the law changes faster than the optimal control, and nothing of a steady one (`proposals.wall_drift`).
Every step queries the moving obstacles near it; it ends when the motion of one changes that is near a noisy position.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.space import INSIDE, pose_at
from pirrht.geometry.world import NOTHING_MOVES, WALL
from pirrht.jit import vectors
from pirrht.jit.jit import borrowing, kernel, load_float64, part
from pirrht.jit.streams import antithetic, exposure, stream
from pirrht.jit.vectors import copy_row, copy_rows, solve
from pirrht.rollouts.exits import exits
from pirrht.rollouts.law import aims
from pirrht.rollouts.tables import NUMBERS, law_columns
from pirrht.rollouts.tuning import TUNING
from pirrht.systems.dynamics import no_drift
from pirrht.topology.signature import NO_CLASSES, SignatureKernels

from pirrht.rollouts.step import (  # isort: skip
    NO_WALLS, Clear, KernelSpec, diffusion_of, gap_for, length_for, motion, noise_for, pose_noise, shapes_for,
    walls_for,
)  # fmt: skip


@cache
def log_ratios(kind: KernelSpec) -> Any:
    """Build the kernel that adds a step to log dQ_g/dP (H,), up to the time `until` at which a path leaves."""
    m, modes, has_laws = kind.m, kind.modes, kind.takes_law and not kind.gated
    column = law_columns(kind.n, modes)
    matvec = vectors.matvec(modes, modes)
    axpy = vectors.axpy(modes)
    even, steps = modes + modes % 2, kind.abreast

    @part
    def of_law(tables, scratch, g, h, i, dt):  # type: ignore[no-untyped-def]
        """Return the term of a law's step."""
        law = tables.law
        drawn = scratch.drawn
        off = scratch.off

        gained, row = 0.0, law.ctypes.data + 8 * law.shape[2] * (law.shape[1] * g + scratch.stage[g])
        noise, size = scratch.fresh.ctypes.data + 8 * even * (i % steps), dt
        if g != h:  # from what was drawn under h, the noise that g would have had to draw
            axpy(off.ctypes.data, drawn.ctypes.data, 1.0, scratch.a.ctypes.data + 8 * scratch.a.shape[1] * g, -dt)
            matvec(scratch.normal.ctypes.data, row + 8 * column.inverse, off.ctypes.data)
            noise, size = scratch.normal.ctypes.data, 1.0
        for j in range(modes):
            one = load_float64(noise, j)
            gained += drawn[j] * drawn[j] - size * one * one
        return 0.5 * gained / dt - load_float64(row, column.log_det)

    @part
    def add_log_ratios(ratio, tables, scratch, h, i, dt, until, shaped):  # type: ignore[no-untyped-def]
        for g in range(ratio.shape[0]):
            if scratch.lost[g]:
                continue
            if has_laws and shaped and scratch.stage[g] < tables.law_length[g]:
                ratio[g] += of_law(tables, scratch, g, h, i, dt) if until > 0.0 else 0.0
            else:
                for j in range(m):
                    ratio[g] += scratch.a[g, j] * (scratch.y[j] - 0.5 * scratch.a[g, j] * until)

    return add_log_ratios


@cache
def recorder(kind: KernelSpec) -> Any:
    """Build kernels that add a step's control, and the proposal's part of it, to means over steps of the grid.

    With wall drift, the proposal control over a step is the mean of both ends, to second order: the next step adds the
    second half (`owed`). Among moving obstacles it is `law_weight` of a point's law, and nothing of a steady one's.
    """
    m = kind.m
    noisy_position = kind.noisy_position
    gated = kind.gated
    steady = kind.is_martingale

    @part
    def add_control(scratch, out, row, factor):  # type: ignore[no-untyped-def]
        """Add a multiple of the control that belongs to `column`, of a, to a row of out (.., m)."""
        for j in range(m):
            total = 0.0
            for k in range(m):
                total += scratch.inverse[j, k] * scratch.column[k]
            out[row, j] += factor * total

    @part
    def lead(scratch, h, law_weight, without):  # type: ignore[no-untyped-def]
        """Write the fast-changing part of the proposal control to `column`, perhaps without wall drift."""
        pushed = scratch.wall_drift[0]
        for j in range(m):
            scratch.column[j] = pushed[j] + law_weight * (scratch.a[h, j] - pushed[j]) if gated else scratch.a[h, j]
            if without:
                scratch.column[j] -= pushed[j]
            if steady:
                scratch.column[j] = 0.0

    @part
    def relax(keep, scratch, h, law_weight, owed):  # type: ignore[no-untyped-def]
        """Take off the half that is owed."""
        if owed > 0.0:
            lead(scratch, h, law_weight, False)
            add_control(scratch, keep.now, 0, -0.5 * owed)

    @part
    def record(keep, scratch, tables, h, where, until, inside):  # type: ignore[no-untyped-def]
        """Add a step of `until` seconds, the first also without wall drift; return the time that is owed."""
        (i, whole, first) = where
        near_walls = noisy_position and tables.wall_offset > 0.0
        if i < keep.applied.shape[0]:
            copy_row(scratch.y, scratch.column)
            add_control(scratch, keep.applied, i, 1.0 / whole)
        if i >= tables.window:
            return 0.0
        owes = near_walls and inside
        lead(scratch, h, tables.law_weight, False)
        for j in range(m):
            scratch.column[j] = scratch.y[j] - (0.5 if owes else 1.0) * until * scratch.column[j]
        add_control(scratch, keep.now, 0, 1.0)
        if first:
            lead(scratch, h, tables.law_weight, near_walls)
            add_control(scratch, keep.now, 1, 1.0)
        return until if owes else 0.0

    return relax, record


class Kept(NamedTuple):
    """Sums that one path adds to, from zero; `states` and `applied` without rows are left alone."""

    ratio: Array  # (H,) log dQ_g/dP under each reference
    states: Array  # (T+1, n), written
    applied: Array  # (T, m) control carried up to the exit, as a mean over each step
    now: Array  # (2, m) its integral over the window without the proposal's part; that part at the start, no wall drift


class Stretch(NamedTuple):
    """A stretch of time over which exposure to walls is judged."""

    exposed: float  # until it began [1/sqrt(s)]
    since: float  # time since then [s]; negative: none has begun
    began: float  # gap then [m]


class Scratch(NamedTuple):
    """Arrays that all paths of a thread share: n states, m controls, H references, J moving obstacles."""

    x: Array  # (n,) the state
    moved: Array  # (n,) where the step leads, and before that its middle
    f: Array  # (n,) drift
    y: Array  # (m,) noise of the step under P
    G: Array  # (rows, m) G, or scratch where B = G s
    D: Array  # (m, m) B^-1 G, which turns u into a
    inverse: Array  # (m, m) its inverse
    B: Array  # (rows, m)
    a: Array  # (H, modes) a of every reference, of all modes
    wall_drift: Array  # (1, m)
    stage: NDArray[np.int64]  # (H,) cross-section of a tube, or row of a law
    lost: NDArray[np.bool_]  # (H,) whether a reference counts for nothing
    column: Array  # (m,)
    home: Array  # (m,) a beyond the last row of a law
    drawn: Array  # (modes,) noise of the step
    off: Array  # (modes,) noise of the step less its mean under another reference [sqrt(s)]
    normal: Array  # (modes,) independent normals that the other would have had to draw for it [sqrt(s)]
    apart: Array  # (n,) state less the law's
    fresh: Array  # independent normals of the next steps
    watch: Any  # notes on moving obstacles (`MovingKernels.watch`)
    walls: Array  # (J, WALL) of moving obstacles that are near
    sides: Any  # notes on the class of the path among moving obstacles (`SignatureKernels.watch`)
    tube: NDArray[np.float32]  # (NUMBERS,) of a tube at the state


SCRATCH: Any = Scratch


@cache
def scratch_for(kind: KernelSpec) -> Any:
    """Build the kernel (setup, tables) that makes the scratch."""
    n, m, rows, modes = kind.sizes
    fresh = kind.abreast * (modes + modes % 2)

    watch = (kind.moving or NOTHING_MOVES).watch
    sides = followed(kind).watch

    @kernel
    def scratch_of(setup, tables):  # type: ignore[no-untyped-def]
        H = tables.control.shape[0]
        return SCRATCH(
            np.empty(n), np.empty(n), np.empty(n), np.empty(m), np.zeros((rows, m)), np.empty((m, m)), np.empty((m, m)),
            np.empty((rows, m)), np.zeros((H, modes)), np.empty((1, m)), np.empty(H, np.int64), np.empty(H, np.bool_),
            np.empty(m), np.zeros(m), np.zeros(modes), np.zeros(modes), np.zeros(modes), np.zeros(n), np.zeros(fresh),
            watch(setup.world.moving), np.empty((setup.world.moving.J, WALL)), sides(tables.marks),
            np.empty(NUMBERS, np.float32),
        )  # fmt: skip

    return scratch_of


def followed(kind: KernelSpec) -> SignatureKernels:
    """Return the kernels by which paths are followed among moving obstacles; nothing is noted if there are none."""
    return NO_CLASSES if kind.moving is None or kind.classes is None else kind.classes


@cache
def any_path(kind: KernelSpec) -> tuple[Any, Any]:
    """Build kernels that simulate one path of any dynamics, and that make its scratch."""
    drift = kind.drift
    q = kind.q
    n = kind.n
    noisy_position = kind.noisy_position

    varying = kind.diffusion_block is not None
    state_dependent_gain = kind.control_block is not None
    varying_rate, drifting, curved_step = kind.varying_rate, drift is not no_drift, kind.curved_step
    moving, begin_watch = kind.moving is not None, (kind.moving or NOTHING_MOVES).begin
    gain_at: Any = kind.control_block if state_dependent_gain else drift
    noise_at: Any = diffusion_of(kind) if varying else drift
    covariance, scaled, *_ = pose_noise(kind)
    pose, distances, no_walls = pose_at(kind.reads), kind.space.distances, NO_WALLS[len(kind.reads)]
    move = motion(kind)

    length_of = length_for(kind)
    gap_of = gap_for(kind)
    push_of = walls_for(kind)
    draw = noise_for(kind)

    shapes = shapes_for(kind)

    aim = aims(kind)
    judge = exits(kind)
    add_log_ratios = log_ratios(kind)

    relax, record = recorder(kind)
    key_of_step = (kind.classes or NO_CLASSES).key
    *_, begin_class, follow_class = followed(kind)

    @part
    def begin(setup, tables, origin, scratch):  # type: ignore[no-untyped-def]
        """Set the scratch to the start of a path."""
        copy_rows(setup.gain, scratch.D)
        copy_rows(setup.inverse, scratch.inverse)
        copy_rows(setup.diffusion, scratch.B)
        scratch.f[:], scratch.wall_drift[:], scratch.stage[:] = 0.0, 0.0, 0
        scratch.lost[:] = False
        copy_row(origin.x, scratch.x)
        copy_row(origin.x, scratch.moved)
        if moving:
            begin_watch(scratch.watch)

    @part
    def evaluate(setup, tables, scratch, known, before, left, now):  # type: ignore[no-untyped-def]
        """Evaluate B, B^-1 G and drift at the state: covariance per second, step, nearest walls."""
        (rates, drifted, walls) = known
        if varying:
            noise_at(scratch.x, setup.parameters, setup.inverse, scratch.G, scratch.B)
            rates = covariance(scratch.B)
        if state_dependent_gain:
            gain_at(scratch.x, setup.parameters, scratch.G)
            solve(scratch.B, scratch.G, scratch.D)
            solve(scratch.G, scratch.B, scratch.inverse)
        if drifting and not drifted:
            drift(scratch.x, setup.parameters, scratch.f)
        dt, close = length_of(setup, tables, scratch, rates, before, left, now)
        if noisy_position and tables.wall_offset > 0.0:
            walls = push_of(tables, scratch, setup.world, before, scaled(rates, dt), close)
        return rates, dt, walls, close

    @part
    def expose(scratch, static, stretch, before, rates, close):  # type: ignore[no-untyped-def]
        """Judge the stretch of time that ends here; return the next one."""
        exposed, since, began = stretch
        if since < 0.0 or since >= TUNING.stretch:
            gap, deviation = gap_of(scratch, static, before, rates, close)
            if since > 0.0:
                exposed += exposure(np.float32(began), np.float32(gap), np.float32(deviation), np.float32(since))
            return Stretch(exposed, 0.0, gap)
        return stretch

    @part
    def keep_state(keep, i, x):  # type: ignore[no-untyped-def]
        """Write the state at the end of step i - 1 of the grid, if states are kept."""
        for j in range(n if keep.states.shape[0] > 0 else 0):
            keep.states[i, j] = x[j]

    @borrowing
    def one_path(setup, tables, origin, h, sample, keep, scratch):  # type: ignore[no-untyped-def]
        """Simulate one sample around reference h and write `Kept`.

        Returns work, class key, outcome, steps of the grid taken, time until the exit in the last of them, the log
            probability that no wall was met on the way, where that is weighed, and the exposure to walls.
        """
        times = tables.times
        x = scratch.x
        T = tables.control.shape[1]

        begin(setup, tables, origin, scratch)
        keep_state(keep, 0, x)
        first, sign = antithetic(sample, tables.first[h], tables.mirrored)
        state, work, log_survival = stream(origin.seed, first), 0.0, 0.0
        key = begin_class(tables.marks, pose(x), scratch.sides)
        owed = 0.0  # time for which half of the proposal has not been taken off [s]
        stretch = Stretch(0.0, -1.0, 0.0)
        known = (covariance(scratch.B), False, no_walls)
        clear = Clear(distances(setup.world, pose(x)), 0.0, True)

        for i in range(T):
            whole, done = times[i + 1] - times[i], 0.0
            left, exit = whole, INSIDE
            while left > 0.0 and exit == INSIDE:
                now = origin.time + times[i] + done
                where = (i, whole, i == 0 and done == 0.0)
                rates, dt, walls, close = evaluate(setup, tables, scratch, known, clear.distances, left, now)
                if noisy_position:
                    stretch = expose(scratch, setup.world.static, stretch, clear.distances, rates, close)
                stretch = Stretch(stretch.exposed, stretch.since + dt, stretch.began)
                left -= dt
                aim(setup, tables, scratch, keep.ratio, walls, h, (i, done / whole))
                relax(keep, scratch, h, tables.law_weight, owed)
                shaped = shapes(setup, dt, whole, rates, clear.distances)
                state = draw(tables, scratch, state, sign, h, i, dt, shaped)
                step = move(setup, scratch, dt, rates)
                # Each cut that is crossed adds a turn to the path's class, counter-clockwise positive.
                there = pose(scratch.moved)
                key += key_of_step(tables.classes, pose(x), there)
                state, exit, share, until, missed, clear = judge(setup, tables, scratch, (dt, now), step, clear, state)
                known = step.rates, curved_step and not step.arrived, walls
                since = (done + (until if until > 0.0 else dt * share)) / whole
                key += follow_class(tables.marks, i, min(since, 1.0), there, scratch.sides)
                add_log_ratios(keep.ratio, tables, scratch, h, i, dt, until, shaped)
                owed = record(keep, scratch, tables, h, where, until, exit == INSIDE)
                log_survival += missed
                work += (q(x, setup.parameters) if varying_rate else setup.rate) * dt * share
                done += until
                copy_row(scratch.moved, x)
            keep_state(keep, i + 1, x)
            if exit != INSIDE:
                return work, key, exit, i + 1, done, log_survival, stretch.exposed
        return work, key, 0, T, times[T] - times[T - 1], log_survival, stretch.exposed

    return one_path, scratch_for(kind)
