"""Moving obstacles are in the plant where their motions say, and a robot that they run over has collided."""

import numpy as np
import pytest
from mjcf_samples import ON_GROUND
from plants import QUIET, STEP, body, both, driven, flown_over, hold, moving_scene, problem_of, rows, states_of

from pirrht import Outcome, SingleIntegrator, Unicycle
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Workspace
from pirrht.moving.in_space import MovingSolids
from pirrht.systems.ball import Ball
from sim.mjcf import load
from sim.scenario import prepare

EVERYWHERE = np.full(2, np.inf)


def pair(folder, world: str, custom: str, period: float, *, robot="puck", b=QUIET, V=1e-9, **options):
    """Loaded scene and both plants of a puck, or of a unicycle."""
    loaded = load(moving_scene(folder, world, custom, **options), robot=robot)
    dynamics = SingleIntegrator(b=b) if robot == "puck" else Unicycle(V=V, b=b)
    return loaded, both(loaded, problem_of(loaded, dynamics), period)


def still(plant):
    return hold(*np.zeros(2 if len(plant.state) == 2 else 1))


SPIN = "0 -3 2 0.5  0.105 -2.5 2.25 1.5  0.3 -4 3 -2"
SLIDE = "0 3 -2 0  0.2 3.5 -2 0"


def test_mujocos_bodies_are_at_every_physics_step_where_their_motions_say_across_periods_and_laps(tmp_path):
    yaw = np.degrees(0.5)
    world = body("spin", 'type="box" size=".2 .1 .2" pos=".1 0 0"', "-3 2 0.3", more=f'euler="0 0 {yaw:.12f}"')
    world += '<body name="post" mocap="true" pos="5 5 0.1"><geom name="post" size=".1"/></body>'
    world += body("slide", 'type="cylinder" size=".1 .1"', "3 -2 0.1")
    world += body("tilt", 'type="box" size=".3 .2 .05"', "9 0 0.1", more='euler="20 0 0"')
    custom = rows("spin", SPIN, repeat=True) + rows("slide", SLIDE) + rows("tilt", "0 9 0 0  0.1 9 0 3")
    loaded, (plant, _) = pair(tmp_path, world, custom, 7 * STEP)
    queried, data = [], plant.data

    def control(x: np.ndarray, s: float) -> np.ndarray:
        queried.append(plant.time)
        for mover in loaded.scene.movers:
            [geom] = mover.at(plant.time)
            np.testing.assert_allclose(data.geom(mover.name).xpos, geom.position, atol=1e-12)
            np.testing.assert_allclose(data.geom(mover.name).xmat.reshape(3, 3), geom.rotation, atol=1e-9)
        return np.zeros(2)

    # 0.7 s: two laps and more; poses are computed 64 steps at a time
    for begin in (0.0, 1.0):
        queried.clear()
        plant.reset(np.zeros(2), time=begin)
        assert all(advance.outcome is None for advance in driven(plant, control, 0, 50))
        np.testing.assert_allclose(queried, begin + STEP * np.arange(350), atol=1e-12)
    np.testing.assert_array_equal(data.body("post").xpos, [5, 5, 0.1])


def hit(plant, periods: int = 200):
    """The time of the collision of a robot that rests at the origin."""
    plant.reset(np.zeros(3))
    rng = np.random.default_rng(0)
    for _ in range(periods):
        advance = plant.advance(still(plant), rng)
        if advance.outcome is not None:
            assert (advance.outcome, advance.clearance) == (Outcome.COLLISION, 0.0)
            return plant.time, advance
    raise AssertionError("nothing ran it over")


OVER = {  # geom and place, motion, when a disc of 0.1 m at the origin is touched
    "a disc at 1.3 m/s": ('type="cylinder" size=".3 .2"', "2 0 0.1", "0 2 0 0  2 -0.6 0 0", (2 - 0.4) / 1.3),
    "a wall, later": ('type="box" size=".05 3 .2"', "-1 0 .1", "0 -1 0 0  0.5 -1 0 0  1.5 1 0 0", 0.5 + 0.85 / 2),
    "a bar that turns": ('type="box" size="2 .05 .2"', "0 -1 0.1", "0 0 -1 0  1 0 -1 1.5", None),
}


@pytest.mark.parametrize("case", OVER)
@pytest.mark.parametrize("period", [STEP, 0.1])
def test_a_resting_robot_that_is_run_over_collides_when_the_geometry_says(tmp_path, case, period):
    geom, place, motion, when = OVER[case]
    loaded, plants = pair(tmp_path, body("b", geom, place), rows("b", motion), period)
    if when is None:  # the bar's upper side, at angle a above its lower right, is 0.1 from the origin
        times = np.linspace(0, 1, 100001)
        yaws = loaded.scene.movers[0].motion.pose(times)[:, 2]
        when = float(times[np.argmax(np.cos(yaws) - 0.05 <= 0.1)])  # distance of the origin from the bar's middle line
    for plant in plants:
        assert when - 1e-6 <= hit(plant, periods=round(2 / period))[0] <= when + STEP + 1e-6


def test_a_robot_smaller_than_its_footprint_is_run_over_when_its_own_shape_is(tmp_path):
    world = body("b", 'type="box" size=".05 3 .2"', "1 0 0.1")
    loaded, (plant, analytic) = pair(tmp_path, world, rows("b", "0 1 0 0  1 0 0 0"), 0.1, robot="unicycle")
    assert hit(plant)[0] > hit(analytic)[0] + 2 * STEP
    moving = np.flatnonzero(loaded.moving_geoms & loaded.obstacle_geoms)
    gap = min(plant.data.geom(int(g)).xpos[0] for g in moving)  # where the body is now
    assert 0.05 < gap < 0.05 + loaded.scene.robot_radius


def rushed_by(file, robot: str, kind: str = "mujoco", margin: float = 0.03):
    """The first 20 ms of a robot that is prepared like that of a run, and is not controlled."""
    scenario = prepare(file, robot=robot, margin=margin, plant=kind, noise=1e-6, period=0.02)
    return scenario.plant().advance(hold(*np.zeros(scenario.problem.dynamics.m)), np.random.default_rng(0))


@pytest.mark.parametrize("robot", ON_GROUND)
@pytest.mark.parametrize("speed", [500.0, 3e5])
def test_a_motion_that_leaps_over_the_robot_within_a_step_touches_it(tmp_path, robot, speed):
    """A disc is on one side of the robot, which plans with a margin, and on the other a step later."""
    far, gone = 0.5 * STEP * speed, 0.01 + STEP
    motion = rows("b", f"0 0 {far} 0  0.01 0 {far} 0  {gone} 0 {-far} 0  1 0 {-far} 0")
    file = moving_scene(tmp_path, body("b", 'type="cylinder" size=".05 .2"', f"0 {far} 0.1"), motion)
    for kind in ("mujoco", "sde"):
        advance = rushed_by(file, robot, kind)
        assert (advance.outcome, advance.clearance) == (Outcome.COLLISION, 0.0)
        assert advance.time == pytest.approx(gone)


def test_what_rushes_past_a_slim_robot_through_the_ball_around_it_does_not_touch_it(tmp_path):
    """`hover` is a cylinder of 0.09 m in a ball of 0.095 m; a post passes 0.0915 m from its middle."""
    motion, post = rows("b", "0 -2 0.0935 0  0.004 2 0.0935 0"), 'type="box" size=".002 .002 .2"'
    file = moving_scene(tmp_path, body("b", post, "-2 0.0935 0.1"), motion)
    assert rushed_by(file, "hover", margin=0.0).outcome is None
    assert rushed_by(file, "puck", margin=0.0).outcome is Outcome.COLLISION


DISC, BOX = 'type="cylinder" size=".3 .2"', 'type="box" size=".1 3 .2"'


def test_a_robot_that_runs_into_a_disc_meets_it_halfway_and_one_that_flees_as_fast_is_not_met(tmp_path):
    _, plants = pair(tmp_path, body("b", DISC, "3 0 0.1"), rows("b", "0 3 0 0  3 -3 0 0"), 3.0)
    for plant in plants:
        [advance] = driven(plant, hold(1.5, 0.0), 0, 1)
        assert advance.outcome is Outcome.COLLISION
        assert advance.time == pytest.approx(2.6 / 3.5, abs=STEP)
    _, plants = pair(tmp_path, body("b", BOX, "-0.201 0 0.1"), rows("b", "0 -0.201 0 0  1 4.799 0 0"), 0.5)
    for plant in plants:
        [advance] = driven(plant, hold(5.0, 0.0), 0, 1)
        assert advance.outcome is None
        assert advance.clearance == pytest.approx(0.001, abs=1e-6)


def test_periods_of_any_length_make_the_same_run(tmp_path):
    world, custom = body("b", DISC, "1 2 0.1"), rows("b", "0 1 2 0  0.13 1 1 0", repeat=True)
    longs, shorts = (pair(tmp_path, world, custom, period, b=0.2)[1] for period in (0.6, 0.02))
    for long, short in zip(longs, shorts, strict=True):
        one, many = (
            states_of(driven(plant, lambda x, s: np.array([np.cos(x[1]), 0.3]), 3, count))
            for plant, count in ((long, 1), (short, 30))
        )
        np.testing.assert_array_equal(one, many)
        assert long.time == pytest.approx(short.time, abs=1e-12)


def test_a_body_passes_through_static_obstacles_and_others_as_if_nothing_were_there(tmp_path):
    world = '<geom name="wall" type="box" size=".1 1 .2" pos="2 0 .1"/>'
    world += body("a", DISC, "2 1.2 0.1") + body("b", 'type="box" size=".3 .3 .2"', "2 -1 0.1")
    for plant in pair(tmp_path, world, rows("a", "0 2 1.2 0  0.5 2 -1 0") + rows("b", "0 2 -1 0  0.5 2 1 0"), 0.6)[1]:
        assert driven(plant, still(plant), 0, 1)[0].outcome is None


@pytest.mark.parametrize("robot", ["puck", "unicycle"])
def test_the_least_clearance_is_that_to_static_and_moving_obstacles_after_every_step(tmp_path, robot):
    world = '<geom name="wall" type="box" size=".05 3 .2" pos="1.5 0 .1"/>'
    world += body("a", 'type="cylinder" size=".2 .2"', "0 2 0.1")
    world += body("b", 'type="box" size=".3 .1 .2"', "-1 0 0.1")
    custom = rows("a", "0 0 2 0  0.3 0 0.5 0  0.6 0 2 0", repeat=True) + rows("b", "0 -1 0 0  2 -1 0 9")
    loaded, plants = pair(tmp_path, world, custom, 0.05, robot=robot, b=0.2, V=0.3)
    for plant in plants:
        rng = np.random.default_rng(4)
        for _ in range(12):
            begun, advance = plant.time, plant.advance(still(plant), rng)
            assert advance.outcome is None
            least = np.inf
            for k, x in enumerate(advance.states):
                solids = [s for mover in loaded.scene.movers for s in mover.at(begun + (k + 1) * STEP)]
                there = Workspace(-EVERYWHERE, EVERYWHERE, (*loaded.scene.obstacles, *solids))
                least = min(least, float(Collision(there, loaded.scene.body).clearance(x[None, :2])[0]))
            assert advance.clearance == pytest.approx(least, abs=1e-9)


def in_air(file, period: float = 0.1):
    """Loaded scene of a ball of 0.12 m in space, and both of its plants."""
    loaded = load(file, radius=0.12, margin=0.0)
    return loaded, both(loaded, problem_of(loaded, Ball(b=QUIET)), period)


HALF = 0.7071067811865476
TUMBLE = f"0 2 1 -1 1 0 0 0  0.4 1 0 1 {HALF} {HALF} 0 0  0.9 -2 1 2 0 0 1 0"
AIR = {  # geom, poses, when a ball of 0.12 m at the origin is touched
    "a ball at 1.3 m/s": ('type="sphere" size=".3"', "0 0 0 2 1 0 0 0  2 0 0 -0.6 1 0 0 0", (2 - 0.42) / 1.3),
    "a bar that tips over": (
        'type="box" size=".05 .05 2"', f"0 1 0 0 1 0 0 0  1 1 0 0 {HALF} 0 {HALF} 0",
        float(np.arccos(0.17) / (np.pi / 2)),  # its middle line is cos(angle) from the origin
    ),
    "a capsule on its side": (
        'type="capsule" size=".1 1"', f"0 0 -2 0 {HALF} 0 {HALF} 0  1 0 1 0 {HALF} 0 {HALF} 0", (2 - 0.22) / 3
    ),
}  # fmt: skip


def test_mujocos_bodies_in_space_are_and_are_turned_as_their_motions_say(tmp_path):
    file = flown_over(tmp_path, 'type="box" size=".2 .1 .3" pos=".1 0 .2"', TUMBLE, repeat=True)
    loaded, (plant, _) = in_air(file)
    [mover] = loaded.scene.movers
    for begin in (0.0, 3.0):
        plant.reset(np.array([20.0, 0.0, 0.0]), time=begin)
        for _ in range(7):
            plant.advance(hold(0.0, 0.0, 0.0), np.random.default_rng(0))
            [geom] = mover.at(plant.time)
            np.testing.assert_allclose(plant.data.geom("b").xpos, geom.position, atol=1e-12)
            np.testing.assert_allclose(plant.data.geom("b").xmat.reshape(3, 3), geom.rotation, atol=1e-9)


@pytest.mark.parametrize("case", AIR)
def test_a_resting_ball_that_a_body_flies_into_collides_when_the_geometry_says(tmp_path, case):
    geom, poses, when = AIR[case]
    _, plants = in_air(flown_over(tmp_path, geom, poses))
    for plant in plants:
        assert when - 1e-6 <= hit(plant, periods=20)[0] <= when + STEP + 1e-6


@pytest.mark.slow
def test_mujocos_contact_comes_in_the_step_in_which_samples_meet_a_body_that_tumbles(tmp_path):
    """30 straight flights without noise past one box; kernels and contacts agree which meet it, and when."""
    rng, met = np.random.default_rng(5), 0
    loaded, (plant, _) = in_air(flown_over(tmp_path, 'type="box" size=".5 .15 .7"', TUMBLE))
    bodies = MovingSolids.of(loaded.scene)
    for _ in range(30):
        a = rng.uniform(-2.0, 2.0, 3)
        b = a + (rng.uniform(-0.5, 0.5, 3) - 0.7 * a)
        if bodies.distance(a, 0.0) <= 0.0:
            continue
        times = STEP * np.arange(1, 501)
        touched = [bodies.clearance(tuple(a + t * (b - a)), t) <= 0.0 for t in times]
        plant.reset(a)
        outcome = None
        for _ in range(10):
            if (outcome := plant.advance(hold(*(b - a)), rng).outcome) is not None:
                break
        assert (outcome is Outcome.COLLISION) == any(touched)
        if outcome is not None:
            met += 1
            assert plant.time == pytest.approx(times[np.argmax(touched)], abs=STEP + 1e-6)
    assert 5 <= met <= 25
