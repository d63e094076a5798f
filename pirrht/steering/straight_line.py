"""Connect points by straight lines: the optimum without inertia, and references of systems that have no steering.

The tree of such a system is that of a point which moves straight at a pace; its vertices are positions, whatever else a
state has. Costs are the point's, so classes are ordered by length. Proposals alone find the system's own optimum: they
track a reference first, from the system's state, and then save where the true cost allows.
"""

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.arcs import Curves
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import inlined, kernel
from pirrht.problem import Problem
from pirrht.steering.steering import CompiledSteering
from pirrht.steering.tuning import TUNING
from pirrht.traits import Traits


@inlined
def _cost(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
    dx = head[0] - tail[0]
    dy = head[1] - tail[1]

    return math.sqrt(dx * dx + dy * dy) * numbers[0]


@kernel
def connect_lines(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair by one straight piece; the number is the cost per meter."""
    k = tails.shape[0]
    found = Curves(np.empty((k, 3)), np.zeros((k, 1)), np.empty((k, 1)), np.empty(k), tails, heads)
    for i in range(k):
        dx = heads[i, 0] - tails[i, 0]
        dy = heads[i, 1] - tails[i, 1]

        found.start[i] = (tails[i, 0], tails[i, 1], math.atan2(dy, dx))
        found.length[i, 0] = math.hypot(dx, dy)
        found.cost[i] = found.length[i, 0] * numbers[0]
    return found


class Lines(CompiledSteering):
    """A steering method whose vertices are positions (2,) [m], joined by straight lines at one speed."""

    n = 2
    symmetric = True
    cost = _cost
    optimum = connect_lines
    pace: float  # the speed [m/s]
    cost_per_meter: float  # [cost/m]

    numbers = property(lambda self: (self.cost_per_meter,), doc="The cost per meter [cost/m].")
    speed = property(lambda self: self.pace, doc="The constant pace [m/s].")

    def controls(self, heading: Array, curvature: Array) -> Array:
        """Velocity (l, 2) [m/s] along the heading (l,) [rad]; straight lines have no curvature."""
        return self.pace * np.column_stack([np.cos(heading), np.sin(heading)])

    def roots(self, goal: Array) -> Array:
        """Return the goal point (2,) [m] itself, (1, 2)."""
        return goal[None, :].astype(float)

    def states_along(self, path: Array, scene: Scene) -> Array:
        """Return the points (k, 2) [m] of a path (k, 3)."""
        return np.ascontiguousarray(path[:, :2])

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """Draw a point (2,) [m], uniform in the workspace."""
        return np.asarray(scene.lower + (scene.upper - scene.lower) * rng.random(2))


@dataclass(frozen=True, slots=True, kw_only=True)
class StraightLine(Lines):
    """The single integrator's optimum: a straight line at the speed that balances q against u'Ru/2."""

    pace: float = 1.0  # speed [m/s]
    cost_rate: float = 2.0  # q + u'Ru/2 at that speed [cost/s]

    @classmethod
    def of(cls, problem: Problem) -> "StraightLine":
        """Take a point's line for q constant and R a multiple of I (q = 1, R = 2I: speed 1); else OptionError."""
        d = problem.dynamics
        if not Traits.of(problem).point:
            turns = not problem.scene.footprint.is_disc
            instead = "TrackedInSpace" if len(d.position) == 3 else "TurnAndGo" if turns else "Tracked"
            raise OptionError(
                f"straight lines steer a point whose states are its position, all actuated, not {type(d).__name__} "
                f"with n = {d.n} and m = {d.m}; take {instead}.of(problem), or bring a Steering"
            )
        R = problem.control_cost(np.zeros(problem.dynamics.n))
        if not np.allclose(R, R[0, 0] * np.eye(len(R))):
            raise OptionError("straight lines are optimal only for R a multiple of the identity; bring a Steering")
        return cls(pace=float(np.sqrt(2.0 * problem.least_rate / R[0, 0])), cost_rate=2.0 * problem.least_rate)

    cost_per_meter = property(lambda self: self.cost_rate / self.pace, doc="Cost rate over speed [cost/m].")


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracked(Lines):
    """Straight lines at one pace between positions, for systems that move otherwise."""

    pace: float  # speed [m/s]
    cost_per_meter: float  # of it [cost/m]
    slack: float  # time that getting under way, or turning about, may take [s]
    m: int  # controls of the system
    position: tuple[int, ...] = (0, 1)  # indices of its states that are the position

    drives = False

    @classmethod
    def of(cls, problem: Problem, pace: float | None = None) -> "Tracked":
        """Take lines for any problem at a pace [m/s]; None: that at which the problem's cost per meter is least.

        OptionError: the pace is not positive, or the cost tells none.
        """
        d, x = problem.dynamics, problem.dynamics.state_of(problem.scene.start)
        # G R^-1 G', (n, n): what states yield to a control of a given cost
        G = d.whole(d.G_c(x))
        yields = np.asarray(G @ np.linalg.solve(problem.control_cost(x), G.T))
        mobilities = np.linalg.eigvalsh(
            yields[np.ix_(d.position, d.position)]
        )  # of the position, by direction, least first
        actuated = [float(part) for part in mobilities if part > max(0.0, 1e-9 * float(mobilities[-1]))]
        if pace is None:  # in the direction in which positions yield least, of those in which they do
            pace = math.sqrt(2.0 * problem.least_rate * actuated[0]) if actuated else _pace_of(problem)
        if not (np.isfinite(pace) and pace > 0):
            raise OptionError(f"the pace of references is {pace:g}; it must be a positive number [m/s]")
        moving = _moving(problem, pace)
        rate = max(problem.rate(x if moving is None else moving), problem.least_rate)
        rate = 2.0 * rate if actuated else rate  # at the best speed control costs as much as time does
        # Time to turn about or to get up to the pace under a control that costs what time does.
        strength = np.sqrt(2.0 * problem.least_rate * np.diag(yields))
        change = [math.pi if i in d.angles else pace for i in range(d.n)]
        slack = max(
            (change[i] / strength[i] for i in range(d.n) if i not in d.position and strength[i] > 0), default=0.0
        )
        return cls(pace=pace, cost_per_meter=rate / pace, slack=float(slack), m=d.m, position=d.position)

    def vertex_of(self, x: Array) -> Array:
        """The position (..., 2) [m] of a state (..., n)."""
        return np.ascontiguousarray(x[..., list(self.position)])


def _pace_of(problem: Problem) -> float:
    """Find the only speed of a system whose positions are not actuated, or that where q per meter is least [m/s].

    OptionError: the cost tells none.
    """
    d = problem.dynamics
    lower, upper = d.box(problem.scene)
    fractions = (np.arange(1, d.n + 1) * 0.7548776662 + np.arange(TUNING.probed_states)[:, None] * 0.5698402910) % 1.0
    speeds = [math.hypot(*d.place(d.f(lower + fraction * (upper - lower)))) for fraction in fractions]
    if max(speeds) > 0 and np.ptp(speeds) < 1e-6 * max(speeds):
        return speeds[0]
    if callable(problem.q) and _moving(problem, 1.0) is not None:
        probed = np.geomspace(*TUNING.probed_speeds)
        costs = np.array([problem.rate(_moving(problem, v)) for v in probed]) / probed  # type: ignore[arg-type]
        best = int(np.argmin(costs))
        if 0 < best < len(probed) - 1:
            return float(probed[best])
    raise OptionError(
        f"the cost of {type(d).__name__} does not tell how fast its references should be; give a pace [m/s], as in "
        "of(problem, pace=1.0), or System(..., pace=1.0) of the simulator"
    )


def _moving(problem: Problem, speed: float) -> Array | None:
    """Start state at a speed [m/s], (n,); None if the states have none."""
    d = problem.dynamics
    for name in ("speed", "vx"):
        if name in d.states:
            x = d.state_of(problem.scene.start)
            x[d.states.index(name)] = speed
            return x
    return None


def velocity_at(problem: Problem, speed: float) -> float:
    """Return how fast a system moves along its heading that is to move at a speed, either sign [m/s]."""
    d = problem.dynamics
    x = _moving(problem, speed)
    start = d.state_of(problem.scene.start)
    if x is None:
        return speed if d.whole(d.G_c(start))[list(d.position)].any() else float(np.hypot(*d.place(d.f(start))))
    heading = x[d.angles[0]]
    return float(d.place(d.f(x)) @ np.array([math.cos(heading), math.sin(heading)]))
