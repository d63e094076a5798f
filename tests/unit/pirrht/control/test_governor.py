"""A governor lowers controls to those from which a robot can stop."""

from dataclasses import replace

import numpy as np
import pytest
from rays import scan_of

from pirrht import Footprint, FreeSpace, Plan, Scene, SingleIntegrator
from pirrht.control.governor import TUNING, GovernedLaw, Governor, governed
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.solids import discs
from pirrht.mapping.blind_side import BlindSide
from pirrht.mapping.occupancy import OccupancyMap
from pirrht.systems.rover import Rover

TASK = {"lower": (0, 0), "upper": (8, 4), "start": (0.6, 2.0), "goal": (7.5, 0.5, 0.3)}
WALL = [4.0, 1.0, 4.4, 3.0]
DECELERATION = 3.0
LAG = 0.12  # of the plant [s]


def governor(**shape) -> Governor:
    space = FreeSpace.of(Scene.from_boxes([WALL], **TASK, **(shape or {"robot_radius": 0.2})))
    return Governor(dynamics=Rover(b=0.05), static=space.static, deceleration=DECELERATION)


def test_a_control_from_which_the_robot_stops_is_left_alone():
    u = np.array([1.5, 0.5])
    np.testing.assert_array_equal(governor().admissible(np.array([1.0, 2.0, 0.0]), u), u)


@pytest.mark.parametrize(
    "shape", [{}, pytest.param({"footprint": Footprint.rectangle(0.508, 0.43)}, marks=pytest.mark.slow)]
)
def test_a_robot_that_lags_and_brakes_never_meets_the_wall_that_it_is_driven_at(shape):
    """The plant goes on at its speed for the lag, then loses 3 m/s each second until it has what is admissible."""
    rng = np.random.default_rng(0)
    g = governor(**shape)
    h = 0.02
    for _ in range(8):
        x = np.array([rng.uniform(0.6, 2.0), rng.uniform(1.4, 2.6), rng.uniform(-0.1, 0.1)])
        speed = wanted = rng.uniform(0.5, 2.0)
        pending = [speed] * round(LAG / h)
        for _ in range(450):
            pending.append(g.admissible(x, np.array([wanted, 0.0]))[0])
            asked = pending.pop(0)
            speed += np.clip(asked - speed, -DECELERATION * h, DECELERATION * h)
            x = g.dynamics.step(x, np.array([speed, 0.0]), np.zeros(2), h)
            assert g.static.kernels.clearance(g.static, tuple(x)[: 2 + g.static.kernels.turns]) > -0.02
        assert speed == pytest.approx(0.0, abs=0.05)


def test_the_share_keeps_the_curvature_and_falls_towards_a_wall():
    g = governor()
    u = np.array([2.0, 0.4])
    shares = []
    for x in np.arange(1.0, 3.8, 0.2):
        found = g.admissible(np.array([x, 2.0, 0.0]), u)
        if found[0] > 0.0:
            assert found[1] / found[0] == pytest.approx(0.2)
        shares.append(found[0] / u[0])
    assert shares[0] == 1.0
    assert shares[-1] < 0.3
    assert all(np.diff(shares) <= 1e-12)


def test_at_a_wall_the_robot_still_turns_on_the_spot_and_leaves_a_margin_backwards():
    g = governor()
    at_wall = np.array([3.795, 2.0, 0.0])
    np.testing.assert_allclose(g.admissible(at_wall, np.array([1.0, 2.0])), [0.0, 2.0], atol=1e-9)
    inside = np.array([3.85, 2.0, 0.0])
    assert g.admissible(inside, np.array([-0.5, 0.0]))[0] == -0.5
    assert g.admissible(inside, np.array([0.5, 0.0]))[0] == 0.0


def test_a_governed_law_keeps_a_share_for_a_while_and_is_the_law_where_nothing_is_near():
    g = governor()
    law = GovernedLaw(lambda x, s: np.array([1.0 + s, 0.2]), g)
    np.testing.assert_allclose(law(np.array([1.0, 2.0, 0.0]), 0.0), [1.0, 0.2])
    near = np.array([3.7, 2.0, 0.0])
    before = law(near, 0.5 * TUNING.every)
    assert before[0] == pytest.approx(1.0 + 0.5 * TUNING.every)  # the share of before
    assert law(near, 1.5 * TUNING.every)[0] < 0.5


@pytest.mark.parametrize("looks", [True, False])
def test_a_robot_that_reverses_turns_to_look_and_meets_no_wall_that_its_lidar_never_showed(looks: bool):
    """Driven blindly it meets each; wheels follow at once here."""
    task = {**TASK, "footprint": Footprint.rectangle(0.508, 0.43)}
    truth = FreeSpace.of(Scene.from_boxes([WALL], **task))
    bare = Scene.from_boxes(np.empty((0, 4)), **task)
    for y in (1.4, 2.0, 2.6):
        x = np.array([6.5, y, 0.0])
        blind = BlindSide(grid=OccupancyMap(bare.lower, bare.upper), footprint=bare.footprint)
        clearances = []
        for k in range(40):
            blind.scan = scan_of(truth.scene.obstacles, x, fov=1.5 * np.pi)
            blind.grid.integrate(blind.scan, free_around=bare.footprint.inscribed)
            known = FreeSpace.of(blind.grid.scene(bare), 0.05)
            g = Governor(
                dynamics=Rover(b=0.05), static=known.static, deceleration=DECELERATION, now=0.1 * k,
                blind=blind if looks else None,
            )  # fmt: skip
            law = GovernedLaw(lambda x, s: np.array([-1.5, 0.0]), g)
            for s in np.arange(0.0, 0.1, 0.02):
                x = g.dynamics.step(x, law(x, s), np.zeros(2), 0.02)
                clearances.append(truth.static.kernels.clearance(truth.static, tuple(x)))
        assert (min(clearances) > 0.0) == looks


def looking(walls: list[list[float]], x: np.ndarray) -> Governor:
    """Of a cart that has seen walls from a state, with a lidar that leaves a gap at its back."""
    task = {**TASK, "footprint": Footprint.rectangle(0.508, 0.43)}
    space = FreeSpace.of(Scene.from_boxes(walls, **task))
    blind = BlindSide(grid=OccupancyMap(space.scene.lower, space.scene.upper), footprint=space.scene.footprint)
    blind.scan = scan_of(space.scene.obstacles, x, fov=1.5 * np.pi)
    blind.grid.integrate(blind.scan)
    return Governor(dynamics=Rover(b=0.05), static=space.static, deceleration=DECELERATION, blind=blind)


def test_a_look_goes_on_whatever_the_law_wants_meanwhile_and_is_the_only_one_near_its_place():
    x = np.array([6.0, 2.0, 0.0])
    g = looking([WALL], x)
    turned = []
    for s in np.arange(0.0, 2.0, 0.02):
        asked = np.array([-1.0, -3.0 if s else 3.0])
        u = g.admissible(x, asked, s)
        if u[0] < -0.1:
            break
        np.testing.assert_allclose(u, [0.0, TUNING.look_rate], atol=1e-9)
        turned.append(u[1] * 0.02)
        x = g.dynamics.step(x, u, np.zeros(2), 0.02)
    assert np.sum(turned) == pytest.approx(TUNING.look_angle, abs=0.04)
    again = g.admissible(x, np.array([-1.0, 0.0]), s + 0.02)  # it may be hidden still
    assert again[0] <= -TUNING.unseen_speed + 1e-9
    assert again[1] == pytest.approx(0.0, abs=1e-9)


def test_where_there_is_no_room_to_turn_the_robot_backs_out_slowly_and_steers_as_before():
    x = np.array([5.0, 2.0, 0.0])
    narrow = looking([[3.0, 2.3, 7.0, 2.5], [3.0, 1.5, 7.0, 1.7]], x)
    u = narrow.admissible(x, np.array([-1.2, 0.3]))
    np.testing.assert_allclose(u, [-TUNING.unseen_speed, 0.3], atol=1e-9)
    assert narrow.blind.heading is None


def test_decisions_on_what_was_earlier_change_no_look():
    x = np.array([6.0, 2.0, 0.0])
    g = looking([WALL], x)
    g.blind.time = 5.0
    u = np.array([-1.0, 0.5])
    np.testing.assert_array_equal(g.admissible(x, u, 4.9), u)
    assert g.blind.heading is None
    g.admissible(x, u, 5.0)
    assert g.blind.heading == pytest.approx(TUNING.look_angle)


def share(x: float, y: float, velocity: tuple[float, float], now: float = 0.0, *, sure: bool = True) -> float:
    """Of 1 m/s to the right from (1, 2) while a disc of 0.3 m is at a place at 0 s and moves."""
    ends = np.array([(x, y), np.add((x, y), np.multiply(10.0, velocity))])
    rows = np.column_stack([[0.0, 10.0], ends, np.zeros(2)])
    mover = Mover(name="one", solids=discs([[0, 0, 0.3]], 1.0), motion=Motion(rows=rows))
    space = FreeSpace.of(Scene.from_boxes([WALL], **TASK, robot_radius=0.2)).with_blockers([mover])
    dynamics = SingleIntegrator(b=0.1)
    slow = Governor(dynamics=dynamics, static=space.static, moving=space.moving, now=now, deceleration=2.0, sure=sure)
    return float(slow.admissible(np.array([1.0, 2.0]), np.array([1.0, 0.0]))[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("x", "y", "velocity", "now", "least", "most"),
    [(1.7, 2, (0, 0), 0, 0.2, 0.8), (3.0, 2, (0, 0), 0, 1, 1),  # it stands, near and far
     (1.75, 2, (-0.8, 0), 0, 0, 0.3), (1.75, 2, (0.8, 0), 0, 1, 1),  # it comes, and goes away
     (1.6, 1.2, (0, 2), 0, 0, 0.8), (1.6, 1.2, (0, 2), 1.0, 1, 1)],  # it crosses, and has crossed
)  # fmt: skip
def test_a_robot_keeps_to_a_speed_from_which_it_stops_before_a_moving_obstacle(x, y, velocity, now, least, most):
    assert least <= share(x, y, velocity, now) <= most


@pytest.mark.slow
def test_an_obstacle_whose_motion_is_only_predicted_may_stop_at_any_time():
    near, far = 1.7, 2.0
    assert share(near, 2, (0.8, 0), sure=False) == share(near, 2, (0, 0)) < 1.0
    assert share(far, 2, (0.8, 0), sure=False) == 1.0
    assert share(1.75, 2, (-0.8, 0), sure=False) <= 0.3  # or go on


@pytest.mark.parametrize(("x", "least"), [(1.0, 2.0), (3.1, 0.5), (3.6, 0.0)])
def test_a_plan_whose_control_is_held_is_governed_too_and_a_fallback(x: float, least: float):
    g = governor()
    held = Plan(
        state=np.array([1.0, 2.0, 0.0]), times=np.array([0.0, 0.1]), instead=np.array([[2.0, 0.0]]), references=(),
        ids=(), estimate=None, fallback=None,
    )  # fmt: skip
    speed = governed(held, g.dynamics, g.static, DECELERATION).at(np.array([x, 2.0, 0.0]), 0.0)[0]
    assert least <= speed <= 2.0
    assert speed * LAG + speed**2 / (2.0 * DECELERATION) <= 3.8 - x
    flees = replace(held, fallback="no survivor", law=lambda x, s: np.array([3.0, 0.0]))
    assert governed(held, g.dynamics, g.static, 0.0) is held
    fled = governed(flees, g.dynamics, g.static, DECELERATION).at(np.array([x, 2.0, 0.0]), 0.0)[0]
    assert fled * LAG + fled**2 / (2.0 * DECELERATION) <= 3.8 - x
