"""Dubins curves: shortest, exact, and wound around markers as fine polylines are."""

import numpy as np
import pytest
from discs import scene_of
from windings_by_angle import turns_of_curve

from pirrht import Dubins, FreeSpace, Unicycle
from pirrht.geometry.arcs import TWO_PI, Curves, along

CAR = Dubins(V=1.5, rho=0.8)
R = CAR.radius


def pairs(count: int, seed: int, span: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    rng, high = np.random.default_rng(seed), np.array([span, span, np.pi])
    return rng.uniform(-high, high, (count, 3)), rng.uniform(-high, high, (count, 3))


def near_degenerate(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Headings on a grid, gaps that make circles touch, coincide or nearly so."""
    rng = np.random.default_rng(seed)
    tails = np.zeros((count, 3))
    tails[:, 2] = rng.integers(-4, 5, count) * np.pi / 4
    gap = rng.choice([0.0, 1e-7, 1e-3, 1.0, 2.0, 4.0, np.sqrt(8.0)], count) * R
    bearing = rng.integers(-4, 5, count) * np.pi / 4
    heads = np.column_stack([gap * np.cos(bearing), gap * np.sin(bearing), rng.integers(-4, 5, count) * np.pi / 4])
    heads[:, :2] *= 1.0 + rng.choice([0.0, 1e-9, -1e-9, 1e-5], count)[:, None]
    return tails, heads


def ends(curves: Curves) -> np.ndarray:
    x, y, theta = curves.start.T.copy()
    for kappa, length in zip(curves.curvature.T, curves.length.T, strict=True):
        end = theta + kappa * length
        safe = np.where(kappa == 0, 1.0, kappa)
        x = np.where(kappa == 0, x + length * np.cos(theta), x + (np.sin(end) - np.sin(theta)) / safe)
        y = np.where(kappa == 0, y + length * np.sin(theta), y - (np.cos(end) - np.cos(theta)) / safe)
        theta = end
    return np.column_stack([x, y, theta])


def wrapped(angle: np.ndarray) -> np.ndarray:
    return np.angle(np.exp(1j * angle))


def brute_force(tails: np.ndarray, heads: np.ndarray, eps: float) -> np.ndarray:
    """Least length over all words, in complex numbers; a word that is within `eps` of existing counts."""

    def turn(angle: np.ndarray) -> np.ndarray:
        angle = np.mod(angle, TWO_PI)
        return np.where(angle > TWO_PI - eps, 0.0, angle)

    z, w = tails[:, 0] + 1j * tails[:, 1], heads[:, 0] + 1j * heads[:, 1]
    a, b = tails[:, 2], heads[:, 2]
    best = np.full(len(z), np.inf)
    for s, e in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
        line = (w + e * 1j * R * np.exp(1j * b) - z - s * 1j * R * np.exp(1j * a)) / R  # between the centres
        span = np.abs(line)
        # CSC: seen along the straight piece, the line of centres is p + i (e - s).
        p = np.sqrt(np.maximum(span**2 - (e - s) ** 2, 0.0))
        psi = np.where(span < eps, a, np.angle(line * (p - 1j * (e - s))))
        length = turn(s * (psi - a)) + p + turn(e * (b - psi))
        best = np.where(span**2 - (e - s) ** 2 >= -eps, np.minimum(best, length), best)
        # CCC: a middle circle touches both, on either side of the line of centres.
        for side in (1, -1) if s == e else ():
            axis = np.where(span > eps, line / np.maximum(span, 1e-300), 1.0)
            arm = line / 2 + side * 2j * np.sqrt(np.maximum(1.0 - (span / 4) ** 2, 0.0)) * axis
            enter, leave = np.angle(arm * s * 1j), np.angle((arm - line) * s * 1j)
            length = turn(s * (enter - a)) + turn(s * (enter - leave)) + turn(s * (b - leave))
            best = np.where(span <= 4.0, np.minimum(best, length), best)
    return best * R


@pytest.mark.parametrize("sample", [pairs(100_000, 1), pairs(20_000, 2, span=1.5), near_degenerate(20_000, 3)])
def test_distance_is_the_least_over_all_words(sample: tuple[np.ndarray, np.ndarray]) -> None:
    tails, heads = sample
    length = CAR.distance(tails, heads) * CAR.V
    # The length jumps where a word ceases to exist; away from the jumps the two bounds are equal.
    least, most = brute_force(tails, heads, 1e-6), brute_force(tails, heads, 1e-13)
    assert np.all(length <= most + 1e-8)
    assert np.all(length >= least - 1e-5)
    assert np.mean(most - least < 1e-8) > 0.6
    np.testing.assert_allclose(length, np.where(most - least < 1e-8, most, length), rtol=0, atol=1e-8)


@pytest.mark.parametrize("sample", [pairs(100_000, 4), pairs(20_000, 5, span=1.0), near_degenerate(20_000, 6)])
def test_curves_reach_their_heads_at_the_stated_cost(sample: tuple[np.ndarray, np.ndarray]) -> None:
    tails, heads = sample
    curves = CAR.connect(tails, heads)
    gap = ends(curves) - heads
    assert np.abs(gap[:, :2]).max() < 1e-8
    assert np.abs(wrapped(gap[:, 2])).max() < 1e-8
    assert np.all(curves.length >= 0)
    assert np.all(np.abs(curves.curvature) * R <= 1 + 1e-12)
    np.testing.assert_allclose(curves.cost, CAR.distance(tails, heads), rtol=1e-14)
    np.testing.assert_allclose(curves.cost, curves.length.sum(axis=1) / CAR.V)


@pytest.mark.parametrize("sample", [pairs(50_000, 7), near_degenerate(20_000, 8)])
def test_distance_is_an_asymmetric_metric(sample: tuple[np.ndarray, np.ndarray]) -> None:
    tails, heads = sample
    between = pairs(len(tails), 9)[0]
    length = CAR.distance(tails, heads) * CAR.V
    assert np.all(length >= np.hypot(*(heads - tails)[:, :2].T) - 1e-9)
    assert np.all(length >= np.abs(wrapped(heads[:, 2] - tails[:, 2])) * R - 1e-9)
    assert np.all(length <= ((CAR.distance(tails, between) + CAR.distance(between, heads)) * CAR.V) + 1e-8)
    assert CAR.distance(tails, tails).max() == 0.0
    reverse = np.array([0.0, 0.0, np.pi])
    np.testing.assert_allclose(CAR.distance(heads + reverse, tails + reverse) * CAR.V, length, atol=1e-7)


def test_the_tape_drives_the_unicycle_to_the_head() -> None:
    car, dt = Unicycle(V=CAR.V, rho=CAR.rho), 1e-3
    for tail, head in zip(*pairs(6, 11), strict=True):
        path = CAR.trajectory(CAR.connect(tail, head))
        assert np.abs(path.controls).max() <= 1.0
        times = np.linspace(0.0, path.cost, int(np.ceil(path.cost / dt)) + 1)
        x = tail.copy()
        for u in path.tape(times):
            x = car.step(x, u, np.zeros(1), times[1])
        assert np.hypot(*(x - head)[:2]) < 5 * dt * CAR.V
        assert abs(wrapped(x[2:] - head[2:])[0]) < 2 * dt / CAR.rho
        assert np.hypot(*(path.points[-1] - head[:2])) < 1e-8


@pytest.mark.parametrize("circles", [1.0, 2.0, 5.0, 1.0 - 1e-12, 1.0 + 1e-12])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_closed_circles_wind_once_each(circles: float, sign: float) -> None:
    rng = np.random.default_rng(14)
    for theta in rng.uniform(-np.pi, np.pi, 50):
        start = np.array([0.3, -0.2, theta])
        center = start[:2] + sign * R * np.array([-np.sin(theta), np.cos(theta)])
        angle = rng.uniform(-np.pi, np.pi, 8)
        ring, out = np.column_stack([np.cos(angle), np.sin(angle)]), np.empty(16)
        markers = np.vstack([center + 0.999 * R * ring, center + 1.001 * R * ring])
        turns_of_curve(start, np.array([sign / R]), np.array([circles * TWO_PI * R]), markers, out)
        np.testing.assert_allclose(out[:8], sign * np.rint(circles), atol=1e-8)
        np.testing.assert_allclose(out[8:], 0.0, atol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_polishing_finds_the_optimum_where_nothing_is_in_the_way(seed: int) -> None:
    """Turn towards the goal point and go straight: nothing shorter reaches the disc."""
    space = FreeSpace.of(scene_of(start=(1.0, 1.0), goal=(8.0, 8.0, 0.3), side=9.0))
    goal = space.scene.goal
    states = np.vstack([np.random.default_rng(seed).uniform([3, 3, -3], [5, 5, 3], (4, 3)), [*goal.center, 1.0]])
    checker = CAR.checker(space)
    path = checker.until_goal(CAR.connect(states[:-1], states[1:]))
    aims = np.linspace(-np.pi, np.pi, 2001)[:, None]
    rim = np.hstack([goal.center - goal.radius * np.hstack([np.cos(aims), np.sin(aims)]), aims])
    best = CAR.distance(states[0], rim).min() * CAR.V
    short = CAR.shorten(path, checker).length.sum()
    assert path.length.sum() > 1.2 * best
    assert best - 1e-5 <= short <= best * (1.0 + 1e-3)


def fine(start: np.ndarray, curvature: np.ndarray, length: np.ndarray, spacing: float) -> np.ndarray:
    points, pose = [start[:2]], tuple(start)
    for kappa, total in zip(curvature, length, strict=True):
        steps = int(np.ceil(total / spacing))
        points += [np.array(along(*pose, kappa, total * i / steps)[:2]) for i in range(1, steps + 1)]
        pose = along(*pose, kappa, total)
    return np.array(points)


def test_signatures_of_turning_curves_equal_those_of_fine_polylines() -> None:
    rng = np.random.default_rng(12)
    tails, heads = pairs(30, 13, span=3.0)
    curves = CAR.connect(tails, heads)
    for i in range(30):
        line = fine(curves.start[i], curves.curvature[i], curves.length[i], 2e-3)
        middle = line[rng.integers(len(line), size=12)]
        markers = np.vstack([rng.uniform(-4, 4, (20, 2)), middle + rng.normal(0, 0.05, (12, 2))])
        markers = markers[np.array([np.hypot(*(line - m).T).min() for m in markers]) > 4e-3]
        seen = np.unwrap(np.arctan2(*(line[:, None] - markers).transpose(2, 0, 1)[::-1]), axis=0)
        # The paper's contour integral, by the midpoint rule.
        offset = 0.5 * (line[1:] + line[:-1])[:, None] - markers
        step = np.diff(line, axis=0)[:, None]
        integrand = (offset[..., 0] * step[..., 1] - offset[..., 1] * step[..., 0]) / (offset**2).sum(axis=-1)
        out = np.empty(len(markers))
        turns_of_curve(curves.start[i], curves.curvature[i], curves.length[i], markers, out)
        np.testing.assert_allclose(out, (seen[-1] - seen[0]) / TWO_PI, atol=1e-9)
        np.testing.assert_allclose(out, integrand.sum(axis=0) / TWO_PI, atol=0.05)
