"""Controlled diffusions `dx = f(x) dt + G(x) u dt + B(x) dw` with noise and control in one channel (paper eq. 1).

In the paper's partition the state is x = [x_m; x_c]: control and noise enter x_c only, through the square blocks G_c
and B_c. In the input form dx = f(x) dt + G(x) (u dt + s dw) they enter any states: B = G s. Increments in noise units
are y = a dt + dw with a = B_c^-1 G_c u, or a = s^-1 u.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.checks import checked_state
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import inlined, jitable


class HomingTuning(NamedTuple):
    """Numbers of the controls by which samples home that outlive their proposal."""

    aim: float = 0.9  # share of the goal's radius that is aimed at: the rim itself is missed under noise
    # Turn rate per heading error, and acceleration per error of the speed [1/s]: faster than noise turns robots.
    gain: float = 3.0
    narrow: float = 3.0  # a rover drives where the disc lies less than pi / 2 over this aside, or it would circle it
    rover_turn: float = 1.5  # a rover's turn rate at most, in those that the rate of cost asks for
    steepest: float = 6.0  # a car's turn rate at most, in turn rates whose noise costs as much as time
    slowest: float = 0.2  # share of the cruising speed at which a car with inertia turns


HOMING = HomingTuning()


@inlined
def wrapped(angle):  # type: ignore[no-untyped-def]
    """Wrap an angle to within half a turn of zero [rad]."""
    if -math.pi <= angle < math.pi:  # as nearly all are: a division waits longer than this asks
        return angle
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@inlined
def beyond_disc(dx, dy, theta, radius):  # type: ignore[no-untyped-def]
    """Angle to turn until a disc (dx, dy) [m] away lies ahead of a heading; 0 if it does [rad]."""
    off = wrapped(math.atan2(dy, dx) - theta)
    within = math.asin(min(1.0, HOMING.aim * radius / math.sqrt(dx * dx + dy * dy + 1e-12)))
    return max(0.0, off - within) + min(0.0, off + within)


def ahead(x: Array, place: Array) -> float:
    """Distance [m] along the heading from a state that begins with x, y [m] and heading [rad] to a place (2,)."""
    return math.cos(x[2]) * float(place[0] - x[0]) + math.sin(x[2]) * float(place[1] - x[1])


@jitable
def no_homing(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Write no control to out (m,) [1/sqrt(s)]: samples that outlive their proposal are left to themselves."""
    for j in range(out.shape[0]):
        out[j] = 0.0


class Dynamics:
    """A system whose first two states are the position [m], or three in space.

    `drift`, `control_block` and `diffusion_block` are numeric functions `(x, p, out) -> None` that fill `out` and
    compile with numba; `p` is `parameters`. Blocks may be arrays instead: then they are constant. Instead of both
    blocks a system may declare `input_matrix` and `input_noise`. `states` names the components: "x" and "y" [m] first,
    then "heading" [rad], "vx", "vy", "speed" [m/s], "t" [s] or whatever else the system has. In space "z" is the third,
    and `position` has three indices.
    """

    n: int  # states
    m: int  # controls; in the paper's partition the last m states are the actuated ones
    states: tuple[str, ...] = ("x", "y")  # (n,) what the components of a state are
    parameters: Array  # (k,) numbers the functions read
    drift: Callable[..., None]  # f, out (n,) [state/s]
    control_block: Array | Callable[..., None]  # G_c, (m, m) [state/s per control]
    diffusion_block: Array | Callable[..., None]  # B_c, (m, m) [state/sqrt(s)]
    input_matrix: Array | Callable[..., None] | None = None  # G, (n, m) [state/s per control]
    input_noise: Array | None = None  # s, (m, m) [control sqrt(s)], with an inverse
    # Whether the equation is Stratonovich's, whose steps take f and G half-way, or Ito's. Both are one where no column
    # of B = G s changes along itself, as noise along a heading does not.
    stratonovich: bool = False
    # Optional: what the control is, apart from a drift, for steering methods that suit any such system: a "velocity"
    # (`InTime`), an "acceleration" (`MassSteering`), or the "turn rate" of a car at constant speed V [m/s] that turns
    # with a radius of V rho [m] at least (`Dubins`).
    control_kind: str = ""
    position: tuple[int, ...] = (0, 1)  # indices of the states that are the position
    # Optional: what samples do that outlive their guide, (x, p, B, aim, radius, rate, out) -> None, compiled by numba:
    # the control towards the goal's disc at aim (x, y) [m] as a = B_c^-1 G_c u, out (m,) [1/sqrt(s)]; rate is q/lambda.
    homing: Callable[..., None] = staticmethod(no_homing)

    def twist(self, x: Array, rate: Array) -> Array:
        """Velocity command (2,) of the robot at x (n,) for rates (m,) of x_c, or of the inputs in input form.

        OptionError: the system declares none, so that only its equation can be simulated.
        """
        raise OptionError(
            f"{type(self).__name__} declares no twist(x, rate), the command that a simulated robot takes; add it, or "
            "simulate the equation alone"
        )

    def brake(self, x: Array, place: Array, within: float) -> Array | None:
        """Control (m,) at x (n,) to come to rest at a place (2,) [m], within a time constant [s]; None: it cannot."""
        return None

    @property
    def input_form(self) -> bool:
        """Tell whether noise enters through the inputs of an `input_matrix`, not through the paper's square blocks."""
        return self.input_matrix is not None

    @property
    def rows(self) -> int:
        """Number of last states that control and noise may enter: m in the paper's partition, n in input form."""
        return self.n if self.input_form else self.m

    @property
    def constant(self) -> bool:
        """Tell whether neither G nor B depends on the state; then both are arrays (rows, m)."""
        blocks = (self.input_matrix,) if self.input_form else (self.control_block, self.diffusion_block)
        return all(isinstance(block, np.ndarray) for block in blocks)

    @cached_property
    def noisy_position(self) -> bool:
        """Tell whether noise acts on the position itself: then exits need a Brownian bridge, else a sweep."""
        return any(self.position_noise(x).any() for x in self._some_states())

    @cached_property
    def isotropic_point(self) -> bool:
        """Tell whether it is a point without drift whose noise is isotropic, by probing some states."""
        if not self.n == self.m == len(self.position):
            return False
        noise = [self.B_c(x) @ self.B_c(x).T for x in self._some_states()]
        return not any(np.any(self.f(x)) for x in self._some_states()) and all(
            np.allclose(one, one[0, 0] * np.eye(self.n), rtol=1e-9, atol=1e-12 * one[0, 0]) for one in noise
        )

    def _some_states(self) -> Array:
        """Spread five states (5, n) at which noise and drift are probed."""
        return np.asarray(2.0 * np.pi * (np.arange(1, 6)[:, None] * np.sqrt(2.0 + np.arange(self.n)) % 1.0 - 0.5))

    @cached_property
    def heading(self) -> int | None:
        """Index of the state that is the robot's heading [rad]; None: it has none."""
        return next(iter(self.angles), None)

    @cached_property
    def angles(self) -> tuple[int, ...]:
        """Indices of the headings [rad] in a state (n,)."""
        return tuple(i for i, name in enumerate(self.states) if name == "heading")

    def difference(self, x: Array, y: Array) -> Array:
        """x - y of states (..., n), headings from -pi to pi [rad], (..., n)."""
        off: Array = x - y
        for i in self.angles:
            off[..., i] = (off[..., i] + np.pi) % (2.0 * np.pi) - np.pi
        return off

    def checked(self, x: Any, *, many: bool = False) -> Array:
        """Return a state (n,), or perhaps `many` (k, n), as numbers; OptionError: it is none of this system."""
        return checked_state(x, self.n, f"{type(self).__name__} ({', '.join(self.states)})", many=many)

    def state_of(self, pose: Array) -> Array:
        """Return the state (n,) at x, y [m] and heading [rad] (3,); its other components are zero."""
        x = np.zeros(self.n)
        x[list(self.position)] = pose[: len(self.position)]
        x[list(self.angles)] = pose[-1]

        return x

    def box(self, scene: Scene) -> tuple[Array, Array]:
        """Least and greatest state, 2 x (n,), to probe between: workspace [m], headings [rad], -1 to 1 else."""
        upper = np.ones(self.n)
        upper[list(self.angles)] = np.pi
        lower = -upper
        lower[list(self.position)], upper[list(self.position)] = scene.lower, scene.upper
        return lower, upper

    def f(self, x: Array) -> Array:
        """Passive drift at x (n,), (n,) [state/s]."""
        self.drift(x, self.parameters, out := np.zeros(self.n))
        return out

    def G_c(self, x: Array) -> Array:
        """Rows of G at x (n,) that are not zero for good, (rows, m) [state/s per control]."""
        return self._block(self.control_block if self.input_matrix is None else self.input_matrix, x)

    def B_c(self, x: Array) -> Array:
        """Rows of B at x (n,) that are not zero for good, (rows, m) [state/sqrt(s)]."""
        if self.input_noise is None:
            return self._block(self.diffusion_block, x)
        return np.asarray(self.G_c(x) @ self.input_noise)

    def position_spread(self, x: Array) -> float:
        """Deviation that noise gives the position at x (n,) in its worst direction [m/sqrt(s)]."""
        B = self.position_noise(x)
        return float(np.sqrt(np.linalg.eigvalsh(B @ B.T).max(initial=0.0)))

    def position_noise(self, x: Array) -> Array:
        """Rows of B at x (n,) that act on the position, (k, m) [m/sqrt(s)], none to all of it."""
        fixed = self.n - self.rows
        return self.B_c(x)[[i - fixed for i in self.position if i >= fixed]]

    def heading_spread(self, x: Array) -> float:
        """Deviation that noise gives the heading at x (n,) [rad/sqrt(s)]; 0 without a heading."""
        return float(np.hypot.reduce(self.whole(self.B_c(x))[list(self.angles[:1])].ravel(), initial=0.0))

    def whole(self, block: Array) -> Array:
        """Return the rows (n, m) of all states of a block of the last ones (rows, m); others are zero."""
        return np.vstack([np.zeros((self.n - len(block), block.shape[1])), block])

    def place(self, x: Array) -> Array:
        """Take the position of states (..., n), (..., 2) [m]."""
        return x[..., list(self.position)]

    def reads(self, turns: bool) -> tuple[int, ...]:
        """Return indices of the states that are the position, and if it `turns` the heading, where there is one."""
        return self.position + ((self.heading,) if turns and self.heading is not None else ())

    def noise_form(self, x: Array) -> tuple[Array, Array]:
        """Matrices (m, m) by which a control u and noise enter together: G_c and B_c, in input form I and s."""
        return (self.G_c(x), self.B_c(x)) if self.input_noise is None else (np.eye(self.m), self.input_noise)

    def noise_gain(self, x: Array) -> Array:
        """D (m, m) of a = D u, the control u in noise units at x (n,) [1/sqrt(s) per control]."""
        G, B = self.noise_form(x)
        return np.asarray(np.linalg.solve(B, G))

    def control_gain(self, x: Array) -> Array:
        """Inverse of `noise_gain` at x (n,), (m, m) [control sqrt(s)]."""
        return np.asarray(np.linalg.solve(*self.noise_form(x)))

    def to_noise(self, x: Array, u: Array) -> Array:
        """Controls u (..., m) at x (n,) in noise units, a (..., m) [1/sqrt(s)]."""
        G, B = self.noise_form(x)
        return np.asarray(np.linalg.solve(B, G @ np.asarray(u)[..., None])[..., 0])

    def input_of(self, x: Array, a: Array) -> Array:
        """The control u (m,) at x (n,) of one in noise units (m,) [1/sqrt(s)]."""
        return self.control_gain(x) @ a

    def inputs_of(self, states: Array, a: Array) -> Array:
        """Controls u (k, m) at states (k, n) of those in noise units (k, m) [1/sqrt(s)]."""
        if self.constant or self.input_form:
            return a @ self.control_gain(np.zeros(self.n)).T
        return np.array([self.input_of(*pair) for pair in zip(states, a, strict=True)]).reshape(a.shape)

    def idle(self, x: Array) -> Array:
        """`rate` at x (n,) without control and noise, (m,) [state/s]: f_c, or in input form nothing."""
        return np.zeros(self.m) if self.input_form else self.f(x)[self.n - self.m :]

    def rate(self, x: Array, u: Array, dw: Array, dt: float) -> Array:
        """Rates (m,) of x_c, or in input form of the inputs, at x (n,) for u (m,) and noise dw (m,) over dt [s]."""
        if self.input_noise is not None:
            return np.asarray(u + self.input_noise @ dw / dt)
        return np.asarray(self.f(x)[self.n - self.m :] + self.G_c(x) @ u + self.B_c(x) @ dw / dt)

    def step(self, x: Array, u: Array, dw: Array, dt: float) -> Array:
        """Take one Euler-Maruyama step of dt [s] from x (n,) under u (m,) and an increment dw (m,) [sqrt(s)], (n,)."""
        rate = self.rate(x, u, dw, dt)
        if not self.input_form:
            return np.asarray(x + dt * np.append(self.f(x)[: self.n - self.m], rate))
        middle = x + 0.5 * dt * (self.f(x) + self.G_c(x) @ rate) if self.stratonovich else x
        return np.asarray(x + dt * (self.f(middle) + self.G_c(middle) @ rate))

    def _block(self, block: Array | Callable[..., None], x: Array) -> Array:
        if isinstance(block, np.ndarray):
            return block
        block(x, self.parameters, out := np.zeros((self.rows, self.m)))
        return out


@jitable
def no_drift(x, p, out):  # type: ignore[no-untyped-def]
    """f = 0 at x (n,), written to out (n,) [state/s]."""
    for i in range(out.shape[0]):
        out[i] = 0.0


def check_positive(owner: object, *names: str) -> None:
    """Refuse attributes that are no positive numbers by an OptionError."""
    for name in names:
        value = getattr(owner, name)
        if not (np.isfinite(value) and value > 0):
            raise OptionError(f"{name} is {value:g}; it must be a positive number")


@dataclass(frozen=True, eq=False)
class IsotropicNoise(Dynamics):
    """A system whose controls and isotropic noise act on actuated states: G_c = I, B_c = b I; OptionError: b <= 0."""

    b: float = 0.1  # noise [1/sqrt(s) of the actuated states]

    parameters = np.zeros(0)

    def __post_init__(self) -> None:
        check_positive(self, "b")

    @cached_property
    def control_block(self) -> Array:  # type: ignore[override]
        """G_c = I, (m, m)."""
        return np.eye(self.m)

    @cached_property
    def diffusion_block(self) -> Array:  # type: ignore[override]
        """B_c = b I, (m, m)."""
        return self.b * np.eye(self.m)
