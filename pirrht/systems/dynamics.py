"""Controlled diffusions `dx = f(x) dt + G(x) u dt + B(x) dw` with noise and control in one channel (paper eq. 1).

The state is partitioned as x = [x_m; x_c]: control and noise enter x_c only, through the square blocks
G_c and B_c. One definition of each system serves the rollout kernels, the analytic plant and the tests.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import jitable
from pirrht.errors import OptionError
from pirrht.geometry.scene import Scene


@jitable
def no_homing(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """No control, written to out (m,) [1/sqrt(s)]: what outlives its guide is left to itself."""
    for j in range(out.shape[0]):
        out[j] = 0.0


class Dynamics(ABC):
    """A planar system whose first two states are the position [m].

    `drift`, `control_block` and `diffusion_block` are numeric functions `(x, p, out) -> None` that fill `out`;
    they must compile with numba. `p` is `parameters`. The blocks may be arrays instead: then they are constant
    and rollouts take the fast path. `states` names the components: "x" and "y" [m] first, then "heading" [rad], "vx",
    "vy", "speed" [m/s], "t" [s] or whatever else the system has, but no "z".
    """

    n: int  # states
    m: int  # controls; the last m states are the actuated ones
    states: tuple[str, ...] = ("x", "y")  # (n,) what the components of a state are
    parameters: Array  # (k,) numbers the functions read
    drift: Callable[..., None]  # f, out (n,) [state/s]
    control_block: Array | Callable[..., None]  # G_c, (m, m) [state/s per control]
    diffusion_block: Array | Callable[..., None]  # B_c, (m, m) [state/sqrt(s)]
    # Optional: what samples do that outlive their guide, (x, p, B, aim, radius, rate, out) -> None, compiled by numba:
    # the control towards the goal's disc at aim (x, y) [m] as a = B_c^-1 G_c u, out (m,) [1/sqrt(s)]; rate is q/lambda.
    homing: Callable[..., None] = staticmethod(no_homing)

    @abstractmethod
    def twist(self, x: Array, rate: Array) -> Array:
        """Velocity command (2,) of the robot at x (n,), in its own terms, for rates (m,) [state/s] of x_c."""

    @property
    def constant(self) -> bool:
        """Whether neither G nor B depends on the state; then both are arrays (m, m)."""
        return isinstance(self.control_block, np.ndarray) and isinstance(self.diffusion_block, np.ndarray)

    @property
    def noisy_position(self) -> bool:
        """Whether the noise acts on the position itself (then exits need a Brownian bridge, else a sweep)."""
        return self.n - self.m < 2

    @cached_property
    def position(self) -> tuple[int, int]:
        """Indices of x and y [m] in a state (n,)."""
        return self.states.index("x"), self.states.index("y")

    @cached_property
    def angles(self) -> tuple[int, ...]:
        """Indices of the headings [rad] in a state (n,)."""
        return tuple(i for i, name in enumerate(self.states) if name == "heading")

    @cached_property
    def clock(self) -> int | None:
        """Index of the time [s] in a state (n,), if it is one of the components."""
        return self.states.index("t") if "t" in self.states else None

    def difference(self, x: Array, y: Array) -> Array:
        """x - y of states (..., n), headings from -pi to pi [rad], (..., n)."""
        off: Array = x - y
        for i in self.angles:
            off[..., i] = (off[..., i] + np.pi) % (2.0 * np.pi) - np.pi
        return off

    def state_of(self, pose: Array) -> Array:
        """The state (n,) at x, y [m] and heading [rad] (3,); whatever else it has is zero."""
        x = np.zeros(self.n)
        x[list(self.position)] = pose[:2]
        x[list(self.angles)] = pose[2]
        return x

    def box(self, scene: Scene) -> tuple[Array, Array]:
        """Least and greatest state, 2 x (n,), to probe between: workspace [m], headings [rad], -1 to 1 else."""
        upper = np.ones(self.n)
        upper[list(self.angles)] = np.pi
        lower = -upper
        lower[list(self.position)], upper[list(self.position)] = scene.lower, scene.upper
        return lower, upper

    def check(self) -> None:
        """Whether scenes and rollouts can serve this system.

        Raises:
            OptionError: they cannot; names the class and says what would have worked.
        """
        name, given = type(self).__name__, ", ".join(self.states)
        needed = ("n", "m", "parameters", "drift", "control_block", "diffusion_block")
        missing = [what for what in needed if getattr(self, what, None) is None]
        if missing:
            raise OptionError(f"{name}: {' and '.join(missing)} missing; a Dynamics declares {', '.join(needed)}")
        if "z" in self.states:
            raise OptionError(f'{name}: its state "z" is a third position, but scenes are planar; keep to "x" and "y"')
        if self.n < 2:
            raise OptionError(f"{name}: n is {self.n}; a robot in the plane has at least the 2 states x and y")
        if self.states[:2] != ("x", "y"):
            raise OptionError(f'{name}: its states are ({given}); the first two must be "x" and "y"')
        if not len(set(self.states)) == len(self.states) == self.n:
            raise OptionError(
                f"{name}: n is {self.n}, but its states are ({given}); name each once, "
                'as in states = ("x", "y", "vx", "vy"); scenes are planar, so there is no third position'
            )
        if not 1 <= self.m <= self.n:
            raise OptionError(f"{name}: m is {self.m}; of {self.n} states at least 1 and at most {self.n} are actuated")
        for what in ("control_block", "diffusion_block"):
            block = getattr(self, what)
            if not callable(block) and not isinstance(block, np.ndarray):
                raise OptionError(f"{name}: {what} is a {type(block).__name__}; it must be an array or a function")
            if not callable(block) and np.shape(block) != (self.m, self.m):
                raise OptionError(f"{name}: {what} is {np.shape(block)}; with m = {self.m} it must be {self.m, self.m}")
        try:
            self.drift(np.zeros(self.n), self.parameters, np.zeros(self.n))
        except TypeError as error:
            raise OptionError(f"{name}: drift(x, p, out) cannot be called ({error}); make it a @staticmethod") from None

    def f(self, x: Array) -> Array:
        """Passive drift at x (n,), (n,) [state/s]."""
        out = np.zeros(self.n)
        self.drift(x, self.parameters, out)
        return out

    def G_c(self, x: Array) -> Array:
        """Actuated block of G at x (n,), (m, m) [state/s per control]."""
        return self._block(self.control_block, x)

    def B_c(self, x: Array) -> Array:
        """Actuated block of B at x (n,), (m, m) [state/sqrt(s)]."""
        return self._block(self.diffusion_block, x)

    def rate(self, x: Array, u: Array, dw: Array, dt: float) -> Array:
        """Rates (m,) [state/s] of the actuated states at x (n,), for u (m,) and noise dw (m,) [sqrt(s)] over dt [s]."""
        actuated: Array = self.f(x)[self.n - self.m :] + self.G_c(x) @ u + self.B_c(x) @ dw / dt
        return actuated

    def step(self, x: Array, u: Array, dw: Array, dt: float) -> Array:
        """One Euler-Maruyama step of dt [s] from x (n,) under u (m,), increment dw (m,) [sqrt(s)] handed in, (n,)."""
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
    """f = 0 at x (n,), written to out (n,) [state/s]."""
    for i in range(out.shape[0]):
        out[i] = 0.0


def _check_noise(b: float) -> None:
    if not (np.isfinite(b) and b > 0):
        raise OptionError(f"the noise b is {b:g}; path integrals need a positive number")
