"""The first-exit stochastic optimal control problem (paper, sections II and III-A)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import NotLinearlySolvable, OptionError
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import jitable
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.validation import check


@jitable
def unit_rate(x, p):  # type: ignore[no-untyped-def]
    """q = 1 [cost/s] at x (n,), for parameters p (k,)."""
    return 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """Minimise `E[phi(x(t_f)) + integral of q + u'Ru/2]` until the state leaves the free space or enters the goal.

    Attributes:
        dynamics: the system, of n states and m controls.
        scene: where it moves, from where and to where.
        R: control cost (m, m), u'Ru in [cost/s]; a function of the state (n,) where G or B is one.
        q: state cost rate [cost/s]; or a function q(x, p) of x (n,) and the parameters (k,) that numba compiles.
        q_min: a lower bound of q over the workspace [cost/s]; needed when q is a function.
        phi: final cost off the goal [cost]; it is 0 at the goal.
        temperature: follows from the rest: the scalar lambda of lambda G R^-1 G' = B B', in input form of
            lambda R^-1 = s s' [cost].

    Raises:
        OptionError: the system, R, q or phi cannot work here; says what would.
        NotLinearlySolvable: no scalar lambda fits G, R and B, or in input form R and s.

    Examples:
        >>> import numpy as np
        >>> from pirrht import Goal, Problem, Scene, SingleIntegrator
        >>> goal = Goal(center=np.array([3.4, 1.5]), radius=0.3)
        >>> scene = Scene(
        ...     name="room", lower=np.zeros(2), upper=np.array([4.0, 3.0]), obstacles=(), goal=goal,
        ...     start=np.array([0.6, 1.5, 0.0]), robot_radius=0.2,
        ... )
        >>> problem = Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=2.0 * np.eye(2))
        >>> problem
        Problem(SingleIntegrator in 'room': lambda 0.02, q 1, phi inf)
        >>> round(problem.temperature, 4)
        0.02
    """

    dynamics: Dynamics
    scene: Scene
    R: Array | Callable[[Array], Array]
    q: float | Callable[..., float] = 1.0
    q_min: float | None = None
    phi: float = np.inf
    temperature: float = field(init=False)

    def __post_init__(self) -> None:
        check(self.dynamics)
        m = self.dynamics.m
        shape = np.shape(self.control_cost(self.dynamics.state_of(self.scene.start)))
        if shape != (m, m):
            raise OptionError(f"R is {shape}; {type(self.dynamics).__name__} has m = {m}, so it must be {m, m}")
        if not callable(self.R):
            object.__setattr__(self, "R", np.asarray(self.R, dtype=float))
        if not callable(self.q) and not (isinstance(self.q, int | float | np.number) and np.isfinite(self.q)):
            raise OptionError(f"q is {self.q!r}; it must be a finite number, or a function q(x, p) that numba compiles")
        if callable(self.q) and self.q_min is None:
            raise OptionError("q is a function; give q_min, its least value over the workspace, as well")
        if not self.least_rate > 0:
            raise OptionError(f"the least state cost rate is {self.least_rate:g}; first exit needs a positive one")
        if np.isnan(self.phi) or self.phi < 0:
            raise OptionError(f"the final cost phi is {self.phi:g}; it must be 0 or more (infinity is allowed)")
        object.__setattr__(self, "temperature", self._temperature())

    def __repr__(self) -> str:
        rate = "q(x)" if callable(self.q) else f"q {self.q:g}"
        what = f"{type(self.dynamics).__name__} in {formatting.name(self.scene.name)}"
        return f"Problem({what}: lambda {self.temperature:.3g}, {rate}, phi {self.phi:g})"

    @property
    def least_rate(self) -> float:
        """A lower bound of q [cost/s]."""
        if self.q_min is not None:
            return self.q_min
        assert not callable(self.q)
        return self.q

    def rate(self, x: Array) -> float:
        """State cost rate q at x (n,) [cost/s]."""
        return float(self.q(x, self.dynamics.parameters)) if callable(self.q) else self.q

    def control_cost(self, x: Array) -> Array:
        """R at x (n,), (m, m); u'Ru/2 is in [cost/s]."""
        return np.asarray(self.R(x), dtype=float) if callable(self.R) else self.R

    def _temperature(self) -> float:
        """The scalar lambda of `lambda G R^-1 G' = B B'`; in input form of `lambda R^-1 = s s'`.

        Raises:
            NotLinearlySolvable: no scalar fits, at some state of the workspace; both matrices are in the message.
        """
        value, name = np.nan, type(self.dynamics).__name__
        for x in self._probes():
            R, s = self.control_cost(x), self.dynamics.input_noise
            if not (np.allclose(R, R.T) and np.linalg.eigvalsh(R).min() > 0.0):
                raise OptionError(f"R is {R.tolist()} at x = {x.tolist()}; it must be symmetric and positive definite")
            if s is not None:
                shape, noise = np.linalg.inv(R), s @ s.T
                who, left, right, remedy = f"{name}: ", "R^-1", "s s'", "(s s')^-1"
            else:
                G, B = self.dynamics.G_c(x), self.dynamics.B_c(x)
                for what, matrix in (("control_block", G), ("diffusion_block", B)):
                    if not abs(np.linalg.det(matrix)) > 0.0:
                        raise OptionError(
                            f"{name}: {what} is {matrix.tolist()} at x = {x.tolist()}; "
                            "it must have an inverse, so that noise and control act on every actuated state"
                        )
                shape, noise = G @ np.linalg.inv(R) @ G.T, B @ B.T
                who, left, right, remedy = "", "G R^-1 G'", "B B'", "G' (B B')^-1 G"
            value = float(np.trace(noise) / np.trace(shape)) if np.isnan(value) else value
            close = 0.0 if s is None else 1e-12 * np.trace(noise)
            if not (np.allclose(value * shape, noise, rtol=1e-8, atol=close) and value > 0):
                raise NotLinearlySolvable(
                    f"{who}no lambda solves lambda {left} = {right} at x = {formatting.vector(x)}: "
                    f"{left} = {formatting.matrix(shape)}, {right} = {formatting.matrix(noise)}; "
                    f"choose R proportional to {remedy}"
                )
        return value

    def _probes(self) -> list[Array]:
        """States all over the workspace, or one where nothing depends on the state."""
        count = 1 if self.dynamics.constant and not callable(self.R) else 16
        lower, upper = self.dynamics.box(self.scene)
        fraction = np.tile(np.linspace(0.0, 1.0, count)[:, None], self.dynamics.n)
        fraction[:, :2] = (np.arange(1, count + 1)[:, None] * np.array([0.7548776662, 0.5698402910])) % 1.0
        return list(lower + fraction * (upper - lower))
