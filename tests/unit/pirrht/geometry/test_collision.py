"""FCL behind its door, compared with MuJoCo, which measures the same solids by other algorithms."""

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Footprint, Kind, Obstacle, Workspace

RADIUS, HEIGHT, HALF = 0.12, 0.1, 2.5
MILLIMETRE = 1e-3
every_solid = pytest.mark.parametrize("tilted", [False, True], ids=["upright", "tilted"])
every_kind = pytest.mark.parametrize("kind", list(Kind), ids=lambda kind: kind.value)


@dataclass(frozen=True, eq=False)
class Oracle:
    """A MuJoCo model of one solid and a sphere that can be put anywhere at the robot's height."""

    model: mujoco.MjModel
    data: mujoco.MjData

    def gaps(self, points: Array) -> Array:
        """Signed distances between robot and solid."""
        found = []
        for point in points:
            self.data.mocap_pos[0, :2] = point
            mujoco.mj_kinematics(self.model, self.data)
            found.append(mujoco.mj_geomDistance(self.model, self.data, 0, 1, 100.0, None))
        return np.array(found)


def random_solid(kind: Kind, tilted: bool, rng: np.random.Generator) -> tuple[Oracle, Obstacle]:
    size = np.exp(rng.uniform(np.log(0.05), np.log(1.5), 3))
    turn = Rotation.random(random_state=int(rng.integers(2**31)))
    if not tilted:
        turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    spec = mujoco.MjSpec()
    place = [*rng.uniform(-0.5, 0.5, 2), HEIGHT + (rng.uniform(-0.3, 0.3) if tilted else 0.0)]
    shape = {"type": getattr(mujoco.mjtGeom, f"mjGEOM_{kind.name}"), "size": size}
    solid = spec.worldbody.add_geom(**shape, pos=place, quat=turn.as_quat(scalar_first=True))
    if kind is Kind.MESH:
        spec.add_mesh(name="hull", uservert=(rng.uniform(-1, 1, (12, 3)) * size).ravel().tolist())
        solid.meshname = "hull"
    spec.worldbody.add_body(mocap=True, pos=[0, 0, HEIGHT]).add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0]
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    vertices = faces = None
    if kind is Kind.MESH:
        corners = model.mesh_vert.astype(float)
        hull = ConvexHull(corners)
        vertices, faces = corners[hull.vertices], np.searchsorted(hull.vertices, hull.simplices)
    place, turned = data.geom_xpos[0].copy(), data.geom_xmat[0].reshape(3, 3).copy()
    shape = {"kind": kind, "size": size, "vertices": vertices, "faces": faces}
    return Oracle(model, data), Obstacle(name=kind.value, position=place, rotation=turned, **shape)


def among(*obstacles: Obstacle, half: float = HALF) -> Collision:
    return Collision(Workspace(np.full(2, -half), np.full(2, half), obstacles), Footprint.disc(RADIUS, height=HEIGHT))


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
def test_straight_paths_are_free_when_all_their_points_are(kind, tilted):
    rng = np.random.default_rng(3)
    fraction = np.linspace(0, 1, 80)[:, None]
    for _ in range(10):
        oracle, obstacle = random_solid(kind, tilted, rng)
        collision = among(obstacle)
        tails, heads = rng.uniform(-HALF, HALF, (2, 20, 2))
        for tail, head, free in zip(tails, heads, collision.segments_free(tails, heads), strict=True):
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
def test_clearance_changes_no_faster_than_the_robot_moves(seed):
    rng = np.random.default_rng([5, seed])
    collision = mixed(rng)
    points = rng.uniform(-8, 8, (1000, 2))
    moves = rng.normal(size=(1000, 2)) * 10 ** rng.uniform(-4, 0, (1000, 1))
    change = np.abs(collision.clearance(points + moves) - collision.clearance(points))
    assert np.all(change <= np.hypot(*moves.T) + 1e-5)
