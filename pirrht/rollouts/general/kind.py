"""Describe one kind of dynamics and cost rate, for which kernels are compiled, and allocate what its paths share."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.world import NOTHING_MOVES, WALL, MovingKernels
from pirrht.jit.jit import borrowing, kernel
from pirrht.rollouts.tables import NUMBERS
from pirrht.rollouts.tuning import TUNING
from pirrht.systems.dynamics import no_drift, no_homing
from pirrht.topology.moving_crossings import SPOT

SWAY = 1.0 / math.sqrt(12.0)  # deviation of the mean of a step's noise from its middle, in deviations of the noise


class KernelSpec(NamedTuple):
    """A kind of dynamics and cost rate for which kernels are compiled; functions are numba's."""

    drift: Callable[..., None]  # (x, p, out)
    control_block: Callable[..., None] | None  # G_c (x, p, out); None: B^-1 G, which turns u into a, is constant
    diffusion_block: Callable[..., None] | None  # B_c (x, p, out); in input form G, of which B = G s; None: constant
    q: Callable[..., float]  # (x, p) [cost/s], if it varies
    n: int  # states
    m: int  # controls
    varying_rate: bool  # whether q varies
    noisy_position: bool  # whether noise acts on the position
    angles: int = 0  # bit k: the k-th state is a heading
    homing: Callable[..., None] = no_homing  # (x, p, B, aim, radius, rate, out): `Dynamics.homing`
    input_form: bool = False  # whether noise enters through inputs
    stratonovich: bool = False  # whether f and G are those of the middle of a step: `Dynamics.stratonovich`
    anisotropic: bool = False  # whether a point drifts, or has more noise one way: tubes know neither
    moving: MovingKernels | None = None  # kernels of moving obstacles; None: they are compiled away
    curved_step: bool = False  # whether paths bend within a step by its noise, of which the mean over it is drawn too

    @property
    def rows(self) -> int:
        """Trailing states that B has rows for."""
        return self.n if self.input_form else self.m

    @property
    def drifting(self) -> bool:
        """Tell whether its state moves by itself."""
        return self.drift is not no_drift

    @property
    def varying(self) -> bool:
        """Tell whether B varies with the state."""
        return self.diffusion_block is not None

    @property
    def state_dependent_gain(self) -> bool:
        """Tell whether B^-1 G, which turns u into a, varies with the state."""
        return self.control_block is not None

    @property
    def along_line(self) -> bool:
        """Tell whether its position moves to and fro along a line alone."""
        return self.rows > self.m and self.noisy_position and not self.drifting

    @property
    def modes(self) -> int:
        """Modes of the noise of a step: m, and as many sways of paths that bend."""
        return 2 * self.m if self.curved_step else self.m

    @property
    def gated(self) -> bool:
        """Tell whether walls push on top of its law (`law`): of a point among moving obstacles."""
        return self.moving is not None and self.n == self.m == 2 and not self.input_form

    @property
    def is_martingale(self) -> bool:
        """Tell whether a gated point has neither drift nor varying B, G or q.

        Then its optimal control is a martingale along its optimal paths (`proposals.wall_drift`).
        """
        varies = self.drifting or self.varying or self.state_dependent_gain or self.varying_rate
        return self.gated and not varies

    @property
    def takes_law(self) -> bool:
        """Tell whether samples follow a linear law; those of a point among static obstacles climb psi instead."""
        return self.moving is not None or not (self.n == self.m == 2 and not self.anisotropic)


@cache
def diffusion_of(kind: KernelSpec) -> Any:
    """Build the kernel (x, p, s, G, B) that writes B (rows, m) at x (n,) where it varies; G (n, m) is scratch."""
    block: Any = kind.diffusion_block
    rows, m = kind.rows, kind.m

    @borrowing
    def through_inputs(x, p, s, G, B):  # type: ignore[no-untyped-def]
        block(x, p, G)
        for i in range(rows):
            for j in range(m):
                total = 0.0
                for k in range(m):
                    total += G[i, k] * s[k, j]
                B[i, j] = total

    @borrowing
    def as_it_is(x, p, s, G, B):  # type: ignore[no-untyped-def]
        block(x, p, B)

    return through_inputs if kind.input_form else as_it_is


class Scratch(NamedTuple):
    """Arrays that all paths of a thread share: n states, m controls, H references, J moving obstacles."""

    x: Array  # (n,) the state
    moved: Array  # (n,) where the step leads, and before that its middle
    f: Array  # (n,) drift
    y: Array  # (m,) noise of the step under P
    G: Array  # (rows, m) G, or scratch where B = G s
    D: Array  # (m, m) B^-1 G
    B: Array  # (rows, m)
    a: Array  # (H, m) B^-1 G u of every reference
    wall_drift: Array  # (m,) wall drift
    stage: NDArray[np.int64]  # (H,) cross-section of a tube, or row of a law
    lost: NDArray[np.bool_]  # (H,) whether a reference counts for nothing
    column: Array  # (m, 1)
    carried: Array  # (m, 1)
    wide: Array  # (H, modes) a of every reference, of all modes
    home: Array  # (m,) a beyond the last row of a law
    white: Array  # (modes,) independent normals
    drawn: Array  # (modes,) noise of the step
    off: Array  # (modes,) independent normals that another reference would have had to draw for it [sqrt(s)]
    apart: Array  # (n,) state less the law's
    fresh: Array  # normals of the next steps
    watch: Any  # notes on moving obstacles (`MovingKernels.watch`)
    walls: Array  # (J, WALL) of moving obstacles that are near
    side: Array  # (marks,) side of the ray of each moving marker on which the path is
    spot: Array  # (SPOT,) where that was evaluated
    tube: NDArray[np.float32]  # (NUMBERS,) of a tube at the state


SCRATCH: Any = Scratch


@cache
def scratch_for(kind: KernelSpec) -> Any:
    """Build the kernel (setup, tables) that makes the scratch."""
    n, m, rows, modes, steps = kind.n, kind.m, kind.rows, kind.modes, TUNING.abreast
    watch = (kind.moving or NOTHING_MOVES).watch

    @kernel
    def scratch_of(setup, tables):  # type: ignore[no-untyped-def]
        H = tables.control.shape[0]
        return SCRATCH(
            np.empty(n), np.empty(n), np.empty(n), np.empty(m), np.zeros((rows, m)), np.empty((m, m)),
            np.empty((rows, m)), np.empty((H, m)), np.empty(m), np.empty(H, np.int64), np.empty(H, np.bool_),
            np.empty((m, 1)), np.empty((m, 1)), np.zeros((H, modes)), np.zeros(m), np.zeros(modes), np.zeros(modes),
            np.zeros(modes), np.zeros(n), np.zeros(steps * (modes + modes % 2)), watch(setup.world.moving),
            np.empty((setup.world.moving.J, WALL)), np.empty(tables.marks.weight.shape[0]), np.empty(SPOT),
            np.empty(NUMBERS, np.float32),
        )  # fmt: skip

    return scratch_of
