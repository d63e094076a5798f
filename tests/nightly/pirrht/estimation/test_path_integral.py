"""Estimates against closed forms, collocation and grids, over many seeds."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from batches import batch_of
from closed_forms import SEEDS, annulus, at_strip, disc_entry, interval_exit, straight, strip, strip_space, within
from discs import disc, scene_of
from scipy.integrate import solve_bvp
from solved import Solved, around_corner, around_post, error_of, in_channel, is_the_grids, shares
from thoroughly import first

from pirrht import Dubins, Dynamics, Estimate, FreeSpace, Outcome, Problem, Sampling, Unicycle, path_integral
from pirrht.geometry.disc import DISC
from pirrht.rollouts.cpu import kernels_for


@pytest.mark.parametrize(
    ("sides", "weights"),
    [((), "balance"), ((1,), "balance"), ((-1,), "balance"), ((1, -1), "balance"), ((1, -1), "average")],
    ids=["none", "near side", "far side", "both", "both, averaged"],
)
def test_desirability_matches_cosh_for_interval_exit_whatever_the_tapes(sides, weights):
    b, L, x = 0.5, 0.5, 0.2
    problem = strip(b, L)
    value, control = interval_exit(problem, b, L, x)
    sampling = Sampling(dt=0.05, first=0.0125, samples=20000 // max(1, len(sides)), guide="open-loop", weights=weights)
    integral = path_integral(problem, strip_space(L), sampling)
    found = [at_strip(integral, x, sides, seed) for seed in range(SEEDS)]
    values = np.array([e.value for e in found])
    assert within(values, value)
    assert values.mean() == pytest.approx(value, rel=0.01)
    assert within([e.control for e in found], [control, 0.0])


@pytest.mark.parametrize("guide", ["feedback", "open-loop"])
@pytest.mark.parametrize("b", [0.2, 0.3, 0.5])
def test_desirability_around_a_disc_is_a_ratio_of_bessel_functions(b, guide):
    sampling = Sampling(dt=0.05, first=0.025, samples=1000, guide=guide, window=0.05)
    r, radius, away = 1.2, 0.3, np.array([np.cos(0.5), np.sin(0.5)])
    problem, space = annulus(b, radius)
    x, integral = r * away, path_integral(problem, space, sampling)
    times = integral.grid(2.0 * (r - radius))
    batch = batch_of(integral, x, times, straight(x, [radius * away], times)[0], corners=[np.zeros((1, 2))])
    found = [integral.estimate(integral.rollout(batch, seed)) for seed in range(SEEDS)]
    value, speed = disc_entry(problem, b, radius, r)
    values = np.array([e.value for e in found])
    assert values.mean() == pytest.approx(value, rel=0.01)
    assert within([e.control for e in found], -speed * away)
    if guide == "open-loop":
        assert within(values, value)


def curved_rate(x, p):
    """q = p2 + p3 x^2, a plain Python function as a user would write it."""
    return p[2] + p[3] * x[0] * x[0]


def still(x, p, out):
    for i in range(out.shape[0]):
        out[i] = 0.0


def wider_gain(x, p, out):
    """G_c = (1 + p1 x^2) I."""
    s = 1.0 + p[1] * x[0] * x[0]
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = s, 0.0, 0.0, s


def wider_noise(x, p, out):
    """B_c = p0 (1 + p1 x^2) I."""
    s = p[0] * (1.0 + p[1] * x[0] * x[0])
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = s, 0.0, 0.0, s


@dataclass(frozen=True, eq=False)
class Uneven(Dynamics):
    """dx = g(x) (u dt + b dw) with g = 1 + widening x^2; the rate q = base + rise x^2 reads the same parameters."""

    b: float
    widening: float = 0.0
    base: float = 1.0
    rise: float = 0.0

    n = 2
    m = 2
    drift = staticmethod(still)
    control_block = staticmethod(wider_gain)
    diffusion_block = staticmethod(wider_noise)

    @property
    def parameters(self) -> np.ndarray:  # type: ignore[override]
        return np.array([self.b, self.widening, self.base, self.rise])

    def twist(self, x: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return rate


def two(x: np.ndarray) -> np.ndarray:
    return 2.0 * np.eye(2)


def uneven(L: float, dynamics: Uneven) -> Problem:
    return Problem(dynamics=dynamics, scene=strip_space(L).scene, R=two, q=curved_rate, q_min=dynamics.base, phi=0.0)


def strip_value(problem: Problem, L: float, dynamics: Uneven, x: float) -> tuple[float, float]:
    """v and psi'/psi of (q / lambda) psi = b^2 g^2 psi'' / 2 with psi = 1 on both sides, by collocation."""
    temperature = problem.temperature

    def slope(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        g = dynamics.b * (1.0 + dynamics.widening * s**2)
        return np.vstack([y[1], 2.0 * (dynamics.base + dynamics.rise * s**2) / (temperature * g**2) * y[0]])

    nodes = np.linspace(-L, L, 200)
    solution = solve_bvp(
        slope, lambda a, b: np.array([a[0], b[0]]) - 1, nodes, np.ones((2, 200)), tol=1e-6, max_nodes=10**5
    )
    assert solution.success
    psi, rise = solution.sol(x)
    return -temperature * np.log(psi), rise / psi


@pytest.mark.parametrize(
    "dynamics",
    first([Uneven(b=0.5, widening=2.0, rise=8.0), Uneven(b=0.5, base=0.5, rise=12.0), Uneven(b=0.5, widening=2.0)]),
    ids=["both", "rate", "blocks"],
)
def test_state_dependent_rate_and_blocks_match_collocation(dynamics):
    L, x = 0.5, 0.2
    problem = uneven(L, dynamics)
    value, slope = strip_value(problem, L, dynamics, x)
    control = problem.temperature / 2.0 * (1.0 + dynamics.widening * x * x) * slope  # lambda R^-1 G' psi' / psi
    # The rate counts as it is at the start of a step, an error of 3 % at dt = 0.02 that falls with dt: 0.75 % here.
    integral = path_integral(problem, strip_space(L), Sampling(dt=0.005, samples=3000, guide="open-loop"))
    found = [at_strip(integral, x, (1, -1), seed) for seed in range(SEEDS // 2)]
    assert np.array([e.value for e in found]).mean() == pytest.approx(value, rel=0.015)
    assert within([e.control for e in found], [control, 0.0])
    constant, _ = interval_exit(strip(0.5, L), 0.5, L, x)
    assert abs(value - constant) > 0.03 * value  # the dependence matters here


def test_kernels_over_a_users_functions_are_built_once():
    kernels = [kernels_for(uneven(0.5, Uneven(b=b)), DISC) for b in (0.3, 0.5)]
    assert kernels[0] is kernels[1]


def estimates(known: Solved, counts: tuple[int, ...], seeds: int = SEEDS, **settings: object) -> list[Estimate]:
    integral = path_integral(known.problem, known.space, Sampling(**settings))
    batch = known.batch(integral, *counts)
    return [integral.estimate(integral.rollout(batch, seed)) for seed in range(seeds)]


@pytest.mark.parametrize("settings", [{}, {"draws": "independent"}, {"guide": "open-loop"}, {"dt": 0.3}])
@pytest.mark.parametrize("counts", [(1000, 1000), (1600, 400)])
def test_psi_around_a_post_is_that_of_the_grid(settings, counts):
    known = around_post(0.5)
    if settings.get("guide") == "open-loop":
        counts = tuple(8 * n for n in counts)
    values = shares(known, estimates(known, counts, **settings))
    assert error_of(values) < 0.04
    assert is_the_grids(values)


@pytest.mark.parametrize("b", [0.3, 0.5])
def test_the_control_of_samples_that_climb_is_that_of_the_grid(b):
    """Per component within three standard errors (below 0.01 of 1.2) and 2 % of its size."""
    known = around_corner(b)
    controls = np.array([e.control for e in estimates(known, (1000,), 48, window=0.05)])
    exact = known.truth.control(known.x)
    error = controls.std(axis=0, ddof=1) / np.sqrt(len(controls))
    assert error.max() < 0.04
    assert np.all(np.abs(controls.mean(axis=0) - exact) < 3.0 * error + 0.02 * np.hypot(*exact))


def test_weighing_survival_has_the_mean_of_killing_and_scatters_less():
    """phi just below and above what makes a collision weigh nothing; 96 seeds each, of 400 samples.

    The ratio of two deviations, 0.75, has a standard error of 0.08.
    """
    values, weighed = [], []
    known = in_channel(0.5, 0.3, length=2.0, ahead=1.0)
    for phi in (0.999, 1.001):
        integral = path_integral(known.problem, known.space, Sampling())
        batch = known.batch(integral, 400)
        end = known.problem.least_rate * float(batch.times[-1])
        integral = path_integral(replace(known.problem, phi=phi * end), known.space, Sampling())
        rollouts = [integral.rollout(batch, seed) for seed in range(96)]
        weighed.append(rollouts[0].tables.weighed)
        values.append(shares(known, [integral.estimate(one) for one in rollouts]))
    killing, weighing = values
    assert weighed == [False, True]
    assert abs(killing.mean() - weighing.mean()) < 3.0 * np.hypot(error_of(killing), error_of(weighing))
    assert is_the_grids(killing)
    assert is_the_grids(weighing)
    assert weighing.std() < 0.95 * killing.std()


def test_weights_stay_finite_where_collisions_cost_a_million_lambda():
    """A unicycle before a post, its goal straight behind it, around the Dubins curves past the post."""
    ends = {"start": (0.0, 0.0), "goal": (4.0, 0.0, 0.4), "lower": (-1.0, -3.0), "side": (5.0, 3.0)}
    scene = scene_of([disc("post", 2.0, 0.0, 0.3)], **ends, radius=0.15)
    problem = Problem(dynamics=Unicycle(), scene=scene, R=np.eye(1), phi=1000.0)
    assert problem.temperature == pytest.approx(0.0009)
    assert problem.phi / problem.temperature > 1e6
    integral, steering = path_integral(problem, FreeSpace.of(scene), Sampling(samples=300)), Dubins.of(problem)
    states = np.array([[0.0, 0.0, 0.0], [2.0, 0.56, 0.0], [4.0, 0.0, -0.6]])
    path = steering.trajectory(steering.connect(states[:-1], states[1:]))
    times = integral.grid(path.cost)
    around = integral.estimate(integral.rollout(batch_of(integral, np.zeros(3), times, path.tape(times)[None]), 0))
    collided = around.rollouts.paths.outcome == Outcome.COLLISION
    assert 0 < collided.sum() < around.rollouts.size
    assert np.all(np.isfinite(around.rollouts.log_weight))
    assert np.all(np.isfinite(integral.replay.tape(around.parts)))
    assert np.all(around.weight[collided] == 0.0)
    assert around.weight.sum() == pytest.approx(1.0)
    assert 3.5 < around.value < 6.0
