"""Describe one kind of dynamics and cost rate, for which kernels are compiled."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from pirrht.jit.jit import borrowing
from pirrht.systems.dynamics import no_drift, no_homing

SWAY = 1.0 / math.sqrt(12.0)  # of the mean of a step's noise beside its middle, in deviations of the noise


class KernelSpec(NamedTuple):
    """A kind of dynamics and cost rate for which kernels are compiled; functions are numba's."""

    drift: Callable[..., None]  # (x, p, out)
    control_block: Callable[..., None] | None  # G_c (x, p, out); None: what turns u into a is constant, in `Setup`
    diffusion_block: Callable[..., None] | None  # B_c (x, p, out); in input form G, of which B = G s
    q: Callable[..., float]  # (x, p) [cost/s], if it varies
    n: int  # states
    m: int  # controls
    varying_rate: bool  # whether q varies
    noisy_position: bool  # whether noise acts on the position
    angles: int = 0  # bit k tells whether the k-th state is a heading
    homing: Callable[..., None] = no_homing  # (x, p, B, aim, radius, rate, out): `Dynamics.homing`
    input_form: bool = False  # whether noise enters through inputs
    stratonovich: bool = False  # whether f and G are those of the middle of a step: `Dynamics.stratonovich`
    anisotropic: bool = (
        False  # a point that drifts, or is shaken more one way: ways, which know neither, do not lead it
    )
    moving: bool = False  # whether bodies move in the scene

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
    def curved_step(self) -> bool:
        """Tell whether its path bends within a step as the noise of the step has it."""
        return self.drifting and not self.noisy_position

    @property
    def modes(self) -> int:
        """The most modes that the noise of a step has: m, and as many sways of what bends."""
        return 2 * self.m if self.curved_step else self.m


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


def is_gated(kind: KernelSpec) -> bool:
    """Tell whether walls that are yet to be passed bend its law (`law`): of a point among moving obstacles."""
    return kind.moving and kind.n == kind.m == 2 and not kind.input_form


def is_steady(kind: KernelSpec) -> bool:
    """Tell whether a gated point has neither drift nor varying B, G or q.

    Then its optimal control is a martingale along its optimal paths (`guidance.near_walls`).
    """
    return is_gated(kind) and not (kind.drifting or kind.varying or kind.state_dependent_gain or kind.varying_rate)


def takes_law(kind: KernelSpec) -> bool:
    """Tell whether a linear law leads samples: of any system but a point among static obstacles, which climbs psi."""
    return kind.moving or not (kind.n == kind.m == 2 and not kind.anisotropic)
