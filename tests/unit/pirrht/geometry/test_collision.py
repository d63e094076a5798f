"""FCL behind its door, compared with MuJoCo, which measures the same solids by other algorithms."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene

RADIUS, HEIGHT, HALF = 0.12, 0.1, 2.5
MILLIMETRE = 1e-3
every_solid = pytest.mark.parametrize("tilted", [False, True], ids=["upright", "tilted"])
every_kind = pytest.mark.parametrize("kind", list(Kind), ids=lambda kind: kind.value)


@dataclass(frozen=True, eq=False)
class Oracle:
    """A MuJoCo model of one solid and a sphere that can be put anywhere at the robot's height."""

    model: mujoco.MjModel
    data: mujoco.MjData

    def gap(self, point: Array) -> float:
        """Signed distance between robot and solid."""
        self.data.mocap_pos[0, :2] = point
        mujoco.mj_kinematics(self.model, self.data)
        return mujoco.mj_geomDistance(self.model, self.data, 0, 1, 100.0, None)

    def gaps(self, points: Array) -> Array:
        return np.array([self.gap(point) for point in points])

    def deepest_contact(self, point: Array) -> float:
        """Least contact distance after a full collision pass, infinite without contact."""
        self.data.mocap_pos[0, :2] = point
        mujoco.mj_forward(self.model, self.data)
        return float(self.data.contact.dist.min()) if self.data.ncon else np.inf


def random_solid(kind: Kind, tilted: bool, rng: np.random.Generator) -> tuple[Oracle, Obstacle]:
    size = np.exp(rng.uniform(np.log(0.05), np.log(1.5), 3))
    turn = Rotation.random(random_state=int(rng.integers(2**31)))
    if not tilted:
        turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    spec = mujoco.MjSpec()
    solid = spec.worldbody.add_geom(
        type=getattr(mujoco.mjtGeom, f"mjGEOM_{kind.name}"),
        size=size,
        pos=[*rng.uniform(-0.5, 0.5, 2), HEIGHT + (rng.uniform(-0.3, 0.3) if tilted else 0.0)],
        quat=turn.as_quat(scalar_first=True),
    )
    if kind is Kind.MESH:
        spec.add_mesh(name="hull", uservert=(rng.uniform(-1, 1, (12, 3)) * size).ravel().tolist())
        solid.meshname = "hull"
    robot = spec.worldbody.add_body(mocap=True, pos=[0, 0, HEIGHT])
    robot.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    vertices = faces = None
    if kind is Kind.MESH:
        corners = model.mesh_vert.astype(float)
        hull = ConvexHull(corners)
        vertices, faces = corners[hull.vertices], np.searchsorted(hull.vertices, hull.simplices)
    obstacle = Obstacle(
        name=kind.value,
        kind=kind,
        size=size,
        position=data.geom_xpos[0].copy(),
        rotation=data.geom_xmat[0].reshape(3, 3).copy(),
        vertices=vertices,
        faces=faces,
    )
    return Oracle(model, data), obstacle


def among(*obstacles: Obstacle, half: float = HALF) -> Collision:
    scene = Scene(
        name="test",
        lower=np.full(2, -half),
        upper=np.full(2, half),
        obstacles=obstacles,
        goal=Goal(center=np.zeros(2), radius=0.1),
        start=np.zeros(3),
        robot_radius=RADIUS,
        robot_height=HEIGHT,
    )
    return Collision(scene.world, scene.footprint)


def mixed(rng: np.random.Generator) -> Collision:
    solids = [random_solid(kind, tilted, rng)[1] for kind in Kind for tilted in (False, True)]
    for solid in solids:
        solid.position[:2] += rng.uniform(-6, 6, 2)
    return among(*solids, half=7.0)


@every_kind
@every_solid
def test_distances_are_those_of_mujoco(kind, tilted):
    rng = np.random.default_rng(1)
    for _ in range(20):
        oracle, obstacle = random_solid(kind, tilted, rng)
        points = rng.uniform(-HALF, HALF, (100, 2))
        collision = among(obstacle)
        found, gaps = collision.distance(points), oracle.gaps(points)
        outside = gaps > -RADIUS + MILLIMETRE
        assert found[outside] == pytest.approx(gaps[outside] + RADIUS, abs=1e-5)
        assert np.all(found[gaps < -RADIUS - MILLIMETRE] == 0)
        assert collision.obstacle_distance(0, points) == pytest.approx(found, abs=1e-5)


@every_kind
@every_solid
def test_free_poses_are_those_without_contact_in_mujoco(kind, tilted):
    rng = np.random.default_rng(2)
    for _ in range(20):
        oracle, obstacle = random_solid(kind, tilted, rng)
        points = rng.uniform(-1.5, 1.5, (100, 2))
        free = among(obstacle).free(points)
        depths = np.array([oracle.deepest_contact(point) for point in points])
        assert np.all(depths[free] > -MILLIMETRE)
        assert np.all(oracle.gaps(points[~free]) < MILLIMETRE)


@every_kind
@every_solid
def test_straight_paths_are_free_when_all_their_points_are(kind, tilted):
    rng = np.random.default_rng(3)
    fraction = np.linspace(0, 1, 80)[:, None]
    for _ in range(10):
        oracle, obstacle = random_solid(kind, tilted, rng)
        collision = among(obstacle)
        tails, heads = rng.uniform(-HALF, HALF, (2, 20, 2))
        swept = collision.segments_free(tails, heads)
        for tail, head, free in zip(tails, heads, swept, strict=True):
            length = float(np.hypot(*(head - tail)))
            least = oracle.gaps(tail + fraction * (head - tail)).min()
            between = 0.5 * length / (len(fraction) - 1)  # how much lower it can be between two samples
            bisected = collision.bisect_free(lambda s, a=tail, b=head, n=length: a + s / n * (b - a), length)
            if least < -MILLIMETRE:
                assert not free
                assert not bisected
            if least > MILLIMETRE + between:
                assert free
                assert bisected


@pytest.mark.parametrize("seed", range(3))
def test_arcs_certified_free_touch_nothing(seed):
    rng = np.random.default_rng([4, seed])
    collision = mixed(rng)
    verdicts = []
    for _ in range(150):
        center, radius, begin = rng.uniform(-6, 6, 2), rng.uniform(0.3, 2), rng.uniform(0, 6)

        def arc(s, center=center, radius=radius, begin=begin):
            angle = begin + np.asarray(s) / radius
            return center + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

        length = rng.uniform(0, 2 * np.pi * radius)
        least = collision.clearance(arc(np.linspace(0, length, 300))).min()
        free = collision.bisect_free(arc, length)
        verdicts.append(free)
        if free:
            assert least > 0
        elif least > MILLIMETRE:
            assert least < 0.5 * length / 299
    assert 0 < sum(verdicts) < len(verdicts)


def wall_at(x: float, thickness: float = 0.002) -> Collision:
    """A wall that begins at x, across the workspace."""
    size, position = np.array([0.5 * thickness, 3, 1]), np.array([x + 0.5 * thickness, 0, HEIGHT])
    return among(Obstacle(name="wall", kind=Kind.BOX, size=size, position=position, rotation=np.eye(3)))


def test_a_path_through_a_thin_wall_is_blocked():
    collision = wall_at(0.0)
    assert not collision.bisect_free(lambda s: np.array([s - 1, 0.0]), 2.0)
    assert not collision.segments_free(np.array([[-1.0, 0]]), np.array([[1.0, 0]]))[0]


@pytest.mark.parametrize("reach", [0.2, 1.0, 2.2])
@pytest.mark.parametrize(("gap", "free"), [(2e-4, True), (-2e-4, False)])
def test_a_path_may_end_or_turn_just_before_a_wall_but_not_in_it(reach, gap, free):
    collision = wall_at(0.123)
    end = 0.123 - RADIUS - gap
    tail, head = np.array([end - reach, 0.3]), np.array([end, 0.3])
    assert collision.segments_free(tail[None], head[None])[0] == free
    assert collision.segments_free(head[None], tail[None])[0] == free
    turned = collision.bisect_free(lambda s: np.array([end - abs(s - reach), 0.3]), 1.9 * reach)
    assert turned == free


@pytest.mark.parametrize("seed", range(3))
def test_clearance_changes_no_faster_than_the_robot_moves(seed):
    rng = np.random.default_rng([5, seed])
    collision = mixed(rng)
    points = rng.uniform(-8, 8, (1000, 2))
    moves = rng.normal(size=(1000, 2)) * 10 ** rng.uniform(-4, 0, (1000, 1))
    change = np.abs(collision.clearance(points + moves) - collision.clearance(points))
    assert np.all(change <= np.hypot(*moves.T) + 1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_positive_clearance_means_free(seed):
    rng = np.random.default_rng([6, seed])
    collision = mixed(rng)
    points = rng.uniform(-7.5, 7.5, (1000, 2))
    clearance = collision.clearance(points)
    sure = np.abs(clearance) > 1e-5
    assert np.array_equal(collision.free(points)[sure], clearance[sure] > 0)


@pytest.mark.parametrize("reach", [0.4, 3.0, 50.0])
def test_the_nearest_wall_is_the_nearest_of_the_solids_that_count(reach):
    rng = np.random.default_rng(7)
    collision = mixed(rng)
    members = [0, 1, 2, 3, 4, 5, 8, 9, 11]
    points = rng.uniform(-7, 7, (200, 2))
    every = np.array([collision.obstacle_distance(i, points) for i in range(12)])
    found = collision.nearest_walls(points, members, reach)
    least = every[members].min(axis=0)
    assert found.first == pytest.approx(np.minimum(least, reach), abs=1e-5)
    assert np.all(found.second >= found.first)
    near = found.which >= 0
    assert np.array_equal(near, least < reach)
    assert every[found.which[near], np.flatnonzero(near)] == pytest.approx(least[near], abs=1e-5)


def test_the_distance_of_a_scene_is_the_least_of_its_obstacles():
    rng = np.random.default_rng(8)
    collision = mixed(rng)
    points = rng.uniform(-7, 7, (300, 2))
    single = np.array([collision.obstacle_distance(i, points) for i in range(12)])
    assert collision.distance(points) == pytest.approx(single.min(axis=0), abs=1e-5)


def test_an_empty_scene_is_bounded_by_its_border_alone():
    collision = among()
    points = np.array([[0.0, 0], [2, 0], [HALF, 0], [0, -3]])
    assert np.all(np.isinf(collision.distance(points)))
    assert collision.clearance(points) == pytest.approx([2.5, 0.5, 0, -0.5])
    assert collision.free(points).tolist() == [True, True, False, False]
    assert collision.segments_free(points[:1].repeat(4, axis=0), points).tolist() == [
        True,
        True,
        False,
        False,
    ]
    assert collision.bisect_free(lambda s: np.array([s, 0.0]), 2.4)
    assert not collision.bisect_free(lambda s: np.array([s, 0.0]), 2.6)


def test_paths_without_length_are_free_where_the_robot_is():
    rng = np.random.default_rng(9)
    collision = mixed(rng)
    points = rng.uniform(-7.5, 7.5, (400, 2))
    assert np.array_equal(collision.segments_free(points, points), collision.free(points))
    clear = np.abs(collision.clearance(points)) > 1e-4
    standing = np.array([collision.bisect_free(lambda s, p=p: p, 0.0) for p in points])
    assert np.array_equal(standing[clear], collision.free(points)[clear])


def test_a_pose_that_is_no_number_is_not_free():
    collision = mixed(np.random.default_rng(10))
    nowhere = np.full((1, 2), np.nan)
    assert not collision.free(nowhere)[0]
    assert not collision.segments_free(nowhere, np.zeros((1, 2)))[0]
    assert not collision.bisect_free(lambda s: nowhere[0], 1.0)


def test_queries_are_counted():
    collision = mixed(np.random.default_rng(11))
    before = collision.calls
    collision.free(np.zeros((1, 2)))
    assert collision.calls == before + 1
