"""Moving obstacles in space, which turn: poses, clearances, certificates and exits, by SciPy, FCL and fine steps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from spaces import flying, in_space, solid

from pirrht import SceneError
from pirrht.geometry.collision import Collision
from pirrht.geometry.obstacle import Motion, Mover, rotation_of
from pirrht.geometry.scene import Kind, Workspace
from pirrht.geometry.space import BLOCKED, FREE, NEVER
from pirrht.moving.in_space import MovingSolids

KINDS = (Kind.BOX, Kind.SPHERE, Kind.CAPSULE, Kind.CYLINDER, Kind.ELLIPSOID)
ROBOT = 0.2


def test_a_motion_in_space_turns_evenly_the_short_way_and_is_predicted_to_go_on_so():
    rng = np.random.default_rng(0)
    times = np.array([0.0, 1.0, 1.5, 3.0, 4.0])
    places = rng.normal(size=(5, 3))
    turns = Rotation.random(5, rng=rng)
    quaternions = turns.as_quat(scalar_first=True) * [[2.0], [-1.0], [1.0], [-3.0], [1.0]]
    motion = Motion(rows=np.column_stack([times, places, quaternions]), repeat=True)
    moments = rng.uniform(0.0, 4.0, 30)
    expected = Slerp(times, turns)(moments).as_matrix()
    for moment, pose, turn in zip(moments, motion.pose(moments + 4.0), expected, strict=True):
        np.testing.assert_allclose(pose[:3], [np.interp(moment, times, axis) for axis in places.T], atol=1e-9)
        np.testing.assert_allclose(rotation_of(pose), turn, atol=1e-9)
        np.testing.assert_allclose(motion.pose_at(moment + 4.0), pose, atol=1e-12)
    ahead = motion.straight_on(1.6, 30.0)
    np.testing.assert_allclose(ahead.pose(1.3), motion.pose(2.9), atol=1e-9)
    np.testing.assert_allclose(ahead.velocity(25.0), motion.velocity(2.0), atol=1e-9)
    still = motion.after(1.0).pose(np.array([0.5, 3.5]))
    np.testing.assert_allclose(still, motion.pose(np.array([1.5, 4.5])))


@pytest.mark.parametrize(
    ("rows", "words"),
    [([[0, 1, 1, 1, 0, 0, 0, 0]], "quaternion of row 1"), ([[0, 1, 1, 1, 1, 0, 0]], "a time, x, y and a yaw")],
)
def test_rows_in_space_without_a_turn_or_of_another_length_are_refused(rows, words):
    with pytest.raises(SceneError, match=words):
        Motion(rows=np.array(rows, dtype=float))


def test_bodies_in_the_plane_do_not_move_in_space_nor_do_meshes():
    flat = Mover(
        name="flat", solids=(solid("s", Kind.SPHERE, (0.2, 0, 0), (0, 0, 1)),), motion=Motion(rows=np.zeros((1, 4)))
    )
    with pytest.raises(SceneError, match="rows of the motion of flat must be t, x, y, z and a quaternion"):
        in_space(movers=(flat,))
    mesh = flying("gem", [(0.0, 2.0, 2.0, 1.0)], solid("gem", Kind.MESH, (0.2, 0.2, 0.2), (0, 0, 0)))
    with pytest.raises(SceneError, match='"gem" of "gem" is a mesh, and it moves in space; make it of boxes'):
        MovingSolids.of(in_space(movers=(mesh,)))


def random_bodies(rng: np.random.Generator, count: int) -> MovingSolids:
    """Bodies of one or two solids that tumble through a room, some over and over, some from elsewhere again."""
    movers = []
    for j in range(count):
        k = int(rng.integers(2, 5))
        times = np.cumsum([0.0, *rng.uniform(0.5, 2.0, k - 1)])
        turns = Rotation.random(k, rng=rng)
        rows = np.column_stack([times, rng.uniform(1.0, 3.0, (k, 3)), turns.as_quat(scalar_first=True)])
        parts = [
            solid(
                f"{i}", KINDS[rng.integers(5)], rng.uniform(0.1, 0.4, 3), rng.uniform(-0.3, 0.3, 3),
                Rotation.random(rng=rng).as_matrix(),
            )
            for i in range(rng.integers(1, 3))
        ]  # fmt: skip
        motion = Motion(rows=rows, repeat=bool(rng.integers(2)), offset=float(rng.uniform(-1.0, 1.0)))
        movers.append(Mover(name=f"{j}", solids=tuple(parts), motion=motion))
    return MovingSolids.of(in_space(upper=(4.0, 4.0, 4.0), goal=(3.5, 3.5, 3.5, 0.2), movers=movers, radius=ROBOT))


@pytest.mark.slow
def test_clearances_are_fcls_and_walls_are_their_slopes_in_space_and_time():
    rng = np.random.default_rng(1)
    seen = 0
    for _ in range(30):
        bodies = random_bodies(rng, 2)
        for _ in range(10):
            place = rng.uniform(0.0, 4.0, 3)
            t = rng.uniform(-1.0, 8.0)
            c = bodies.clearance(tuple(place), t)
            exact = bodies.distance(place, t)
            assert max(c, 0.0) == pytest.approx(max(exact, 0.0), abs=1e-9)
            walls = bodies.walls(tuple(place), t, 10.0)
            assert len(walls) == bodies.J
            if c <= 0.05:
                continue
            wall, h = walls[np.argmin(walls[:, 0])], 1e-6
            steps = np.eye(3) * h
            slope = [
                (bodies.clearance(tuple(place + s), t) - bodies.clearance(tuple(place - s), t)) / (2 * h) for s in steps
            ]
            later = (bodies.clearance(tuple(place), t + h) - c) / h
            if np.allclose(slope, wall[1:4], atol=1e-3):  # away from edges, where two solids are as near
                seen += 1
                assert later == pytest.approx(-float(wall[1:4] @ wall[4:7]), abs=1e-3 * (1.0 + bodies.speed))
    assert seen > 150


@pytest.mark.slow
def test_no_certificate_or_sweep_says_free_where_fine_steps_touch_and_none_is_wrong_by_more_than_a_sweeps_step():
    rng = np.random.default_rng(2)
    found = {FREE: 0, BLOCKED: 0}
    shares = np.linspace(0.0, 1.0, 1001)
    for _ in range(40):
        bodies = random_bodies(rng, 2)
        kernels = bodies.kernels
        for _ in range(10):
            a, b = rng.uniform(0.0, 4.0, (2, 3))
            s = float(rng.uniform(-1.0, 6.0))
            t = s + float(rng.uniform(0.1, 3.0))
            fine = np.array([bodies.clearance(tuple(a + u * (b - a)), s + u * (t - s)) for u in shares])
            verdict = int(kernels.certify(bodies, (*a.tolist(), s, *b.tolist(), t), 0.0))
            found[verdict] += 1
            assert (verdict == FREE) <= (fine.min() > 0.0)
            assert (verdict == BLOCKED) <= (fine.min() < 0.01)  # between two fine steps
            if abs(fine.min()) > 1e-3:
                assert bodies.meets(a, s, b, t) == (fine.min() < 0.0)
            share = kernels.sweep(bodies, 0, (tuple(a.tolist()), tuple(b.tolist()), 0.0), s, t - s, 1.0)
            first = shares[np.argmax(fine <= 0.0)] if fine.min() <= 0.0 else NEVER
            grazing = abs(fine.min()) < 0.1 * ROBOT
            assert grazing or share == pytest.approx(first, abs=0.1 * ROBOT / max(np.linalg.norm(b - a), 1e-9) + 2e-3)
    assert min(found.values()) > 50


def survival(bodies: MovingSolids, a: np.ndarray, b: np.ndarray, dt: float, deviation: float) -> float:
    """The probability that a step misses all, as samples take it."""
    cov = (deviation**2, 0.0, 0.0, deviation**2, 0.0, deviation**2)
    out = np.empty((bodies.J, 7))
    state = np.uint64(1)
    step = (tuple(a.tolist()), tuple(b.tolist()))
    _, share, log = bodies.kernels.bridge(bodies, 0, step, 0.0, dt, cov, (deviation**2, True), state, out)
    return float(np.exp(log)) if share > 1.0 else 0.0


@pytest.mark.slow
def test_a_noisy_step_misses_a_moving_wall_exactly_and_a_ball_but_for_its_curvature():
    """A ball of radius R counts as a flat wall: with noise of R/20 that is right within 0.03, by 4000 fine bridges."""
    dt, speed = 0.1, 1.5
    wall = flying(
        "wall", [(0.0, 2.0, 2.0, 2.0), (1.0, 2.0 - speed, 2.0, 2.0)], solid("w", Kind.BOX, (0.1, 9, 9), (0, 0, 0))
    )
    bodies = MovingSolids.of(in_space(movers=(wall,), radius=ROBOT))
    a = np.array([1.6, 1.0, 1.0])
    b = np.array([1.5, 1.1, 0.9])
    c, d = (x - 0.1 - ROBOT for x in (2.0 - a[0], 2.0 - speed * dt - b[0]))
    assert survival(bodies, a, b, dt, 0.05) == pytest.approx(1.0 - np.exp(-2.0 * c * d / 0.05**2), rel=1e-9)
    rng = np.random.default_rng(3)
    R = 0.4 + ROBOT
    n = 400
    ball = flying(
        "ball", [(0.0, 0.0, 2.0, 2.0), (1.0, speed, 2.0, 2.0)], solid("b", Kind.SPHERE, (0.4, 0, 0), (0, 0, 0))
    )
    bodies = MovingSolids.of(in_space(movers=(ball,), radius=ROBOT))
    deviation = R / 20.0
    shares = np.arange(n + 1) / n
    for _ in range(6):
        way = rng.normal(size=3)
        a = np.array([0.0, 2.0, 2.0]) + (R + deviation * rng.uniform(0.3, 1.5)) * way / np.linalg.norm(way)
        b = a + [speed * dt, 0.0, 0.0] + deviation * rng.normal(size=3)
        steps = rng.normal(size=(4000, n, 3)) * deviation / np.sqrt(n)
        free = np.concatenate([np.zeros((4000, 1, 3)), np.cumsum(steps, axis=1)], axis=1)
        paths = a + free + shares[:, None] * (b - a - free[:, -1:])
        seen = paths - np.array([0.0, 2.0, 2.0]) - shares[:, None] * np.array([speed * dt, 0.0, 0.0])
        near = np.linalg.norm(seen, axis=2).min(axis=1) - 0.5826 * deviation / np.sqrt(n)  # between the fine steps
        expected = float(np.mean(near > R)) if np.linalg.norm(seen[0, -1]) > R else 0.0
        assert survival(bodies, a, b, dt, deviation) == pytest.approx(expected, abs=0.03)


def test_the_solids_of_a_body_are_where_its_pose_puts_them():
    turn = Rotation.from_euler("xyz", [0.3, -0.5, 1.1])
    box = solid("box", Kind.BOX, (0.3, 0.1, 0.2), (0.2, 0.1, 0.0))
    rows = [(0.0, 1.0, 2.0, 1.5, *turn.as_quat(scalar_first=True))]
    [there] = flying("b", rows, box).at(0.0)
    np.testing.assert_allclose(there.rotation, turn.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(there.position, turn.apply(box.position) + np.array([1.0, 2.0, 1.5]), atol=1e-12)
    far = np.full(3, np.inf)
    alone = Collision(Workspace(-far, far, (there,)), in_space().footprint)
    scene = in_space(movers=(flying("b", rows, box),))
    place = np.array([[1.4, 1.2, 1.9]])
    assert MovingSolids.of(scene).distance(place[0], 3.0) == pytest.approx(float(alone.clearance(place)[0]), abs=1e-12)
