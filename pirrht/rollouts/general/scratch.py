"""Allocate the arrays that all paths of a thread share."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.jit.jit import kernel
from pirrht.moving.tuning import CELL_STATE, NEAR_WIDTH
from pirrht.rollouts.general.kind import KernelSpec
from pirrht.rollouts.ways import NUMBERS
from pirrht.topology.moving_crossings import SPOT

ABREAST = 8  # steps whose noise is drawn at once


class Scratch(NamedTuple):
    """Scratch of a system with n states and m controls under H references among J moving obstacles."""

    x: Array  # (n,) the state
    moved: Array  # (n,) where the step leads, and before that its middle
    f: Array  # (n,) drift
    y: Array  # (m,) noise of the step under P
    G: Array  # (rows, m) G, or scratch where B = G s
    D: Array  # (m, m) B^-1 G
    B: Array  # (rows, m)
    a: Array  # (H, m) B^-1 G u of every reference
    pushed: Array  # (m,) what walls push on top
    stage: NDArray[np.int64]  # (H,) the node of its way, or the step of its law
    lost: NDArray[np.bool_]  # (H,) whether it is out of question
    column: Array  # (m, 1)
    carried: Array  # (m, 1)
    wide: Array  # (H, 2 m) a of every reference, of all modes
    home: Array  # (m,) beyond the last step of a law
    white: Array  # (2 m,) independent normals
    drawn: Array  # (2 m,) noise of the step, of all modes
    off: Array  # (2 m,) independent normals that another reference would have had to draw for it [sqrt(s)]
    beside: Array  # (n,) how far the state is from the law's
    fresh: Array  # normals of the next steps
    held: NDArray[np.int64]  # (CELL_STATE,) of what bodies are listed
    listed: NDArray[np.int64]  # (J,) those within reach
    near: Array  # (J, NEAR_WIDTH) where they are
    side: Array  # (marks,) on which side of the ray of each marker that moves the path is
    spot: Array  # (SPOT,) where it was seen there
    tube: NDArray[np.float32]  # (NUMBERS,) of a way next to the state


SCRATCH: Any = Scratch


@cache
def scratch_for(kind: KernelSpec) -> Any:
    """Build the kernel (setup, leads) that makes the scratch."""
    n, m, rows, moving = kind.n, kind.m, kind.rows, kind.moving

    @kernel
    def scratch_of(setup, leads):  # type: ignore[no-untyped-def]
        H = leads.control.shape[0]
        bodies = setup.world.moving.J if moving else 0
        return SCRATCH(
            np.empty(n), np.empty(n), np.empty(n), np.empty(m),
            np.zeros((rows, m)), np.empty((m, m)), np.empty((rows, m)),
            np.empty((H, m)), np.empty(m), np.empty(H, np.int64), np.empty(H, np.bool_),
            np.empty((m, 1)), np.empty((m, 1)),
            np.zeros((H, 2 * m)), np.zeros(m), np.zeros(2 * m), np.zeros(2 * m), np.zeros(2 * m), np.zeros(n),
            np.zeros(ABREAST * 2 * (m + 1)),
            np.empty(CELL_STATE, np.int64), np.empty(bodies, np.int64), np.empty((bodies, NEAR_WIDTH)),
            np.empty(leads.marks.weight.shape[0]), np.empty(SPOT), np.empty(NUMBERS, np.float32),
        )  # fmt: skip

    return scratch_of
