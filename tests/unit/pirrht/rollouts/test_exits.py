"""First exits within a step against the law of the Brownian bridge; swept steps against FCL."""

import numpy as np
import pytest
from rooms import walled as room
from scipy.special import erfcx
from scipy.stats import kstest, norm

from pirrht.geometry.disc import bridge, clearance, distances, sweep, towards_exit
from pirrht.geometry.space import COLLISION, GOAL, INSIDE
from pirrht.jit.jit import kernel
from pirrht.jit.streams import first_crossing, stream, uniform
from pirrht.rollouts.first_exit import at_crossing

DRAWS = 20000
ENDS = [(0.3, 0.5), (0.3, -0.2), (0.05, 0.4), (1.0, 0.0), (0.6, -1.5)]


def shares(c0: float, c1: float, deviation: float = 1.0, count: int = DRAWS, seed: int = 1) -> np.ndarray:
    state, out = stream(np.uint64(seed), 0), np.empty(count)
    for i in range(count):
        state, out[i] = first_crossing(c0, c1, deviation, np.uint64(state))
    return out


def mean_share(c0: float, c1: float, deviation: float) -> float:
    """E[share | crossing] = A Mills(A + E)."""
    A, E = c0 / deviation, abs(c1) / deviation
    return float(A * np.sqrt(np.pi / 2.0) * erfcx((A + E) / np.sqrt(2.0)))


def first_crossing_law(c0: float, c1: float, deviation: float):
    """P(share <= t | crossing): for Brownian motion from c0 > 0 to c1 <= 0 at time 1, by reflection at time t."""
    c1 = -abs(c1)  # an end on the near side is its mirror image

    def law(t: np.ndarray) -> np.ndarray:
        t = np.clip(np.asarray(t, dtype=float), 1e-12, 1.0 - 1e-12)
        spread = deviation * np.sqrt(t * (1.0 - t))
        mean, mirrored = c0 + t * (c1 - c0), -c0 + t * (c1 + c0)
        # Below zero at t, or above zero after a crossing: a path from -c0, weighed by the ratio of end densities.
        return norm.cdf(-mean / spread) + np.exp((-2.0 * c0 * c1 / deviation**2) + norm.logsf(-mirrored / spread))

    return law


@pytest.mark.parametrize(("c0", "c1"), ENDS)
def test_the_time_of_first_crossing_has_the_law_of_the_bridge(c0, c1):
    """Kolmogorov-Smirnov on 20000 draws of seed 2; a wrong law of 1.4 % at any time would show."""
    assert kstest(shares(c0, c1, seed=2), first_crossing_law(c0, c1, 1.0)).pvalue > 1e-3


def test_the_law_scales_with_the_deviation():
    np.testing.assert_allclose(shares(0.3, 0.5), shares(0.03, 0.05, deviation=0.1), rtol=1e-9)


@kernel
def _steps(arena, step, before, after, cov, weighed, state, outcome, share, lasting):  # type: ignore[no-untyped-def]
    for i in range(len(outcome)):
        state, outcome[i], share[i], lasting[i] = bridge(arena, *step, before, after, cov, weighed, state)


def bridges(
    tail: np.ndarray, head: np.ndarray, variance: float, count: int = DRAWS, *, weighed: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outcomes, shares and logarithms of survival of many isotropic steps with the same ends."""
    arena, step = room().world, (tuple(tail.tolist()), tuple(head.tolist()))
    before, after = distances(arena, step[0]), distances(arena, step[1])
    outcome, share, lasting = np.empty(count, int), np.empty(count), np.empty(count)
    cov = (variance, 0.0, variance)
    _steps(arena, step, before, after, cov, weighed, np.uint64(stream(np.uint64(4), 0)), outcome, share, lasting)
    return outcome, share, lasting


BESIDE = pytest.mark.parametrize(
    ("tail", "head"),
    [([1.8, 2.0], [1.85, 2.3]), ([0.1, 1.0], [0.15, 1.2]), ([3.95, 2.0], [3.9, 2.2]), ([3.0, 0.04], [3.1, 0.2])],
    ids=["wall", "left border", "right border", "lower border"],
)


@BESIDE
def test_a_step_beside_a_wall_hits_it_with_the_probability_of_the_bridge(tail, head):
    """20000 steps, within 4 standard errors and the 1 % that the clearance field gives away."""
    variance = 0.01
    x, y, nx, ny = *tail, *head
    wall = 2.0 - 0.01 - 0.05
    gaps = [(x, nx), (4 - x, 4 - nx), (y, ny), (4 - y, 4 - ny)]
    gaps.append((wall - x, wall - nx) if x < 2 else (x - 2.06, nx - 2.06))
    alive = np.prod([1.0 - np.exp(-2.0 * a * b / variance) for a, b in gaps])
    outcome, share, lasting = bridges(np.array(tail), np.array(head), variance)
    assert np.all(lasting == 0.0)
    assert set(np.unique(outcome)) == {INSIDE, COLLISION}
    hit = np.mean(outcome == COLLISION)
    assert 0.02 < hit < 0.9
    assert hit == pytest.approx(1.0 - alive, abs=4 * np.sqrt(alive * (1 - alive) / DRAWS) + 0.02)
    c0, c1 = min(gaps, key=lambda gap: gap[0] * gap[1])
    when = share[outcome == COLLISION]
    error = 4 * when.std() / np.sqrt(len(when))
    assert when.mean() == pytest.approx(mean_share(c0, c1, np.sqrt(variance)), abs=error + 0.02)


@BESIDE
def test_a_weighed_step_goes_on_with_the_probability_that_another_is_not_ended(tail, head):
    """20000 steps of seed 4, within 4 standard errors."""
    ended = np.mean(bridges(np.array(tail), np.array(head), 0.01)[0] == COLLISION)
    outcome, share, lasting = bridges(np.array(tail), np.array(head), 0.01, 10, weighed=True)
    assert np.all(outcome == INSIDE)
    assert np.all(share == 1.0)
    assert np.all(lasting == lasting[0])
    assert np.exp(lasting[0]) == pytest.approx(1.0 - ended, abs=4.0 * np.sqrt(ended * (1.0 - ended) / DRAWS))


def test_a_step_beside_the_goal_ends_in_it_with_the_probability_of_a_flat_rim():
    head, variance = np.array([0.88, 3.2]), 0.01
    outcome, _, _ = bridges(np.array([0.9, 3.2]), head, variance)
    expected = np.exp(-2.0 * 0.1 * 0.08 / variance)
    assert np.mean(outcome == GOAL) == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / DRAWS))


def test_the_place_of_the_first_crossing_lies_on_what_is_crossed():
    space = room()
    arena, state = space.world, stream(np.uint64(6), 0)
    for i in range(500):
        state, u = uniform(np.uint64(state))
        share = 0.05 + 0.9 * u
        wall, rim = towards_exit(arena, (1.9, 2.0), COLLISION), towards_exit(arena, (0.9, 3.1), GOAL)
        state, dx, dy = at_crossing(wall, 0.0, (0.2, 0.1), share, 0.1, np.uint64(state))
        assert clearance(space.static, (1.9 + dx, 2.0 + dy)) == pytest.approx(0.0, abs=0.01)
        state, dx, dy = at_crossing(rim, arena.radius, (-0.2, 0.1), share, 0.0, np.uint64(state))
        # On the rim, which is round; along it by its share of the step.
        unit = np.array([0.6 - 0.9, 3.2 - 3.1]) / np.hypot(0.3, 0.1)
        assert np.hypot(0.9 + dx - 0.6, 3.1 + dy - 3.2) == pytest.approx(arena.radius)
        across = np.array([-unit[1], unit[0]])
        assert np.dot([dx, dy], across) == pytest.approx(share * np.dot([-0.2, 0.1], across)), i


def test_a_path_that_remembers_its_room_ends_where_one_does_that_is_swept_step_by_step():
    """400 walks of steps up to 0.3 m that turn by up to 0.5 rad; they differ by 5 mm at a wall, or along it."""
    space = room()
    rng, compared = np.random.default_rng(8), []
    for _ in range(400):
        at, theta, known = np.array([1.0, 2.0]), rng.uniform(-np.pi, np.pi), 0.0
        for _ in range(60):
            turn, length = rng.uniform(-0.5, 0.5), rng.uniform(0.02, 0.3)
            head = at + length * np.array([np.cos(theta + turn / 2), np.sin(theta + turn / 2)])
            found, share, known = sweep(space.world, tuple(at), tuple(head), turn, known)
            exit, wanted, _ = sweep(space.world, tuple(at), tuple(head), turn)
            assert known <= space.collision.clearance(head[None])[0] + 1e-9 or found != INSIDE
            if found != exit:
                way = at + np.linspace(0.0, 1.0, 200)[:, None] * (head - at)
                assert space.collision.clearance(way).min() < 0.005 + abs(turn) * length / 8.0
            elif exit == COLLISION:
                assert abs(share - wanted) * length < 0.005
            else:
                assert share == wanted
            compared.append(exit)
            if exit != INSIDE or found != INSIDE:
                break
            at, theta = head, theta + turn
    assert min(compared.count(outcome) for outcome in (GOAL, COLLISION)) > 20


def test_a_sweep_agrees_with_fcl_wherever_the_segment_is_not_grazing():
    space, rng, exits = room(), np.random.default_rng(6), []
    for _ in range(1500):
        tail, head = rng.uniform(-0.2, 4.2, (2, 2))
        if not space.collision.free(tail[None])[0] or space.scene.goal.contains(tail):
            continue
        exit, share, _ = sweep(space.world, tuple(tail), tuple(head))
        exits.append(exit)
        line = tail + np.linspace(0, share if exit == GOAL else 1.0, 200)[:, None] * (head - tail)
        gap = space.collision.clearance(line).min()
        if gap > 0.01:
            assert exit != COLLISION
        if gap <= 0:
            assert exit == COLLISION
    assert min(exits.count(outcome) for outcome in (INSIDE, GOAL, COLLISION)) > 20


def test_a_sweep_of_a_step_that_turns_agrees_with_fcl_along_the_arc():
    """600 arcs along the wall of up to 1.5 m and 0.4 rad; where chord and arc differ in what they touch, it decides."""
    space, rng, told_apart = room(), np.random.default_rng(7), 0
    for _ in range(600):
        tail, length = rng.uniform([1.8, 0.2], [2.2, 2.2]), rng.uniform(0.8, 1.5)
        turn = rng.uniform(0.2, 0.4) * rng.choice([-1.0, 1.0])
        theta = 0.5 * np.pi - 0.5 * turn + rng.normal(scale=0.02)
        headings = theta + turn * np.linspace(0.0, 1.0, 301)
        ahead, aside = np.sin(headings) - np.sin(theta), np.cos(theta) - np.cos(headings)
        arc = tail + length / turn * np.stack([ahead, aside], axis=-1)
        chord = tail + np.linspace(0.0, 1.0, 301)[:, None] * (arc[-1] - tail)
        if min(np.hypot(*(line - space.scene.goal.center).T).min() for line in (arc, chord)) < space.world.radius:
            continue
        gap, straight = (space.collision.clearance(line).min() for line in (arc, chord))
        if abs(gap) < 0.005:
            continue
        exit, _, _ = sweep(space.world, tuple(tail), tuple(arc[-1]), turn)
        assert exit == (INSIDE if gap > 0.0 else COLLISION)
        told_apart += (gap > 0.0) != (straight > 0.0)
    assert told_apart > 10
