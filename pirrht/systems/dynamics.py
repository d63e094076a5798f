"""Controlled diffusions `dx = f(x) dt + G(x) u dt + B(x) dw` with noise and control in one channel (paper eq. 1).

The state is partitioned as x = [x_m; x_c]: control and noise enter x_c only, through the square blocks
G_c and B_c. One definition of each system serves the rollout kernels, the analytic plant and the tests.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import jitable
from pirrht.errors import OptionError


class Dynamics(ABC):
    """A planar system whose first two states are the position [m].

    `drift`, `control_block` and `diffusion_block` are numeric functions `(x, p, out) -> None` that fill `out`;
    they must compile with numba. `p` is `parameters`. The blocks may be arrays instead: then they are constant
    and rollouts take the fast path.
    """

    n: int  # states
    m: int  # controls; the last m states are the actuated ones
    parameters: Array  # (k,) numbers the functions read
    drift: Callable[..., None]  # f, out (n,) [state/s]
    control_block: Array | Callable[..., None]  # G_c, (m, m) [state/s per control]
    diffusion_block: Array | Callable[..., None]  # B_c, (m, m) [state/sqrt(s)]

    @abstractmethod
    def twist(self, x: Array, rate: Array) -> Array:
        """Velocity command (2,) of the robot for rates (m,) of the actuated states, in the robot's own terms."""

    @property
    def constant(self) -> bool:
        """Whether neither G nor B depends on the state."""
        return isinstance(self.control_block, np.ndarray) and isinstance(self.diffusion_block, np.ndarray)

    @property
    def noisy_position(self) -> bool:
        """Whether the noise acts on the position itself (then exits need a Brownian bridge, else a sweep)."""
        return self.n - self.m < 2

    def f(self, x: Array) -> Array:
        """Passive drift at x (n,), (n,) [state/s]."""
        out = np.zeros(self.n)
        self.drift(x, self.parameters, out)
        return out

    def G_c(self, x: Array) -> Array:
        """Actuated block of G at x, (m, m)."""
        return self._block(self.control_block, x)

    def B_c(self, x: Array) -> Array:
        """Actuated block of B at x, (m, m)."""
        return self._block(self.diffusion_block, x)

    def rate(self, x: Array, u: Array, dw: Array, dt: float) -> Array:
        """Rates (m,) of the actuated states under control u and Brownian increment dw over dt."""
        actuated: Array = self.f(x)[self.n - self.m :] + self.G_c(x) @ u + self.B_c(x) @ dw / dt
        return actuated

    def step(self, x: Array, u: Array, dw: Array, dt: float) -> Array:
        """One Euler-Maruyama step from x (n,) with the increment dw (m,) [sqrt(s)] handed in, (n,)."""
        dx = self.f(x) * dt
        dx[self.n - self.m :] = self.rate(x, u, dw, dt) * dt
        moved: Array = x + dx
        return moved

    def _block(self, block: Array | Callable[..., None], x: Array) -> Array:
        if isinstance(block, np.ndarray):
            return block
        out = np.zeros((self.m, self.m))
        block(x, self.parameters, out)
        return out


@jitable
def no_drift(x, p, out):  # type: ignore[no-untyped-def]
    """f = 0."""
    for i in range(out.shape[0]):
        out[i] = 0.0


def _check_noise(b: float) -> None:
    if not (np.isfinite(b) and b > 0):
        raise OptionError(f"the noise b is {b:g}; path integrals need a positive number")
