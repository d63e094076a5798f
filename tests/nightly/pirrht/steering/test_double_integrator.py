"""The double integrator's two-point optimum, its cubic paths, and trees of them."""

import math

import numpy as np
import pytest
from discs import scattered
from trees import grown

from pirrht import FreeSpace, OptionError, Problem, SingleIntegrator
from pirrht.steering.double_integrator import Cubics, MassSteering, optimum
from pirrht.systems.double_integrator import DoubleIntegrator

MASS = MassSteering(q=1.0, r=2.0, top=2.0)


def coefficients(tail: np.ndarray, head: np.ndarray, r: float) -> tuple[float, float, float]:
    """A, B, C of J(T) = q T + A / T^3 + B / T^2 + C / T, from next to nothing but the closed forms."""
    gap, before, after = head[:2] - tail[:2], tail[2:], head[2:]
    if np.isnan(after[0]):
        return 1.5 * r * gap @ gap, -3.0 * r * gap @ before, 1.5 * r * before @ before
    shared = before @ before + before @ after + after @ after
    return 6.0 * r * gap @ gap, -6.0 * r * gap @ (before + after), 2.0 * r * shared


def states_at(motions: Cubics, i: int, s: np.ndarray) -> np.ndarray:
    """States (l, 4) that motion i passes at times s (l,) [s]."""
    place, speed, force, jerk = motions.path[i].reshape(4, 1, 2)
    s = s[:, None]
    return np.hstack([place + s * (speed + s * (force / 2 + s * jerk / 6)), speed + s * (force + s * jerk / 2)])


@pytest.mark.parametrize("free", [False, True])
def test_the_duration_is_the_best_of_all_roots_of_the_quartic(free: bool):
    """2000 random pairs at scales from 0.1 to 3 against NumPy's roots; some have two minima."""
    rng, twice = np.random.default_rng(5), 0
    for _ in range(2000):
        tail, head = (rng.normal(size=4) * rng.choice([0.1, 1.0, 3.0]) for _ in range(2))
        if free:
            head[2:] = np.nan
        q, r = rng.uniform(0.2, 3.0, 2)
        A, B, C = coefficients(tail, head, r)
        roots = np.roots([q, 0.0, -C, -2.0 * B, -3.0 * A])
        real = roots[(np.abs(roots.imag) < 1e-7 * np.abs(roots)) & (roots.real > 0)].real
        costs = q * real + A / real**3 + B / real**2 + C / real
        twice += len(real) > 1
        T, cost = optimum(tuple(tail), tuple(head), q, r)
        assert cost == pytest.approx(costs.min(), rel=1e-9)
        assert cost == pytest.approx(q * T + A / T**3 + B / T**2 + C / T, rel=1e-9)
    assert twice > 20


def test_motions_end_where_they_should_and_cost_the_integral_of_their_acceleration():
    rng = np.random.default_rng(0)
    tails, heads = rng.normal(size=(50, 4)), rng.normal(size=(50, 4))
    motions = MASS.connect(tails, heads)
    for i in range(50):
        s = np.linspace(0.0, motions.duration[i], 4001)
        states = states_at(motions, i, s)
        assert states[[0, -1]] == pytest.approx(np.array([tails[i], heads[i]]), abs=1e-9)
        rate = 1.0 + np.sum(np.gradient(states[:, 2:], s, axis=0, edge_order=2) ** 2, axis=1)
        assert motions.cost[i] == pytest.approx(np.trapezoid(rate, s), rel=1e-5)
        assert motions.length()[i] == pytest.approx(np.hypot(*np.diff(states[:, :2], axis=0).T).sum(), rel=3e-3)


def test_a_tree_of_masses_finds_the_classes_of_points_and_pulls_their_paths_taut():
    space = FreeSpace.of(scattered(2))
    problem = Problem(dynamics=DoubleIntegrator(b=0.1), scene=space.scene, R=2.0 * np.eye(2))
    tree = grown(space, MassSteering.of(problem), 600)
    x = np.array([*space.scene.start[:2], 0.0, 0.0])
    rough = {reference.winding: reference for reference in tree.references(x, shortened=False)}
    for reference in tree.references(x):
        points = reference.trajectory.points
        assert space.collision.clearance(points).min() > -1e-3
        assert space.homology.winding(points) == reference.winding
        assert reference.cost <= rough[reference.winding].cost * (1.0 + 1e-9)
        tape = reference.trajectory
        p, v = x[:2].copy(), x[2:].copy()
        for u, dt in zip(tape.controls, tape.durations, strict=True):
            p, v = p + v * dt + 0.5 * u * dt**2, v + u * dt
        assert math.dist(p, points[-1]) < 0.02
    assert len(rough) >= 2


def test_what_cubic_motions_cannot_steer_is_refused():
    scene = scattered(0)
    with pytest.raises(OptionError, match="steer a DoubleIntegrator, not SingleIntegrator"):
        MassSteering.of(Problem(dynamics=SingleIntegrator(), scene=scene, R=2.0 * np.eye(2)))
    with pytest.raises(OptionError, match="top is 0"):
        MassSteering(top=0.0)
