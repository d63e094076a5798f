"""What the noise of a step says for each reference, against none; and what of it is kept as control."""

from __future__ import annotations

from functools import cache
from typing import Any

from pirrht.compiled.addresses import load_float64
from pirrht.compiled.jit import part
from pirrht.compiled.linear import solve
from pirrht.rollouts.general.kind import Kind, is_car, is_gated, is_steady, takes_law
from pirrht.rollouts.general.law import columns_of
from pirrht.rollouts.general.rows import rows_of
from pirrht.rollouts.general.scratch import ABREAST


@cache
def log_ratios(kind: Kind) -> Any:
    """The kernel that adds a step to log dQ_g/dP (H,), up to the time `until` at which a path leaves."""
    n, m, noisy_position, car, leadable = kind.n, kind.m, kind.noisy_position, is_car(kind), takes_law(kind)

    _, _, times, mix = rows_of(n, m, kind.modes)

    @part
    def add_log_ratios(keep, leads, scratch, h, i, dt, until, sway, modes):  # type: ignore[no-untyped-def]
        ratio = keep.ratio
        law, led, y, drawn, a = leads.law, leads.led, scratch.y, scratch.drawn, scratch.a
        wide, aside, white = scratch.wide, scratch.aside, scratch.white
        wide_at = wide.ctypes.data
        _, _, _, inverse, end = columns_of(n, modes)
        rows_at, pitch = law.ctypes.data, 8 * law.shape[2]
        for g in range(ratio.shape[0]):
            if scratch.lost[g]:
                continue
            if car and led[g] > i:
                if until > 0.0:
                    off = (y[0] - a[g, 0] * dt) / law[g, i, 7]
                    ratio[g] += 0.5 * (y[0] * y[0] - off * off) / dt - law[g, i, 8]
                    off = sway - aside[g] * dt - law[g, i, 13] * (y[0] - a[g, 0] * dt)
                    ratio[g] += 0.5 * (sway * sway - (off / law[g, i, 14]) ** 2) / dt
            elif leadable and not noisy_position and scratch.stage[g] < led[g]:
                if until > 0.0:
                    gained, row = 0.0, rows_at + pitch * (law.shape[1] * g + scratch.stage[g])
                    noise, size = scratch.fresh.ctypes.data + 8 * (modes + modes % 2) * (i % ABREAST), dt
                    if g != h:  # from what was drawn under h, the noise that g would have had to draw
                        mix(white.ctypes.data, drawn.ctypes.data, 1.0, wide_at + 8 * wide.shape[1] * g, -dt, modes)
                        times(scratch.off.ctypes.data, row + 8 * inverse, white.ctypes.data, modes)
                        noise, size = scratch.off.ctypes.data, 1.0
                    for j in range(modes):
                        one = load_float64(noise, j)
                        gained += drawn[j] * drawn[j] - size * one * one
                    ratio[g] += 0.5 * gained / dt - load_float64(row, end)
            else:
                for j in range(m):
                    ratio[g] += a[g, j] * (y[j] - 0.5 * a[g, j] * until)

    return add_log_ratios


@cache
def recorder(kind: Kind) -> Any:
    """Kernels that add what a step applied, and the part of it that its lead takes, to means over steps of the grid.

    Over a step the guide is the mean of both ends, to second order, where walls push: its second half is added when the
    next step has found out (`owed`). Of a point among bodies that move a
    share `counted` of its law is taken, and of a steady one that share of what walls push.
    """
    m, gaining, gated, steady = kind.m, kind.gaining, is_gated(kind), is_steady(kind)

    @part
    def to_controls(scratch, inverse):  # type: ignore[no-untyped-def]
        """Turn `column`, of a, into the control behind it, in `carried`."""
        column, carried = scratch.column, scratch.carried
        if gaining:
            solve(scratch.D, column, carried)
        else:
            for j in range(m):
                carried[j, 0] = 0.0
                for k in range(m):
                    carried[j, 0] += inverse[j, k] * column[k, 0]

    @part
    def taken(scratch, h, counted, without):  # type: ignore[no-untyped-def]
        """Write the part of the lead that changes fast to `column`, perhaps without what walls push."""
        pushed, a = scratch.pushed, scratch.a
        for j in range(m):
            pushing = counted * pushed[j] if steady else pushed[j]
            scratch.column[j, 0] = pushing + counted * (a[h, j] - pushed[j]) if gated else a[h, j]
            if without:
                scratch.column[j, 0] -= pushing

    @part
    def settle(led_by, inverse, scratch, h, counted, owed, last):  # type: ignore[no-untyped-def]
        """Add what is owed to the last step."""
        taken(scratch, h, counted, False)
        to_controls(scratch, inverse)
        for j in range(m):
            led_by[last, j] += 0.5 * owed * scratch.carried[j, 0]

    @part
    def record(keep, inverse, scratch, h, counted, where, until, near_walls, inside):  # type: ignore[no-untyped-def]
        """Add a step of `until` seconds, and what it is led by without walls if it is a path's first one."""
        (i, whole, first), y, carried = where, scratch.y, scratch.carried
        if i < keep.applied.shape[0]:
            for j in range(m):
                scratch.column[j, 0] = y[j]
            to_controls(scratch, inverse)
            for j in range(m):
                keep.applied[i, j] += carried[j, 0] / whole
        if i < keep.led_by.shape[0]:
            for start in range(2 if first else 1):
                taken(scratch, h, counted, start == 1 and near_walls)
                to_controls(scratch, inverse)
                for j in range(m):
                    if start == 1:
                        keep.base[j] = carried[j, 0]
                    else:
                        share = 0.5 if near_walls and inside else 1.0
                        keep.led_by[i, j] += share * carried[j, 0] * until / whole

    return settle, record
