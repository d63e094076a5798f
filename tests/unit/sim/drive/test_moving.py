"""Bodies that move are in the plant where their motions say, and what they run over has collided."""

from __future__ import annotations

import numpy as np
import pytest
from moving_scenes import body, moving_scene, rows

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Workspace
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.systems.unicycle import Unicycle
from sim.drive.executor import Executor
from sim.drive.plant import Advance, Analytic
from sim.mjcf import Loaded, load

QUIET = 1e-12
STEP = 0.002
EVERYWHERE = np.full(2, np.inf)


def plants(loaded: Loaded, dynamics: Dynamics, period: float) -> tuple[Executor, Analytic]:
    problem = Problem(dynamics=dynamics, scene=loaded.scene, R=2 * np.eye(dynamics.m))
    clearance = Collision(loaded.scene.world, loaded.scene.footprint).clearance
    return (
        Executor(loaded, problem, period=period),
        Analytic(problem, clearance, period=period, physics_step=STEP),
    )


def still(m: int):
    return lambda x, s: np.zeros(m)


def quat(yaw: float) -> Array:
    return np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])


SPIN = "0 -3 2 0.5  0.105 -2.5 2.25 1.5  0.3 -4 3 -2"
SLIDE = "0 3 -2 0  0.2 3.5 -2 0"


def test_mujocos_bodies_stand_at_every_physics_step_where_their_motions_say_across_periods_and_laps(tmp_path):
    yaw = np.degrees(0.5)
    world = body("spin", 'type="box" size=".2 .1 .2" pos=".1 0 0"', "-3 2 0.3", more=f'euler="0 0 {yaw:.12f}"')
    world += '<body name="post" mocap="true" pos="5 5 0.1"><geom name="post" size=".1"/></body>'
    world += body("slide", 'type="cylinder" size=".1 .1"', "3 -2 0.1")
    path = moving_scene(tmp_path, world, rows("spin", SPIN, repeat=True) + rows("slide", SLIDE))
    loaded = load(path)
    plant, _ = plants(loaded, SingleIntegrator(b=QUIET), 7 * STEP)
    asked, data = [], plant.data
    heights = {"spin": 0.3, "slide": 0.1}

    def control(x: Array, s: float) -> Array:
        asked.append(plant.time)
        for mover in loaded.scene.movers:
            x, y, yaw = mover.motion.pose(plant.time)
            found = data.body(mover.name)
            np.testing.assert_array_equal(found.xpos, [x, y, heights[mover.name]])
            sign = np.sign(found.xquat @ quat(yaw))
            np.testing.assert_allclose(sign * found.xquat, quat(yaw), atol=1e-12)
            [geom] = mover.at(plant.time)
            np.testing.assert_allclose(data.geom(mover.name).xpos, geom.position, atol=1e-12)
            np.testing.assert_allclose(data.geom(mover.name).xmat.reshape(3, 3), geom.rotation, atol=1e-9)
        return np.zeros(2)

    rng = np.random.default_rng(0)
    for _ in range(50):  # 0.7 s: two laps and more; poses are found 64 steps at a time
        assert plant.advance(control, rng).outcome is None
    np.testing.assert_array_equal(asked, STEP * np.arange(350))
    np.testing.assert_array_equal(data.body("post").xpos, [5, 5, 0.1])


def test_a_tilted_body_turns_about_the_vertical_and_keeps_its_tilt(tmp_path):
    world = body("tilt", 'type="box" size=".3 .2 .05"', "2 0 0.1", more='euler="20 0 0"')
    loaded = load(moving_scene(tmp_path, world, rows("tilt", "0 2 0 0  0.1 2 0 3")))
    plant, _ = plants(loaded, SingleIntegrator(b=QUIET), 50 * STEP)
    flat = plant.data.geom("tilt").xmat.reshape(3, 3).copy()
    plant.advance(still(2), np.random.default_rng(0))
    c, s = np.cos(3.0), np.sin(3.0)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(plant.data.geom("tilt").xmat.reshape(3, 3), turn @ flat, atol=1e-12)
    [solid] = loaded.scene.movers[0].at(0.1)
    np.testing.assert_allclose(solid.rotation, turn @ flat, atol=1e-12)


def hit(plant: Executor | Analytic, m: int, periods: int = 200, seed: int = 0) -> tuple[float, Advance]:
    """The time of the collision of a robot that rests."""
    plant.reset(np.zeros(3))
    rng = np.random.default_rng(seed)
    for _ in range(periods):
        advance = plant.advance(still(m), rng)
        if advance.outcome is not None:
            assert advance.outcome is Outcome.COLLISION
            assert advance.clearance == 0.0
            return plant.time, advance
    raise AssertionError("nothing ran it over")


OVER = {  # world, motion, when a disc of 0.1 m at the origin is touched
    "a disc at 1.3 m/s": (
        body("b", 'type="cylinder" size=".3 .2"', "2 0 0.1"),
        rows("b", "0 2 0 0  2 -0.6 0 0"),
        (2 - 0.4) / 1.3,
    ),
    "a wall, later": (
        body("b", 'type="box" size=".05 3 .2"', "-1 0 0.1"),
        rows("b", "0 -1 0 0  0.5 -1 0 0  1.5 1 0 0"),
        0.5 + 0.85 / 2,
    ),
    "a bar that turns": (
        body("b", 'type="box" size="2 .05 .2"', "0 -1 0.1"),
        rows("b", "0 0 -1 0  1 0 -1 1.5"),
        None,
    ),
}


@pytest.mark.parametrize("case", OVER)
@pytest.mark.parametrize("period", [STEP, 0.1])
def test_a_resting_robot_that_is_run_over_collides_when_the_geometry_says(tmp_path, case, period):
    world, custom, when = OVER[case]
    loaded = load(moving_scene(tmp_path, world, custom))
    if when is None:  # the bar's upper side, at angle a above its lower right, is 0.1 from the origin
        motion = loaded.scene.movers[0].motion
        times = np.linspace(0, 1, 100001)
        yaws = motion.pose(times)[:, 2]
        when = float(times[np.argmax(np.cos(yaws) - 0.05 <= 0.1)])  # distance of the origin from the bar's middle line
    for plant in plants(loaded, SingleIntegrator(b=QUIET), period):
        time, _ = hit(plant, 2, periods=round(2 / period))
        assert when - 1e-6 <= time <= when + STEP + 1e-6


def test_what_is_smaller_than_its_footprint_is_run_over_when_its_own_shape_is(tmp_path):
    world = body("b", 'type="box" size=".05 3 .2"', "1 0 0.1")
    loaded = load(moving_scene(tmp_path, world, rows("b", "0 1 0 0  1 0 0 0")), robot="unicycle")
    plant, analytic = plants(loaded, Unicycle(V=1e-9, b=QUIET), 0.1)
    assert hit(plant, 1)[0] > hit(analytic, 1)[0] + 2 * STEP
    gap = min(
        plant.data.geom(int(g)).xpos[0] for g in np.flatnonzero(loaded.moving_geoms & loaded.obstacle_geoms)
    )  # where the body is now
    assert 0.05 < gap < 0.05 + loaded.scene.robot_radius


THIN = body("thin", 'type="box" size=".002 3 .2"', "{x} 0 0.1")


@pytest.mark.parametrize("robot", ["puck", "unicycle"])
@pytest.mark.parametrize("x", [1.0, 1.1, 1.23])
def test_a_fast_thin_body_does_not_pass_through_the_robot_within_a_step(tmp_path, robot, x):
    """300 m/s are 0.6 m a step: on either side of the robot and never in it, at the ends of steps."""
    custom = rows("thin", f"0 {x} 0 0  0.01 {x - 3} 0 0")
    loaded = load(moving_scene(tmp_path, THIN.format(x=x), custom), robot=robot)
    dynamics = SingleIntegrator(b=QUIET) if robot == "puck" else Unicycle(V=1e-9, b=QUIET)
    for plant in plants(loaded, dynamics, STEP):
        time, _ = hit(plant, dynamics.m)
        reach = loaded.scene.robot_radius + 0.002
        assert (x - reach) / 300 - 1e-9 <= time <= (x + reach) / 300 + STEP


def test_a_fast_thin_body_that_misses_the_robots_own_shape_has_not_met_it(tmp_path):
    """It cuts the footprint, a ball around the unicycle, where the unicycle has nothing."""
    world = body("thin", 'type="box" size=".002 .002 .2"', "1 0.149 0.1")
    custom = rows("thin", "0 1 0.149 0  0.01 -2 0.149 0")
    loaded = load(moving_scene(tmp_path, world, custom), robot="unicycle")
    assert loaded.scene.robot_radius > 0.149
    plant, analytic = plants(loaded, Unicycle(V=1e-9, b=QUIET), 0.02)
    assert plant.advance(still(1), np.random.default_rng(0)).outcome is None
    assert analytic.advance(still(1), np.random.default_rng(0)).outcome is Outcome.COLLISION


def test_a_robot_that_runs_into_what_comes_meets_it_halfway(tmp_path):
    world = body("b", 'type="cylinder" size=".3 .2"', "3 0 0.1")
    loaded = load(moving_scene(tmp_path, world, rows("b", "0 3 0 0  3 -3 0 0")))
    for plant in plants(loaded, SingleIntegrator(b=QUIET), 3.0):
        advance = plant.advance(lambda x, s: np.array([1.5, 0.0]), np.random.default_rng(0))
        assert advance.outcome is Outcome.COLLISION
        assert advance.time == pytest.approx(2.6 / 3.5, abs=STEP)


def test_a_robot_that_flees_as_fast_is_not_met_however_thin_the_gap(tmp_path):
    world = body("b", 'type="box" size=".1 3 .2"', "-0.201 0 0.1")
    loaded = load(moving_scene(tmp_path, world, rows("b", "0 -0.201 0 0  1 4.799 0 0")))
    for plant in plants(loaded, SingleIntegrator(b=QUIET), 0.5):
        advance = plant.advance(lambda x, s: np.array([5.0, 0.0]), np.random.default_rng(0))
        assert advance.outcome is None
        assert advance.clearance == pytest.approx(0.001, abs=1e-6)


def driven(plant: Executor | Analytic, periods: int) -> Array:
    rng, states = np.random.default_rng(3), []
    for _ in range(periods):
        states.append(plant.advance(lambda x, s: np.array([np.cos(x[1]), 0.3]), rng).states)
    return np.concatenate(states)


def test_periods_of_any_length_make_the_same_drive(tmp_path):
    world = body("b", 'type="cylinder" size=".3 .2"', "1 2 0.1")
    loaded = load(moving_scene(tmp_path, world, rows("b", "0 1 2 0  0.13 1 1 0", repeat=True)))
    for k in (0, 1):
        long = plants(loaded, SingleIntegrator(b=0.2), 0.6)[k]
        short = plants(loaded, SingleIntegrator(b=0.2), 0.02)[k]
        np.testing.assert_array_equal(driven(long, 1), driven(short, 30))
        assert long.time == pytest.approx(short.time, abs=1e-12)


def test_the_clock_starts_where_a_reset_says_and_at_zero_if_it_says_nothing(tmp_path):
    world = body("b", 'type="cylinder" size=".3 .2"', "9 9 0.1")
    loaded = load(moving_scene(tmp_path, world, rows("b", "0 9 9 0  2 5 9 0")))
    for plant in plants(loaded, SingleIntegrator(b=0.1), 0.1):
        assert plant.time == 0.0
        plant.reset(np.zeros(2), time=1.0)
        assert plant.time == 1.0
        plant.advance(still(2), np.random.default_rng(0))
        assert plant.time == pytest.approx(1.1)
        if isinstance(plant, Executor):
            np.testing.assert_allclose(plant.data.body("b").xpos, [6.8, 9, 0.1])
        plant.reset(np.zeros(2))
        assert plant.time == 0.0
        if isinstance(plant, Executor):
            np.testing.assert_array_equal(plant.data.body("b").xpos, [9, 9, 0.1])


def test_the_clock_runs_in_a_world_that_stands_too():
    loaded = load("slit")
    for plant in plants(loaded, SingleIntegrator(b=QUIET), 0.1):
        times = []
        for _ in range(3):
            plant.advance(lambda x, s, p=plant, t=times: t.append((p.time, s)) or np.zeros(2), np.random.default_rng(0))
        now, since = np.array(times).T
        np.testing.assert_allclose(now, STEP * np.arange(150), atol=1e-12)
        np.testing.assert_allclose(since, np.tile(STEP * np.arange(50), 3))


def test_a_body_passes_through_what_stands_and_through_others_as_if_nothing_were_there(tmp_path):
    world = '<geom name="wall" type="box" size=".1 1 .2" pos="2 0 .1"/>'
    world += body("a", 'type="cylinder" size=".3 .2"', "2 1.2 0.1") + body(
        "b", 'type="box" size=".3 .3 .2"', "2 -1 0.1"
    )
    custom = rows("a", "0 2 1.2 0  0.5 2 -1 0") + rows("b", "0 2 -1 0  0.5 2 1 0")
    loaded = load(moving_scene(tmp_path, world, custom))
    for plant in plants(loaded, SingleIntegrator(b=QUIET), 0.6):
        assert plant.advance(still(2), np.random.default_rng(0)).outcome is None


def test_a_jump_of_a_motion_that_starts_over_touches_nothing_on_the_way(tmp_path):
    world = body("b", 'type="cylinder" size=".3 .2"', "0 -2 0.1")
    loaded = load(
        moving_scene(tmp_path, world, rows("b", "0 0 -2 0  0.1 2 -2 0  0.2 2 2 0", repeat=True), start="4 0 0")
    )
    at = np.array([0.9, 0.0])  # on the straight way from (2, 2) back to (0, -2)
    for plant in plants(loaded, SingleIntegrator(b=QUIET), 1.0):
        plant.reset(at)
        assert plant.advance(still(2), np.random.default_rng(0)).outcome is None


def test_where_a_body_lands_when_it_starts_over_it_is_felt_at_once(tmp_path):
    world = body("b", 'type="cylinder" size=".3 .2"', "0 -2 0.1")
    path = moving_scene(tmp_path, world, rows("b", "0 0 -2 0  0.2 2 -2 0", repeat=True), start="4 0 0")
    for plant in plants(load(path), SingleIntegrator(b=QUIET), 1.0):
        plant.reset(np.array([0.0, -1.7]), time=0.15)
        advance = plant.advance(still(2), np.random.default_rng(0))
        assert advance.outcome is Outcome.COLLISION
        assert plant.time == pytest.approx(0.2, abs=STEP + 1e-9)


@pytest.mark.parametrize("robot", ["puck", "unicycle"])
def test_the_least_room_is_that_to_all_that_stands_and_moves_after_every_step(tmp_path, robot):
    world = '<geom name="wall" type="box" size=".05 3 .2" pos="1.5 0 .1"/>'
    world += body("a", 'type="cylinder" size=".2 .2"', "0 2 0.1")
    world += body("b", 'type="box" size=".3 .1 .2"', "-1 0 0.1")
    custom = rows("a", "0 0 2 0  0.3 0 0.5 0  0.6 0 2 0", repeat=True) + rows("b", "0 -1 0 0  2 -1 0 9")
    loaded = load(moving_scene(tmp_path, world, custom), robot=robot)
    dynamics = SingleIntegrator(b=0.2) if robot == "puck" else Unicycle(V=0.3, b=0.2)
    for plant in plants(loaded, dynamics, 0.05):
        rng = np.random.default_rng(4)
        for _ in range(12):
            begun = plant.time
            advance = plant.advance(still(dynamics.m), rng)
            assert advance.outcome is None
            least = np.inf
            for k, x in enumerate(advance.states):
                solids = [s for mover in loaded.scene.movers for s in mover.at(begun + (k + 1) * STEP)]
                there = Workspace(-EVERYWHERE, EVERYWHERE, (*loaded.scene.obstacles, *solids))
                around = Collision(there, loaded.scene.footprint)
                least = min(least, float(around.clearance(x[None, :2])[0]))
            assert advance.clearance == pytest.approx(least, abs=1e-9)


@pytest.mark.parametrize("name", ["crossing", "closing_door", "pincer"])
def test_in_the_built_in_scenes_bodies_are_after_a_second_where_they_should_be(name):
    loaded = load(name)
    for plant in plants(loaded, SingleIntegrator(b=QUIET), 0.1)[:1]:
        for _ in range(10):
            assert plant.advance(still(2), np.random.default_rng(0)).outcome is None
        for mover in loaded.scene.movers:
            np.testing.assert_allclose(plant.data.body(mover.name).xpos[:2], mover.motion.pose(1.0)[:2], atol=1e-12)
