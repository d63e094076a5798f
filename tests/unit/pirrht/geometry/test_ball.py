"""A ball in space: clearances and certificates against FCL, first exits of steps against those of finer steps."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from spaces import box, in_space, mixed, window

from pirrht import FreeSpace, SceneError
from pirrht.arrays import Array
from pirrht.geometry.space import BLOCKED, COLLISION, FREE, GOAL, INSIDE
from pirrht.jit.jit import kernel
from pirrht.jit.streams import stream

DRAWS, PIECES = 4000, 64
EVEN = (1.0, 0.0, 0.0, 1.0, 0.0, 1.0)  # covariance of isotropic noise


@cache
def space_of(seed: int | None = None) -> FreeSpace:
    return FreeSpace.of(window() if seed is None else mixed(seed))


def points_in(space: FreeSpace, count: int) -> Array:
    return np.random.default_rng(1).uniform(space.scene.lower, space.scene.upper, (count, 3))


def asked(name: str, space: FreeSpace, points: Array) -> Array:
    ask = getattr(space.static.kernels, name)
    return np.array([ask(space.static, tuple(point)) for point in points.tolist()])


@pytest.mark.parametrize("seed", [None, 4, 15])
def test_a_clearance_is_never_above_the_exact_one_and_gives_at_most_the_bound_away(seed):
    space = space_of(seed)
    points, h, radius = points_in(space, 3000), space.static.spacing, space.scene.robot_radius
    exact, found = space.collision.clearance(points), asked("clearance", space, points)
    near = (exact > -0.3 * radius) & (exact < 0.9)
    lost = (exact - found)[near]
    assert lost.min() > -1e-6  # single precision
    assert np.median(lost[exact[near] < 0.3]) < h**2 / (4.0 * (radius - np.sqrt(3.0) * h))
    assert lost.max() < np.sqrt(3.0) / 2.0 * h  # where two solids meet
    assert np.all(found[exact < -0.3 * radius] < 0.0)


@pytest.mark.parametrize("seed", [None, 4, 15])
def test_what_certificates_say_of_places_and_pieces_fcl_confirms(seed):
    space = space_of(seed)
    points = points_in(space, 400)
    free, status = space.collision.free(points), asked("certify", space, points)
    assert np.all(free[status == FREE])
    assert not np.any(free[status == BLOCKED])
    assert np.mean(status == FREE) > 0.3
    heads = points + np.random.default_rng(2).normal(scale=0.5, size=points.shape)
    piece = space.static.kernels.certify_piece
    verdicts = np.array(
        [piece(space.static, tuple(a), tuple(b), True) for a, b in zip(points.tolist(), heads.tolist(), strict=True)]
    )
    free = space.collision.segments_free(points, heads)
    assert np.all(free[verdicts == FREE])
    assert not np.any(free[verdicts == BLOCKED])
    assert np.sum(verdicts == FREE) > 50
    assert np.sum(verdicts == BLOCKED) > 50
    assert space.segments_free(np.array([[0.8, 2.0, 1.0], [5.2, 2.0, 1.0]])) == (seed is None)


def test_the_two_nearest_walls_are_those_of_the_hole_and_of_the_border():
    space = space_of()
    kernels, static = space.static.kernels, space.static
    c, n, d, m = kernels.walls(static, (3.0, 1.9, 0.95))
    assert (c, d) == pytest.approx((0.05, 0.1), abs=0.002)
    np.testing.assert_allclose([n, m], [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], atol=0.01)
    c, n, d, m = kernels.walls(static, (1.0, 0.03, 2.9))
    assert (c, d) == pytest.approx((0.03, 0.1), abs=1e-6)
    assert (n, m) == ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
    rows = np.zeros((kernels.near_most, 4))
    assert kernels.near(static, (1.0, 0.03, 2.9), 0.2, rows) == 2
    np.testing.assert_allclose(rows[:2], [[0.03, 0.0, 1.0, 0.0], [0.1, 0.0, 0.0, -1.0]], atol=1e-9)
    assert kernels.near(static, (2.6, 2.8, 1.0), 0.2, rows) == 1
    np.testing.assert_allclose(rows[0], [0.1, -1.0, 0.0, 0.0], atol=0.005)


@kernel
def _steps(bridge, arena, step, before, after, cov, weighed, state, outcome, share, lasting):
    for i in range(len(outcome)):
        state, outcome[i], share[i], lasting[i] = bridge(arena, *step, before, after, cov, weighed, state)


def drawn(space: FreeSpace, tail: Array, head: Array, variance: float, weighed: bool = False) -> tuple[Array, ...]:
    """Outcomes, shares and logarithms of survival of many steps with the same ends, by the kernel."""
    world, kernels = space.world, space.static.kernels
    step = tuple(tail.tolist()), tuple(head.tolist())
    before, after = (kernels.distances(world, place) for place in step)
    outcome, share, lasting = np.empty(DRAWS, int), np.empty(DRAWS), np.empty(DRAWS)
    cov = tuple(variance * part for part in EVEN)
    state = np.uint64(stream(np.uint64(4), 0))
    _steps(kernels.bridge, world, step, before, after, cov, weighed, state, outcome, share, lasting)
    return outcome, share, lasting


def simulated(space: FreeSpace, tail: Array, head: Array, variance: float) -> Array:
    """Chances of wall and goal (DRAWS, 2) of many bridges of fine pieces, next to each of which walls are flat."""
    rng = np.random.default_rng(7)
    steps = rng.normal(scale=np.sqrt(variance / PIECES), size=(DRAWS, PIECES, 3))
    ways = np.concatenate([np.zeros((DRAWS, 1, 3)), np.cumsum(steps, axis=1)], axis=1)
    shares = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
    ways += tail + shares * (head - tail - ways[:, -1:])
    goal, collision, d = space.scene.goal, space.collision, variance / PIECES
    clear = (collision.distance(ways.reshape(-1, 3)) - space.scene.robot_radius).reshape(DRAWS, -1)
    walls = [clear, np.linalg.norm(ways - goal.center, axis=-1) - goal.radius]
    for axis in range(3):
        walls += [ways[..., axis] - space.scene.lower[axis], space.scene.upper[axis] - ways[..., axis]]
    meets = [np.exp(-2.0 * np.maximum(w[:, 1:], 0.0) * np.maximum(w[:, :-1], 0.0) / d) for w in walls]
    miss = [1.0 - each for each in meets]
    wall = np.prod([one for k, one in enumerate(miss) if k != 1], axis=0)
    alive = np.cumprod(np.concatenate([np.ones((DRAWS, 1)), wall * miss[1]], axis=1), axis=1)[:, :-1]
    return np.column_stack([(alive * (1.0 - wall)).sum(axis=1), (alive * wall * meets[1]).sum(axis=1)])


@pytest.mark.parametrize(
    ("tail", "head", "deviation"),
    [
        ([2.65, 3.0, 1.0], [2.62, 3.1, 1.1], 0.06),
        ([2.65, 3.0, 1.0], [2.72, 3.0, 1.0], 0.06),
        ([3.0, 1.95, 1.0], [3.05, 2.02, 1.0], 0.12),
        ([3.0, 1.92, 1.0], [3.0, 2.0, 1.08], 0.1),
        ([1.0, 2.0, 0.04], [1.0, 2.1, 0.06], 0.05),
        ([1.0, 0.05, 2.95], [1.0, 0.03, 2.96], 0.05),
        ([4.87, 2.0, 1.0], [4.86, 2.02, 1.02], 0.04),
        ([5.2, 2.0, 1.34], [5.2, 2.0, 1.28], 0.04),
    ],
    ids=["wall", "into a wall", "facing walls", "corner", "border", "edge of the border", "goal", "into the goal"],
)
def test_a_step_ends_as_finer_steps_do(tail, head, deviation):
    """Standard errors of both are below 0.009; round walls and corners may add 0.015, which flat ones leave out."""
    space = space_of()
    ends = np.array(tail), np.array(head)
    outcome, share, _ = drawn(space, *ends, deviation**2)
    found = np.array([np.mean(outcome == COLLISION), np.mean(outcome == GOAL)])
    exact = simulated(space, *ends, deviation**2)
    error = np.sqrt(found * (1.0 - found) / DRAWS + exact.var(axis=0) / DRAWS)
    assert np.all(error < 0.012)
    assert np.all(np.abs(found - exact.mean(axis=0)) < 3.5 * error + 0.015)
    assert found.max() > 0.1
    assert np.all((share > 0.0) & (share <= 1.0))
    assert np.all(share[outcome == INSIDE] == 1.0)

    outcome, _, lasting = drawn(space, *ends, deviation**2, weighed=True)
    if 0.0 < found[0] < 1.0 and not found[1]:
        assert np.all(outcome == INSIDE)
        assert np.exp(lasting).mean() == pytest.approx(1.0 - found[0], abs=3.5 * error[0] + 1e-9)


def test_a_swept_step_ends_where_it_meets_a_wall_or_the_goal():
    space = space_of()
    sweep, world = space.static.kernels.sweep, space.world
    outcome, share, _ = sweep(world, (2.0, 3.0, 1.0), (3.0, 3.0, 1.0))
    assert (outcome, share) == (COLLISION, pytest.approx(0.7, abs=2.0 * space.static.spacing))
    assert sweep(world, (4.2, 2.0, 1.0), (5.2, 2.0, 1.0))[:2] == (GOAL, pytest.approx(0.7))
    assert sweep(world, (0.8, 2.0, 1.0), (4.8, 2.0, 1.0))[:2] == (INSIDE, 1.0)
    assert sweep(world, (0.8, 2.0, 1.0), (0.8, 2.0, 1.0))[0] == INSIDE
    rng, met = np.random.default_rng(3), 0
    for tail in points_in(space, 300):
        head = tail + rng.normal(scale=0.5, size=3)
        if space.collision.clearance(tail[None])[0] < 0.03:
            continue
        outcome, share, _ = sweep(world, tuple(tail.tolist()), tuple(head.tolist()))
        points = tail + np.linspace(0.0, 1.0, 300)[:, None] * (head - tail)
        clear = space.collision.clearance(points[np.linspace(0.0, 1.0, 300) <= share])
        assert clear.min() > -0.1 * space.static.spacing
        assert (outcome == GOAL) <= bool(space.in_goal(tail + (share + 1e-9) * (head - tail)))
        met += outcome == COLLISION
    assert met > 30


def test_exits_lead_to_wall_and_rim_and_noise_along_a_line_finds_the_rim():
    space = space_of()
    kernels, world = space.static.kernels, space.world
    assert kernels.exit(world, (4.7, 2.0, 1.0), GOAL) == pytest.approx((0.2, 1.0, 0.0, 0.0))
    assert kernels.exit(world, (2.6, 3.0, 1.0), COLLISION) == pytest.approx((0.1, 1.0, 0.0, 0.0), abs=0.003)
    assert kernels.end(world, (5.0, 2.0, 1.1)) == GOAL
    assert kernels.end(world, (3.0, 3.0, 1.0)) == COLLISION
    e = np.array([1.0, 0.2, -0.2]) / np.linalg.norm([1.0, 0.2, -0.2])
    cov = tuple(0.01 * np.outer(e, e)[np.triu_indices(3)])
    place = np.array([5.2, 2.0, 1.0]) - 0.8 * e
    direction, gap, alone = kernels.rim(world, tuple(place), cov)
    assert alone
    assert gap == pytest.approx(0.5)
    np.testing.assert_allclose(direction, e)
    assert not kernels.rim(world, tuple(place), EVEN)[2]
    assert kernels.spread(space.static, cov, True) == pytest.approx(0.01)
    assert kernels.extent(space.static, (0.3, 0.0, 0.4)) == pytest.approx(0.5)
    level = kernels.facing(space.static, (2.6, 3.0, 1.0), None, (0.01, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert level == pytest.approx(0.1, abs=0.005)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"upper": (60.0, 40.0, 30.0)}, "the workspace of 60 m x 40 m x 30 m is too large for a ball of radius 0.2 m"),
        ({"start": (2.9, 2.0, 0.4)}, r"the start \(2.9, 2, 0.4\) is in collision for a robot of radius 0.2"),
        ({"goal": (3.0, 3.0, 1.0, 0.1)}, r"the goal \(3, 3, 1\) is in collision .* as everywhere in its disc"),
    ],
)
def test_scenes_that_no_ball_can_use_are_refused(changes: dict[str, Any], message: str):
    with pytest.raises(SceneError, match=message):
        FreeSpace.of(in_space(window().obstacles, **changes))


def test_a_scene_in_space_is_examined_as_one_in_the_plane():
    space = space_of()
    assert [part.names for part in space.obstacles] == [("wall left", "wall right", "wall sill", "wall lintel")]
    assert space.free(space.scene.start)
    assert not space.free(np.array([3.0, 3.0, 1.0]))
    assert space.clearance(np.array([3.0, 1.95, 1.0])) == pytest.approx(0.1)
    assert space.passages().count == 0
    closed = space.updated(window(closed=True))
    assert closed.homology.M == 1
    assert closed.homology.name((0,)) == "0"
    assert space.margin_left(space.scene.start) is None
    moved = space.with_task(goal=type(space.scene.goal)(center=np.array([5.0, 1.0, 2.0]), radius=0.2))
    assert moved.homology.goal.tolist() == [5.0, 1.0, 2.0]
    assert space.world.off_walls(np.array([2.71, 3.0, 1.0]), (0, 1, 2), 0.0, 0.01)[0] < 2.7
    assert FreeSpace.of(in_space([box("body", (2.0, 2.0, 1.0), (2.5, 2.5, 1.5))])).homology.M == 0
