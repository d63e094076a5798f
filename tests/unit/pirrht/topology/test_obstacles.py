"""Topological obstacles: what the robot cannot pass between is one."""

import mujoco
import numpy as np
import pytest
from discs import block, scene_of
from discs import disc as cylinder
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Kind, Obstacle
from pirrht.topology.obstacles import _Planar, components

RADIUS, HEIGHT = 0.2, 0.1
OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])


def solid(kind, size, position, rotation):
    corners = OCTAHEDRON * size
    return Obstacle(
        name="solid", kind=kind, size=np.array(size), position=np.array([*position, HEIGHT]),
        rotation=rotation.as_matrix(), vertices=corners if kind is Kind.MESH else None,
        faces=ConvexHull(corners).simplices.astype(np.int64) if kind is Kind.MESH else None,
    )  # fmt: skip


def box(x0, x1, y0, y1, name="box"):
    return block(name, (x0 + x1) / 2, (y0 + y1) / 2, ((x1 - x0) / 2, (y1 - y0) / 2))


def disc(x, y, radius=0.075):
    return cylinder("disc", x, y, radius)


def found(*obstacles, half=5.0, radius=RADIUS):
    scene = scene_of(obstacles, start=(0, 0), goal=(0, 0), lower=(-half, -half), side=half, radius=radius)
    return components(Collision(scene.world, scene.footprint))


def test_touching_boxes_are_one_component():
    (one,) = found(box(0, 1, 0, 1, "left"), box(1, 2, 0, 2, "right"))
    assert one.members == (0, 1)
    assert one.names == ("left", "right")
    assert one.marker == pytest.approx([1.5, 1.0])
    assert one.marker is not None


def test_equal_solids_in_one_place_take_no_more_work_than_one(monkeypatch):
    asked, common = [], _Planar.common
    monkeypatch.setattr(
        _Planar, "common", lambda self, i, j, *more: (asked.append((i, j)), common(self, i, j, *more))[1]
    )
    (alone,) = found(box(0, 1, 0, 1))
    once = len(asked)
    (many,) = found(*[box(0, 1, 0, 1, f"box {i}") for i in range(500)])
    assert len(asked) == 2 * once
    assert len(many.names) == 500
    np.testing.assert_array_equal(many.marker, alone.marker)
    scene = scene_of([box(0, 1, 0, 1)] * 500, start=(-2, -2), goal=(2, 2), lower=(-5, -5), side=5.0, radius=RADIUS)
    walls = Collision(scene.world, scene.footprint).nearest_walls(np.array([[2.0, 0.5]]), range(500), 3.0)
    assert (walls.first[0], walls.which[0]) == (pytest.approx(1.0), 0)


@pytest.mark.parametrize(("gap", "count"), [(0.39, 1), (0.39999, 1), (0.40001, 2), (0.41, 2)])
def test_a_gap_counts_when_the_robot_fits_through(gap, count):
    assert len(found(box(0, 1, 0, 1), box(1 + gap, 3, 0.2, 0.7))) == count
    assert len(found(disc(0, 0), disc(*(0.15 + gap) * np.array([0.6, 0.8])))) == count
    corner = gap * np.array([0.6, 0.8])
    assert len(found(box(-1, 0, -1, 0), box(corner[0], 2, corner[1], 2))) == count


def test_a_u_is_one_component_and_what_stands_inside_is_another():
    result = found(box(-2, -1.8, -2, 2), box(-2, 2, -2, -1.8), disc(0, 0), box(1.8, 2, -2, 2))
    assert [one.members for one in result] == [(0, 1, 3), (2,)]
    assert result[1].marker == pytest.approx([0, 0])


@pytest.mark.parametrize("radius", [0.3, 0.5])
def test_the_marker_is_the_centre_of_the_largest_member_and_ties_go_to_the_first(radius):
    (one,) = found(disc(-0.5, 0, 0.3), disc(0, 0, 0.3), disc(0.5, 0, radius))
    assert one.marker == pytest.approx([-0.5 if radius == 0.3 else 0.5, 0])


@pytest.mark.parametrize(("gap", "joins"), [(0.199, True), (0.201, False)])
@pytest.mark.parametrize("side", range(4))
def test_a_component_joins_the_border_where_the_robots_centre_cannot_pass(gap, joins, side):
    turn = Rotation.from_euler("z", 90 * side, degrees=True).as_matrix()[:2, :2]
    (one,) = found(*(disc(*(turn @ [x, 1.0])) for x in (4.925 - gap, 4.5)))
    assert (one.marker is None) == joins
    assert (one.marker is None) == joins


def gap_in_mujoco(one, other):
    spec = mujoco.MjSpec()
    for k, obstacle in enumerate((one, other)):
        turn = Rotation.from_matrix(obstacle.rotation).as_quat(scalar_first=True)
        shape = {"type": getattr(mujoco.mjtGeom, f"mjGEOM_{obstacle.kind.name}"), "size": obstacle.size}
        geom = spec.worldbody.add_geom(**shape, pos=obstacle.position, quat=turn)
        if obstacle.kind is Kind.MESH:
            spec.add_mesh(name=f"mesh{k}", uservert=obstacle.vertices.ravel().tolist())
            geom.meshname = f"mesh{k}"
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return mujoco.mj_geomDistance(model, data, 0, 1, 100.0, None)


@pytest.mark.parametrize("seed", range(4))
def test_upright_solids_are_joined_exactly_if_the_robot_is_wider_than_their_gap(seed):
    rng, tried = np.random.default_rng([2, seed]), 0

    def drawn():
        size, place = rng.uniform(0.1, 1.0, 3), rng.uniform(-2, 2, 2)
        return size, place, Rotation.from_euler("z", rng.uniform(0, 6))

    while tried < 40:
        pair = [solid(rng.choice(list(Kind)), *drawn()) for _ in range(2)]
        gap = gap_in_mujoco(*pair)
        if gap < 0.02:
            continue
        tried += 1
        for robot, count in ((0.5 * gap * 1.001, 1), (0.5 * gap * 0.999, 2)):
            assert len(found(*pair, half=9.0, radius=robot)) == count, pair
