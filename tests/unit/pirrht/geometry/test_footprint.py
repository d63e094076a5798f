"""Footprints with a heading: their cover by discs, clearances against FCL, and certificates of motions."""

from dataclasses import replace
from typing import Any

import fcl
import numpy as np
import pytest

from pirrht import Footprint, FreeSpace, OptionError, Problem, Scene, SceneError, SingleIntegrator
from pirrht.control.map_update import renewed
from pirrht.geometry import blocks, solids
from pirrht.geometry.collision import solid_of
from pirrht.geometry.footprint import cover, depths, placed
from pirrht.geometry.hulls import HullCollision
from pirrht.geometry.polygon import POLYGON, Polygon, certify_turn, clearances, walls
from pirrht.geometry.scene import Workspace
from pirrht.geometry.space import BLOCKED, COLLISION, FREE, INSIDE, NEVER
from pirrht.geometry.world import World
from pirrht.systems.rover import Rover

SIDE, SLICE = 5.0, 0.02  # of the workspace, and height of the prism that FCL gets [m]
CART = Footprint.rectangle(1.0, 0.4, 0.1)
HEXAGON = Footprint.polygon(0.35 * np.array([(np.cos(a), np.sin(a)) for a in np.pi / 3 * np.arange(6)]))
WEDGE = Footprint.polygon([(-0.2, -0.25), (0.6, 0.0), (-0.2, 0.25)])
SHAPES = [CART, HEXAGON, WEDGE, Footprint.rectangle(4.5, 1.8, 1.35), CART.grown(0.05)]


def clutter(seed: int, boxes: int = 14, poles: int = 8) -> Workspace:
    rng = np.random.default_rng(seed)
    corner = rng.uniform(0.0, SIDE, (boxes, 2))
    rows = np.column_stack((corner, corner + rng.uniform(0.03, 0.5, (boxes, 2)), rng.uniform(0.0, 3.0, boxes)))
    discs = np.column_stack((rng.uniform(0.0, SIDE, (poles, 2)), rng.uniform(0.01, 0.3, poles)))
    return Workspace(np.zeros(2), np.full(2, SIDE), solids.boxes(rows, 0.5) + solids.discs(discs, 0.5))


def poses_in(world: Workspace, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    places = rng.uniform(world.lower + 0.01, world.upper - 0.01, (count, 2))
    return np.column_stack((places, rng.uniform(-np.pi, np.pi, count)))


def fcl_contacts(world: Workspace, footprint: Footprint, poses: np.ndarray) -> np.ndarray:
    """Whether FCL finds a contact of a thin prism at poses (k, 3), (k,)."""
    k, others = len(footprint.hull), [solid_of(obstacle) for obstacle in world.obstacles]
    vertices = np.vstack([np.column_stack((footprint.hull, np.full(k, z))) for z in (-0.5 * SLICE, 0.5 * SLICE)])
    sides = [[4, i, (i + 1) % k, k + (i + 1) % k, k + i] for i in range(k)]
    faces = [[k, *reversed(range(k))], [k, *range(k, 2 * k)], *sides]
    prism = fcl.Convex(vertices, len(faces), np.concatenate(faces))
    met = []
    for x, y, th in poses:
        turned = np.array([[np.cos(th), -np.sin(th), 0.0], [np.sin(th), np.cos(th), 0.0], [0.0, 0.0, 1.0]])
        robot = fcl.CollisionObject(prism, fcl.Transform(turned, np.array([x, y, footprint.height])))
        met.append(any(fcl.collide(robot, o, fcl.CollisionRequest(), fcl.CollisionResult()) for o in others))
    return np.array(met)


@pytest.mark.parametrize(
    ("points", "says"),
    [
        ([(0, 0), (1, 0)], "no polygon of three or more corners"),
        ("square", "no polygon"),
        ([(1, 1), (-1, 1), (-1, -1), (1, -1)][::-1], "clockwise"),
        ([(1, -1), (0.2, 0), (1, 1), (-1, 1), (-1, -1)], "not convex"),
        ([(1, 0), (-1, 1), (0.5, -1), (0.5, 1), (-1, -1)], "not convex"),
        ([(1, 0), (2, 0), (2, 1)], "reference point"),
        ([(1, -1), (1, 1), (1, 1), (-1, 1), (-1, -1)], "the same"),
        ([(1e4, -1), (1, 1), (-1, 1)], "at most 1000 m"),
        ([(1, -1), (1, 0), (1, 1), (-1, 1), (-1, -1)], "straight at a corner"),
        ([(np.nan, -1), (1, 1), (-1, 1)], "no polygon"),
    ],
)
@pytest.mark.parametrize("make", [Footprint.polygon, Footprint])
def test_what_is_no_convex_polygon_around_the_reference_point_is_refused(make: Any, points: object, says: str):
    with pytest.raises(SceneError, match=says):
        make(points)


@pytest.mark.parametrize("offset", [9.0, -0.5, np.nan])
def test_an_offset_that_puts_the_reference_point_outside_of_a_rectangle_is_refused_by_those_that_work(offset: float):
    with pytest.raises(SceneError, match=rf"offset is {offset:g} m.*outside.* between -0.25 and 0.25 m works"):
        Footprint.rectangle(0.5, 0.3, offset)


def test_a_scene_takes_a_radius_or_a_footprint_whose_inscribed_disc_it_then_plans_with():
    room = {"lower": (0, 0), "upper": (4, 3), "start": (0.6, 1.4), "goal": (3.4, 1.5, 0.3)}
    disc = Scene.from_boxes([[1.6, 1.1, 2.4, 1.9]], robot_radius=0.2, **room)
    cart = Scene.from_boxes([[1.6, 1.1, 2.4, 1.9]], footprint=CART, robot_height=0.3, **room)
    assert disc.footprint == Footprint.disc(0.2)
    assert (cart.robot_radius, cart.footprint.height) == (CART.inscribed, 0.3)
    with pytest.raises(SceneError, match="robot radius"):
        Scene.from_boxes([], **room)
    with pytest.raises(SceneError, match="give one of them"):
        Scene.from_boxes([], robot_radius=0.2, footprint=CART, **room)


@pytest.mark.parametrize("shape", SHAPES, ids=repr)
def test_an_outline_lies_between_inscribed_disc_and_reach_and_turns_with_the_heading(shape: Footprint):
    away = np.hypot(*shape.outline.T)
    assert away.max() == pytest.approx(shape.reach, rel=1e-3)
    assert away.min() >= shape.inscribed * (1.0 - 1e-9)
    assert shape.at(np.array([1.0, 2.0, np.pi]))[0] == pytest.approx(np.array([1.0, 2.0]) - shape.outline[0])


@pytest.mark.parametrize("shape", SHAPES, ids=repr)
@pytest.mark.parametrize("excess", [0.003, 0.01])
def test_discs_of_a_cover_contain_the_polygon_and_reach_no_more_than_the_excess_beyond(shape: Footprint, excess: float):
    hull, discs = shape.hull, cover(shape, excess)
    points = np.random.default_rng(1).uniform(hull.min(axis=0), hull.max(axis=0), (5_000, 2))
    points = np.vstack((points[depths(hull, points) <= 0.0], hull, 0.5 * (hull + np.roll(hull, 1, axis=0))))
    held = np.hypot(*np.moveaxis(points[:, None] - discs[:, :2], -1, 0)) <= discs[:, 2] - shape.rounding
    assert held.any(axis=1).all()
    assert (discs[:, 2] + depths(hull, discs[:, :2])).max() <= shape.rounding + excess * (1.0 + 1e-9)


@pytest.mark.parametrize(("shape", "dense"), [(CART, True), (CART, False), (HEXAGON, True), (WEDGE, False)])
def test_no_clearance_is_unsafe_by_fcl_nor_off_by_more_than_a_centimetre_where_walls_are_near(
    shape: Footprint, dense: bool, monkeypatch
):
    world = clutter(3)
    poses = poses_in(world, 2000, 7)
    if not dense:
        monkeypatch.setattr(blocks, "TUNING", blocks.TUNING._replace(dense_points=0))
    polygon, exact = Polygon.of(world, shape, range(len(world.obstacles))), HullCollision(world, shape)
    quick = np.empty(len(poses))
    clearances(polygon, poses, quick)
    contact, true = fcl_contacts(world, shape, poses), exact.clearance(poses)
    assert np.array_equal(true <= 0.0, contact)
    assert not np.any((quick > 0.0) & contact)
    near, farther = (true > 0.0) & (true < 0.05), (true > 0.0) & (true < 0.1)
    off = true - quick
    assert near.sum() > 40
    assert off[true > 0.0].min() >= -1e-7
    assert off[near].max() <= 0.01
    assert off[farther].max() <= 0.031
    verdicts = np.array([POLYGON.certify(polygon, tuple(pose)) for pose in poses.tolist()])
    assert not np.any((verdicts == BLOCKED) & ~contact)


@pytest.mark.parametrize("shape", [Footprint.rectangle(4.5, 1.8, 1.35), CART.grown(0.05)], ids=repr)
def test_a_long_car_and_a_rounded_cart_meet_what_prisms_in_and_around_them_meet(shape: Footprint):
    """2 000 poses; the arcs of an outline lie between the rounding and its chords."""
    scale = 1.0 / np.cos(np.pi / 30.0) if shape.rounding else 1.0
    around = shape.hull if not shape.rounding else replace(shape, rounding=scale * shape.rounding).outline
    world = clutter(3, boxes=1, poles=2) if shape.reach > 1.0 else clutter(3)
    poses = poses_in(world, 2000, 7)
    exact = HullCollision(world, shape)
    quick = np.empty(len(poses))
    clearances(Polygon.of(world, shape, range(len(world.obstacles))), poses, quick)
    inner, outer = (fcl_contacts(world, Footprint.polygon(hull), poses) for hull in (shape.outline, around))
    true = exact.clearance(poses)
    assert not np.any((true > 0.0) & inner)
    assert not np.any((true <= 0.0) & ~outer)
    assert not np.any((quick > 0.0) & inner)
    near = (true > 0.0) & (true < 0.05)
    assert near.sum() > 10
    assert (true - quick)[near].max() <= 0.01


def test_a_pole_thinner_than_a_finger_is_met_wherever_it_is_in_the_footprint():
    lattice = np.stack(np.meshgrid(np.linspace(-0.39, 0.59, 50), np.linspace(-0.19, 0.19, 20)), axis=-1).reshape(-1, 2)
    world = Workspace(np.zeros(2), np.full(2, SIDE), solids.discs([[2.5, 2.5, 0.003]], 0.5))
    polygon, heading = Polygon.of(world, CART, [0]), 0.7
    poses = np.append(
        np.array([2.5, 2.5]) - placed(lattice, np.array([0.0, 0.0, heading])), np.full((1000, 1), heading), 1
    )
    out = np.empty(len(poses))
    clearances(polygon, poses, out)
    assert out.max() <= 0.0
    assert HullCollision(world, CART).clearance(poses).max() <= 0.0


def test_the_direction_of_a_wall_is_the_gradient_of_the_clearance():
    world = clutter(5, boxes=8, poles=4)
    polygon = Polygon.of(world, CART, range(len(world.obstacles)))
    step, checked, off = 1e-4 * np.eye(3), 0, 0
    for pose in poses_in(world, 4000, 2):
        c, direction, d, _ = walls(polygon, tuple(pose))
        if 0.01 < c < 0.04 and d - c > 0.03:
            ahead, behind = np.empty(3), np.empty(3)
            clearances(polygon, pose + step, ahead)
            clearances(polygon, pose - step, behind)
            checked += 1
            off += bool(np.abs((ahead - behind) / 2e-4 - np.array(direction)).max() > 0.15)
    assert checked > 30
    assert off <= 0.02 * checked


@pytest.mark.parametrize("shape", [CART, WEDGE, CART.grown(0.05)], ids=repr)
def test_a_straight_piece_is_free_by_the_hull_that_it_sweeps_where_a_march_along_it_is(shape: Footprint):
    world, rng = clutter(9, boxes=8, poles=4), np.random.default_rng(6)
    exact = HullCollision(world, shape)
    tails = rng.uniform(0.5, SIDE - 0.5, (150, 2))
    spans = rng.uniform(-1.0, 1.0, (150, 2))
    heading = np.arctan2(*spans.T[::-1])
    marched = [
        exact.arc_free((*tail, th), 0.0, float(np.hypot(*span)))
        for tail, th, span in zip(tails.tolist(), heading.tolist(), spans, strict=True)
    ]
    swept = exact.segments_free(tails, tails + spans)
    between = tails[:, None] + np.linspace(0.0, 1.0, 60)[:, None] * spans[:, None]
    sampled = [
        exact.clearance(np.column_stack((places, np.full(60, th)))).min()
        for places, th in zip(between, heading, strict=True)
    ]
    assert np.array_equal(swept, marched)
    assert not np.any(swept & (np.array(sampled) <= 0.0))
    assert swept.any()
    assert not swept.all()


@pytest.mark.parametrize("kind", ["arc", "turn", "sweep"])
def test_motions_that_are_certified_free_are_and_blocked_ones_are_not(kind: str):
    world = clutter(9, boxes=8, poles=4)
    polygon, exact = Polygon.of(world, CART, range(len(world.obstacles))), HullCollision(world, CART)
    goal = Scene.from_boxes([], lower=(0, 0), upper=(9, 9), start=(1, 1), goal=(8, 8, 0.1), robot_radius=0.1).goal
    arena, rng = World(polygon, (9.0, 9.0), float(goal.radius), None), np.random.default_rng(4)
    found = []
    for pose in poses_in(world, 150, 11):
        bend, length, turn = rng.uniform(-1.5, 1.5), rng.uniform(0.05, 0.6), rng.uniform(-2.0, 2.0)
        share = np.linspace(0.0, 1.0, 200)[:, None]
        ahead = pose[2] + bend * length * share
        along = np.hstack(((np.sin(ahead) - np.sin(pose[2])) / bend, (np.cos(pose[2]) - np.cos(ahead)) / bend, ahead))
        path = np.hstack((pose[:2] + along[:, :2], ahead))
        if kind == "arc":
            verdict = POLYGON.certify_curve(polygon, pose, np.array([bend]), np.array([length]), True)
        elif kind == "turn":
            path = pose + share * np.array([0.0, 0.0, turn])
            verdict = certify_turn(polygon, tuple(pose), turn)
        else:
            path = pose + share * np.array([length, 0.3 * length, turn])
            exit, until, _ = POLYGON.sweep(arena, tuple(pose), tuple(path[-1]))
            verdict = FREE if exit == INSIDE else BLOCKED if exit == COLLISION else 0
            path = path if exit == INSIDE else path[: int(200 * until) + 1]
        free = bool((exact.clearance(path) > -0.011 * (kind == "sweep" and verdict == BLOCKED)).all())
        assert free if verdict == FREE else True
        assert not (exact.clearance(path) > 0.012).all() if verdict == BLOCKED else True
        found.append(verdict)
    assert {FREE, BLOCKED} <= {*found}


def test_a_noisy_step_survives_next_to_a_wall_as_often_as_its_fine_steps_do():
    world = Workspace(np.zeros(2), np.full(2, SIDE), solids.boxes([[0.0, 0.0, SIDE, 1.0]], 0.5))
    rng = np.random.default_rng(0)
    arena = World(Polygon.of(world, CART, [0], excess=0.002), (4.9, 4.9), 0.05, None)
    pose, noise, dt, fine, many = np.array([2.0, 1.345, 0.35]), np.array([0.05, 0.05, 0.25]), 0.05, 400, 3000
    cov = tuple((np.diag(noise**2) * dt)[np.triu_indices(3)].tolist())
    steps = rng.standard_normal((many, fine, 3)) * noise * np.sqrt(dt / fine)
    least = np.full(many, np.inf)
    now = np.tile(pose, (many, 1))
    for k in range(fine):
        now = now + steps[:, k]
        height = placed(CART.hull, now)[..., 1].min(axis=1) - 1.0
        least = np.minimum(least, height)
    between = 0.5826 * np.std(height - 1.0) / np.sqrt(fine)  # by which paths come nearer between fine steps
    simulated, survived, before = float((least > between).mean()), 0.0, POLYGON.distances(arena, tuple(pose))
    for end in now:
        *_, exit, _, lasting = POLYGON.bridge(
            arena, tuple(pose), tuple(end), before, POLYGON.distances(arena, tuple(end)), cov, True, np.uint64(1), False
        )
        survived += float(np.exp(lasting)) / many if exit == INSIDE else 0.0
    assert 0.2 < simulated < 0.95
    assert survived == pytest.approx(simulated, abs=0.03)
    assert before[0] < NEVER


def test_a_polygon_needs_a_heading_and_free_room_at_the_start_for_that_heading():
    room = {"lower": (0, 0), "upper": (4, 3), "goal": (3.4, 1.5, 0.3), "footprint": CART}
    with pytest.raises(OptionError, match="has no heading among its states"):
        Problem(scene=Scene.from_boxes([], start=(0.6, 1.4), **room), dynamics=SingleIntegrator(b=0.1), R=np.eye(2))
    wall = [[0.0, 0.0, 4.0, 1.0]]
    assert FreeSpace.of(Scene.from_boxes(wall, start=(1.0, 1.3, 0.0), **room)).static.kernels.turns
    for pose, share in ((1.0, 1.3, 1.5), 72.6), ((1.0, 1.2388, 0.1), 99.9):
        with pytest.raises(SceneError, match=f"at its heading .* of at most {share} % of its size"):
            FreeSpace.of(Scene.from_boxes(wall, start=pose, **room))
        fits = replace(CART, corners=tuple((share / 100.0 * x, share / 100.0 * y) for x, y in CART.corners))
        FreeSpace.of(Scene.from_boxes(wall, start=pose, **{**room, "footprint": fits}))


def test_noise_of_the_heading_moves_corners_and_a_plan_begins_off_the_wall_by_what_it_wants():
    room = {"lower": (0, 0), "upper": (5, 5), "start": (2, 3, 0.35), "goal": (4, 4, 0.3)}
    scene = Scene.from_boxes([[0.0, 0.0, 5.0, 1.0]], footprint=CART, **room)
    disc = Scene.from_boxes([[0.0, 0.0, 5.0, 1.0]], robot_radius=0.2, **room)
    cart, puck = (Problem(dynamics=Rover(b=0.1), scene=one, R=np.diag([2.0, 0.5])) for one in (scene, disc))
    assert cart.clearance_spread(scene.start) == pytest.approx(0.1 + 0.2 * CART.reach)
    assert puck.clearance_spread(scene.start) == pytest.approx(0.1)
    space, deep = FreeSpace.of(scene), np.array([2.0, 1.32, 0.35])
    assert -0.02 < space.world.clearance(tuple(deep)) < 0.0
    assert 0.0 < space.clearance(space.world.off_walls(deep, (0, 1, 2), 0.0, 0.002)) < 0.012
    longer = replace(scene, footprint=Footprint.rectangle(1.2, 0.4, 0.1))
    assert renewed(cart, space, None, scene, None) is None
    assert renewed(cart, space, None, longer, None) is not None
