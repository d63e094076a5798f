"""What a step of a rollout cannot do without: its normal numbers, and the arithmetic of the paper's kernel."""

import numpy as np
from numba import njit

from pirrht.geometry.world import World
from pirrht.jit.jit import mapped
from pirrht.topology.signature import Table

from pirrht.rollouts.point_stages import (  # isort: skip
    DT, LANES, NX, ROOT, SIGN, L, X, add_log_ratios, draw, judge, move, scratch_of, single, single_matrix,
    survey,
)  # fmt: skip

STEPS = 60
STEP = 0.1  # [s]


@njit(nogil=True, error_model="numpy")
def _normals(blocks, scratch):  # type: ignore[no-untyped-def]
    """Two normals per step, of many lanes abreast."""
    f, _, _, _, _, random, bits = scratch
    for _ in range(blocks * STEPS):
        draw(random, bits, f, LANES)


@njit(nogil=True, error_model="numpy")
def _steps(around, keys, table, H, noise, blocks, scratch):  # type: ignore[no-untyped-def]
    """The same with the step, its class, one look-up, the exit at its end and H likelihood ratios; no path ends."""
    f, a, ratio, short, long, random, bits = scratch
    B, goal = single_matrix(noise * np.eye(2)), around.goal
    f[DT : DT + L], f[ROOT : ROOT + L] = STEP, STEP**0.5
    for _ in range(blocks):
        f[X:SIGN], ratio[:] = 0.0, 0.0
        f[X : X + L], f[X + L : X + 2 * L] = goal[0], goal[1]
        for _ in range(STEPS):
            draw(random, bits, f, LANES)
            move(0, B, f, a, LANES)
            keys(table, f, (X, X + L, NX, NX + L), LANES, long, 0)
            survey(around, f, short, LANES)
            judge(around, f, short, LANES)
            add_log_ratios(0, H, f, a, ratio, LANES)
            f[X : X + 2 * L] = f[NX : NX + 2 * L]


def normals(samples: int, threads: int) -> int:
    """Draw what `samples` paths of 60 steps need; number of steps."""
    return _on(threads, samples, 1, lambda blocks, scratch: _normals(blocks, scratch))


def steps(arena: World, table: Table, classes: int, samples: int, threads: int) -> int:
    """Simulate `samples` paths of 60 steps that nothing ends; number of steps."""
    keys = table.kernels.keys
    return _on(
        threads,
        samples,
        classes,
        lambda blocks, scratch: _steps(single(arena), keys, table, classes, 0.01, blocks, scratch),
    )


def _on(threads: int, samples: int, classes: int, work) -> int:  # type: ignore[no-untyped-def]
    blocks = max(1, round(samples / LANES / threads))
    mapped(lambda _: work(blocks, scratch_of(classes)), range(threads), threads)
    return blocks * threads * LANES * STEPS
