"""The first-exit stochastic optimal control problem (paper, sections II and III-A)."""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import NotLinearlySolvable, OptionError, one_line
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import jitable
from pirrht.systems.dynamics import Dynamics


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
        for fault in _faults(self.dynamics):
            raise OptionError(f"{type(self.dynamics).__name__}: {fault}")
        self._require_fit()
        m = self.dynamics.m
        shape = np.shape(self.control_cost(self.dynamics.state_of(self.scene.start)))
        if shape != (m, m):
            raise OptionError(f"R is {shape}; {type(self.dynamics).__name__} has m = {m}, so it must be {m, m}")
        if not callable(self.R):
            object.__setattr__(self, "R", np.asarray(self.R, dtype=float))
        if callable(self.q) and self.q_min is None:
            raise OptionError("q is a function; give q_min, its least value over the workspace, as well")
        if not callable(self.q) and not (isinstance(self.q, int | float | np.number) and np.isfinite(self.q)):
            raise OptionError(f"q is {self.q!r}; it must be a finite number, or a function q(x, p) that numba compiles")
        if not self.least_rate > 0:
            raise OptionError(f"the least state cost rate is {self.least_rate:g}; first exit needs a positive one")
        if np.isnan(self.phi) or self.phi < 0:
            raise OptionError(f"the final cost phi is {self.phi:g}; it must be 0 or more (infinity is allowed)")
        object.__setattr__(self, "temperature", self._temperature())

    def _require_fit(self) -> None:
        """Refuse a system of another space than the scene, and a footprint that turns where it has no heading."""
        where = {2: "in the plane", 3: "in space"}
        if len(self.dynamics.position) != self.scene.dimension:
            raise OptionError(
                f"{type(self.dynamics).__name__} moves {where[len(self.dynamics.position)]}, and the scene "
                f"{formatting.name(self.scene.name)} is {where[self.scene.dimension]}; choose a system of that space"
            )
        if not self.scene.footprint.is_disc and self.dynamics.heading is None:
            raise OptionError(
                f"{self.scene.footprint} turns, and {type(self.dynamics).__name__} has no heading among its states "
                f"{', '.join(self.dynamics.states)}; choose a disc, or a system with one"
            )

    def __repr__(self) -> str:
        rate = "q(x)" if callable(self.q) else f"q {self.q:g}"
        what = f"{type(self.dynamics).__name__} in {formatting.name(self.scene.name)}"
        return f"Problem({what}: lambda {self.temperature:.3g}, {rate}, phi {self.phi:g})"

    @property
    def least_rate(self) -> float:
        """A lower bound of q [cost/s]."""
        return self.q if self.q_min is None else self.q_min  # type: ignore[return-value]

    def rate(self, x: Array) -> float:
        """State cost rate q at x (n,) [cost/s]."""
        return float(self.q(x, self.dynamics.parameters)) if callable(self.q) else self.q

    def control_cost(self, x: Array) -> Array:
        """R at x (n,), (m, m); u'Ru/2 is in [cost/s]."""
        return np.asarray(self.R(x), dtype=float) if callable(self.R) else self.R

    def clearance_spread(self, x: Array) -> float:
        """Deviation that noise gives the clearance of the footprint at x (n,) at most [m/sqrt(s)]."""
        return self.dynamics.position_spread(x) + (
            0.0 if self.scene.footprint.is_disc else self.scene.footprint.reach * self.dynamics.heading_spread(x)
        )

    def _temperature(self) -> float:
        """The scalar lambda of `lambda G R^-1 G' = B B'`, or of `lambda R^-1 = s s'`; else NotLinearlySolvable."""
        value, name = np.nan, type(self.dynamics).__name__
        left, right, remedy = "G R^-1 G'", "B B'", "G' (B B')^-1 G"
        if self.dynamics.input_form:
            left, right, remedy = "R^-1", "s s'", "(s s')^-1"
        for x in self._probes():
            R = self.control_cost(x)
            G, B = self.dynamics.noise_form(x)

            if not (np.allclose(R, R.T) and np.linalg.eigvalsh(R).min() > 0.0):
                raise OptionError(f"R is {R.tolist()} at x = {x.tolist()}; it must be symmetric and positive definite")
            for what, matrix in (("control_block", G), ("diffusion_block", B)):
                if not abs(np.linalg.det(matrix)) > 0.0:
                    raise OptionError(
                        f"{name}: {what} is {matrix.tolist()} at x = {x.tolist()}; "
                        "it must have an inverse, so that noise and control act on every actuated state"
                    )
            shape = G @ np.linalg.inv(R) @ G.T
            noise = B @ B.T
            value = float(np.trace(noise) / np.trace(shape)) if np.isnan(value) else value
            if not (np.allclose(value * shape, noise, rtol=1e-8, atol=1e-12 * np.trace(noise)) and value > 0):
                raise NotLinearlySolvable(
                    f"{name}: no lambda solves lambda {left} = {right} at x = {formatting.vector(x)}: "
                    f"{left} = {formatting.matrix(shape)}, {right} = {formatting.matrix(noise)}; "
                    f"choose R proportional to {remedy}"
                )
        return value

    def _probes(self) -> list[Array]:
        """States all over the workspace, or one where nothing depends on the state."""
        count = 1 if self.dynamics.constant and not callable(self.R) else 16
        lower, upper = self.dynamics.box(self.scene)
        fraction = np.tile(np.linspace(0.0, 1.0, count)[:, None], self.dynamics.n)
        strides = np.array([0.7548776662, 0.5698402910, 0.4301597090])
        fraction[:, list(self.dynamics.position)] = (
            np.arange(1, count + 1)[:, None] * strides[: len(self.dynamics.position)]
        ) % 1.0
        return list(lower + fraction * (upper - lower))


def _faults(d: Dynamics) -> Iterator[str]:
    """Find faults of a system that scenes and rollouts cannot serve, with remedies."""
    n = getattr(d, "n", 0)
    m = getattr(d, "m", 0)
    given = ", ".join(d.states)

    shapes: dict[str, tuple[int, ...]] = {"control_block": (m, m), "diffusion_block": (m, m)}
    if d.input_form:
        shapes = {"input_matrix": (n, m), "input_noise": (m, m)}
    needed = ("n", "m", "parameters", "drift", *shapes)
    if missing := [what for what in needed if getattr(d, what, None) is None]:
        yield f"{' and '.join(missing)} missing; a Dynamics declares {', '.join(needed)}"
    axes = ("x", "y", "z")[: len(d.position)]
    if "z" in d.states and len(axes) == 2:
        yield 'its state "z" is a third position; declare position = (0, 1, 2), or keep to "x" and "y" in the plane'
    if n < len(axes):
        yield f"n is {n}; a robot has at least the {len(axes)} states {' and '.join(axes)}"
    if d.states[: len(axes)] != axes:
        first = " and ".join(f'"{axis}"' for axis in axes)
        yield f"its states are ({given}); the first {('two', 'three')[len(axes) - 2]} must be {first}"
    if not len(set(d.states)) == len(d.states) == n:
        yield (f'n is {n}, but its states are ({given}); name each once, as in states = ("x", "y", "vx", "vy")')
    if not 1 <= m <= n:
        yield f"m is {m}; of {n} states at least 1 and at most {n} are actuated"
    yield from _faults_of_form(d)
    yield from _faults_of_arrays(d, shapes)
    yield from _faults_of_functions(d)


def _faults_of_form(d: Dynamics) -> Iterator[str]:
    """Find arrays that belong to the other form."""
    for what in ("control_block", "diffusion_block") if d.input_form else ("input_noise", "stratonovich"):
        if getattr(d, what, None) is not None and getattr(d, what) is not False:
            form, remedy = ("paper's", "out") if d.input_form else ("input", "out, or declare an input_matrix")
            yield f"{what} belongs to the {form} form; leave it {remedy}"


def _faults_of_arrays(d: Dynamics, shapes: dict[str, tuple[int, ...]]) -> Iterator[str]:
    """Find arrays whose kind, shape or determinant is wrong."""
    for what, shape in shapes.items():
        value = getattr(d, what)
        functions = what != "input_noise"

        if not isinstance(value, np.ndarray) and not (functions and callable(value)):
            kinds = "an array or a function" if functions else "an array: s is constant"
            yield f"{what} is a {type(value).__name__}; it must be {kinds}"
        if isinstance(value, np.ndarray) and value.shape != shape:
            yield f"{what} is {value.shape}; with n = {d.n}, m = {d.m} it must be {shape}"
    s = d.input_noise
    if s is not None and not (np.all(np.isfinite(s)) and abs(np.linalg.det(s)) > 0.0):
        yield f"input_noise is {s.tolist()}; it must have an inverse, so that noise acts on every input"


def _faults_of_functions(d: Dynamics) -> Iterator[str]:
    """Find functions that cannot be called, fail, or write no finite numbers."""
    n, filling = d.n, {"drift": (d.n,), "input_matrix": (d.n, d.m)}
    for what, shape in filling.items() if callable(d.input_matrix) else [("drift", (n,))]:
        function = getattr(d, what)
        filled = []

        if inspect.ismethod(function):
            yield f"{what}(x, p, out) cannot be called without self; make it a @staticmethod"
        for x in (0.0, 0.3):
            try:
                with np.errstate(all="ignore"):  # a value that is no number is reported below
                    function(np.full(n, x), d.parameters, out := np.zeros(shape))
                filled.append(out)
            except TypeError as error:
                yield f"{what}(x, p, out) cannot be called ({error}); make it a @staticmethod"
            except Exception as error:
                yield f"{what}(x, p, out) fails at x = {[x] * n} with an out of {shape} ({one_line(error)}); fix it"
        if not any(np.isfinite(out).all() for out in filled):
            yield f"{what}(x, p, out) writes {filled[-1].tolist()} at x = {[0.3] * n}; fix it"
