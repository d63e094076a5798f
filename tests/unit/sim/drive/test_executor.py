"""The plant: MuJoCo is the stochastic equation up to contacts, and drives are judged and paid for alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.collision import Collision
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.systems.unicycle import Unicycle
from sim.drive.executor import Executor, commanded_rate
from sim.drive.plant import Analytic, Room
from sim.mjcf import Loaded, load
from sim.scenario import prepare

QUIET = 1e-12  # a noise level that is as good as none
STEP = 0.002


def scene_file(folder: Path, *, world: str = "", option: str = "", size: float = 1e4) -> Path:
    goal = f'pos="{0.9 * size} 0 0" size="0.01 0.01"'
    path = folder / "field.xml"
    path.write_text(
        f"""<mujoco>{option}<worldbody><site name="start" pos="0 0 0"/>
        <site name="workspace" type="box" size="{size} {size} 1"/>
        <site name="goal" type="cylinder" {goal}/>{world}</worldbody></mujoco>"""
    )
    return path


def system(robot: str, b: float) -> Dynamics:
    return SingleIntegrator(b=b) if robot == "puck" else Unicycle(V=0.8, rho=0.7, b=b)


def problem_of(loaded: Loaded, dynamics: Dynamics, **options) -> Problem:
    return Problem(dynamics=dynamics, scene=loaded.scene, R=2 * np.eye(dynamics.m), **options)


def wander(x: Array, s: float) -> Array:
    """A control that depends on state and time, cut to the first m entries by the caller."""
    return np.array([np.cos(3 * x[0]) + s, np.sin(2 * x[1]) - s])


def free(points: Array) -> Array:
    return np.ones(len(points))


def pair(folder: Path, robot: str, b: float, option: str = "") -> tuple[Executor, Analytic]:
    loaded = load(scene_file(folder, option=option), robot=robot)
    problem = problem_of(loaded, system(robot, b))
    step = float(loaded.model.opt.timestep)
    return (
        Executor(loaded, problem, period=10 * step),
        Analytic(problem, free, period=10 * step, physics_step=step),
    )


@pytest.mark.parametrize("b", [QUIET, 0.3])
@pytest.mark.parametrize("timestep", [0.001, STEP, 0.01])
@pytest.mark.parametrize("robot", ["puck", "unicycle"])
def test_mujoco_follows_the_sde(tmp_path, robot, timestep, b):
    option = f'<option timestep="{timestep}" integrator="implicitfast" density="1000" gravity="0 0 -9.81"/>'
    plants = pair(tmp_path, robot, b, option)
    m = 2 if robot == "puck" else 1
    ends = []
    for plant in plants:
        rng = np.random.default_rng(7)
        advances = [plant.advance(lambda x, s: wander(x, s)[:m], rng) for _ in range(20)]
        ends.append((np.concatenate([a.states for a in advances]), sum(a.cost for a in advances)))
    (mujoco_states, mujoco_cost), (sde_states, sde_cost) = ends
    assert np.ptp(mujoco_states[:, 0]) > 0.05
    np.testing.assert_allclose(mujoco_states, sde_states, atol=1e-8)
    assert mujoco_cost == pytest.approx(sde_cost)


@pytest.mark.parametrize(("robot", "b", "actuated"), [("puck", 0.3, slice(0, 2)), ("unicycle", 0.5, slice(2, 3))])
def test_displacement_without_control_has_covariance_b_b_t(tmp_path, robot, b, actuated):
    plant, _ = pair(tmp_path, robot, b)
    rng = np.random.default_rng(11)
    m = actuated.stop - actuated.start
    ends = np.array([plant.advance(lambda x, s: np.zeros(m), rng).states[-1] for _ in range(1500)])
    moves = np.diff(np.vstack([np.zeros(ends.shape[1]), ends]), axis=0)[:, actuated]
    measured = moves.T @ moves / len(moves)
    expected = b**2 * 10 * STEP * np.eye(m)
    error = b**2 * 10 * STEP * np.sqrt((1 + np.eye(m)) / len(moves))  # of a Gaussian sample covariance
    assert np.all(np.abs(measured - expected) < 3 * error)


@pytest.mark.parametrize("dynamics", [SingleIntegrator(b=0.2), Unicycle(V=1.5, rho=0.4, b=0.2)])
def test_the_commanded_rate_is_that_of_the_dynamics(dynamics):
    rng = np.random.default_rng(3)
    fast = commanded_rate(dynamics, STEP)
    for _ in range(20):
        x, u, dw = (rng.standard_normal(k) for k in (dynamics.n, dynamics.m, dynamics.m))
        np.testing.assert_allclose(fast(x, u, dw), dynamics.rate(x, u, dw, STEP))


def test_equal_seeds_give_equal_noise_whatever_is_done_with_it(tmp_path):
    loud, _ = pair(tmp_path, "puck", 0.3)
    _, silent = pair(tmp_path, "puck", QUIET)
    noise = []
    for plant, u in ((loud, np.zeros(2)), (silent, np.array([1.0, -2.0]))):
        rng = np.random.default_rng(5)
        noise.append(np.concatenate([plant.advance(lambda x, s, u=u: u, rng).noise for _ in range(3)]))
    rng = np.random.default_rng(5)
    np.testing.assert_array_equal(noise[0], noise[1])
    np.testing.assert_array_equal(noise[0], [np.sqrt(STEP) * rng.standard_normal(2) for _ in range(30)])


@pytest.mark.parametrize("period", [0.003, 0.0, -0.01, 0.0101, np.nan, np.inf])
def test_a_period_that_is_no_multiple_of_the_physics_step_is_refused_with_both(period):
    loaded = load("slit")
    problem = problem_of(loaded, SingleIntegrator())
    for build in (
        lambda: Executor(loaded, problem, period=period),
        lambda: Analytic(problem, free, period=period),
    ):
        with pytest.raises(OptionError, match=rf"{period:g} s .* 0\.002 s"):
            build()


@pytest.mark.parametrize("period", [STEP, 0.006, 0.1, 0.3])
def test_a_period_is_driven_in_whole_physics_steps(period):
    loaded = load("slit")
    plant = Executor(loaded, problem_of(loaded, SingleIntegrator(b=QUIET)), period=period)
    asked: list[float] = []

    def control(x: Array, s: float) -> Array:
        asked.append(s)
        return np.array([0.6, 0.8])

    advance = plant.advance(control, np.random.default_rng(0))
    count = round(period / STEP)
    np.testing.assert_allclose(asked, STEP * np.arange(count))
    assert advance.outcome is None
    assert advance.time == pytest.approx(period)
    assert advance.length == pytest.approx(period)
    assert advance.cost == pytest.approx(2 * period)  # q + u'Ru/2 = 1 + 1
    assert advance.states.shape == advance.controls.shape == advance.noise.shape == (count, 2)
    np.testing.assert_allclose(plant.state, advance.states[-1])


def test_cost_is_paid_where_the_step_begins():
    loaded = load("slit")
    problem = problem_of(loaded, SingleIntegrator(b=QUIET), q=lambda x, p: x[0], q_min=0.1)
    plant = Executor(loaded, problem, period=2 * STEP)
    advance = plant.advance(lambda x, s: np.array([1.0, 0.0]), np.random.default_rng(0))
    assert advance.cost == pytest.approx(STEP * (1 + 1 + 1 + (1 + STEP)))


def test_robot_and_dynamics_must_fit():
    loaded = load("slit", robot="unicycle")
    with pytest.raises(OptionError, match="unicycle with 3 states"):
        Executor(loaded, problem_of(loaded, SingleIntegrator()), period=0.01)


@pytest.mark.parametrize("robot", ["puck", "unicycle", "diffdrive"])
def test_reset_forgets_the_drive(tmp_path, robot):
    plant, _ = pair(tmp_path, robot, 0.2)
    m = 2 if robot == "puck" else 1
    runs = []
    for _ in range(2):
        plant.reset(np.array([1.0, 2.0, 7.5]))
        np.testing.assert_allclose(plant.state, [1.0, 2.0, 7.5][: len(plant.state)])
        runs.append(plant.advance(lambda x, s: np.zeros(m), np.random.default_rng(1)))
    np.testing.assert_array_equal(runs[0].states, runs[1].states)


def test_the_heading_is_unwrapped(tmp_path):
    for plant in pair(tmp_path, "unicycle", QUIET):
        rng = np.random.default_rng(0)
        for _ in range(100):
            plant.advance(lambda x, s: np.array([5.0]), rng)
        assert plant.state[2] == pytest.approx(5.0 / 0.7 * 2.0)


def test_a_control_that_is_not_finite_is_refused(tmp_path):
    for plant in pair(tmp_path, "puck", 0.1):
        with pytest.raises(OptionError, match="not finite"):
            plant.advance(lambda x, s: np.array([np.nan, 0.0]), np.random.default_rng(0))


WALL = '<geom name="wall" type="box" size="0.05 3 0.3" pos="0.65 0 0.3"/>'  # face at 0.6


def wall_clearance(points: Array) -> Array:
    return np.abs(points[:, 0] - 0.65) - 0.05 - 0.1


@pytest.mark.parametrize("speed", [0.5, 1.0, 20.0])
def test_a_drive_ends_at_its_first_contact(tmp_path, speed):
    loaded = load(scene_file(tmp_path, world=WALL))
    problem = problem_of(loaded, SingleIntegrator(b=QUIET))
    plants = (
        Executor(loaded, problem, period=1.3),
        Analytic(problem, wall_clearance, period=1.3, physics_step=STEP),
    )
    ends = [plant.advance(lambda x, s: np.array([speed, 0.1]), np.random.default_rng(0)) for plant in plants]
    for end in ends:
        assert end.outcome is Outcome.COLLISION
        assert end.states[-2, 0] <= 0.5 + 1e-9 < end.states[-1, 0] + 2e-9
        assert end.time == pytest.approx(STEP * len(end.states))
    assert abs(len(ends[0].states) - len(ends[1].states)) <= 1  # a contact at distance zero may count or not


THIN = '<geom name="thin" type="box" size="0.002 3 0.3" pos="0.15 0 0.3"/>'  # a step of b = 0.5 is 22 mm


def test_nothing_passes_a_wall_within_a_step(tmp_path):
    """A wall of 4 mm, a robot of 2 cm: most steps of 0.1 to 0.2 m end beyond what would touch, on either side."""
    loaded = load(scene_file(tmp_path, world=THIN), radius=0.02)
    problem = problem_of(loaded, SingleIntegrator(b=0.5))
    clearance = Collision(loaded.scene.world, loaded.scene.footprint).clearance
    plants = (
        Executor(loaded, problem, period=10 * STEP),
        Analytic(problem, clearance, period=10 * STEP, physics_step=STEP),
    )
    for plant in plants:
        passed = 0
        for seed in range(40):
            plant.reset(np.zeros(2))
            rng, outcome = np.random.default_rng(seed), None
            for _ in range(30):
                end = plant.advance(lambda x, s: np.array([5.0, 0.0]), rng)
                outcome = end.outcome
                before_last = end.states[:-1] if outcome else end.states
                assert np.all(before_last[:, 0] < 0.13)
                if outcome is not None:
                    break
            assert outcome is Outcome.COLLISION
            assert end.clearance == 0.0
            passed += end.states[-1, 0] > 0.172
        assert passed > 0  # the ends alone would not have told


def test_the_least_room_is_that_after_every_step(tmp_path):
    loaded = load(scene_file(tmp_path, world=WALL))
    clearance = Collision(loaded.scene.world, loaded.scene.footprint).clearance
    plant = Executor(loaded, problem_of(loaded, SingleIntegrator(b=0.2)), period=0.1)
    rng = np.random.default_rng(1)
    for _ in range(20):
        end = plant.advance(lambda x, s: np.array([1.0 - 4.0 * x[0], 0.0]), rng)
        assert end.outcome is None
        assert end.clearance == pytest.approx(clearance(end.states).min(), abs=1e-12)


def test_the_way_between_two_free_places_is_blocked_by_what_is_between_and_not_by_what_is_beside():
    room = Room(lambda points: np.hypot(*points.T) - 0.5)
    assert room.blocked(np.array([-1.0, 0.0]), np.array([1.0, 0.1]))
    room.begin()
    assert not room.blocked(np.array([-1.0, 0.501]), np.array([1.0, 0.501]))
    assert room.least == pytest.approx(0.001, abs=1e-3)
    assert room.blocked(np.array([-1.0, 0.499]), np.array([1.0, 0.499]))


def test_the_unicycle_collides_with_its_body_inside_the_footprint(tmp_path):
    loaded = load(scene_file(tmp_path, world=WALL), robot="unicycle")
    plant = Executor(loaded, problem_of(loaded, Unicycle(V=1.0, b=QUIET)), period=2.0)
    end = plant.advance(lambda x, s: np.zeros(1), np.random.default_rng(0))
    assert end.outcome is Outcome.COLLISION
    assert 0.6 - loaded.scene.robot_radius < end.states[-1, 0] < 0.6 - 0.11 + 2 * STEP


def drive_right(folder: Path, x: float, goal: tuple[float, float, float], *, world: str = "", speed: float = 1.0):
    loaded = load(scene_file(folder, world=world, size=2.0), start=(x, 0), goal=goal)
    plant = Executor(loaded, problem_of(loaded, SingleIntegrator(b=QUIET)), period=0.1)
    return plant.advance(lambda x, s: np.array([speed, 0.0]), np.random.default_rng(0))


def test_the_border_stops_the_centre(tmp_path):
    end = drive_right(tmp_path, 1.95, (0, 1, 0.3))
    assert end.outcome is Outcome.COLLISION
    assert end.states[-1, 0] >= 2.0 > end.states[-2, 0]


def test_the_goal_ends_the_drive_within_the_period(tmp_path):
    end = drive_right(tmp_path, 0.0, (0.35, 0, 0.3))
    assert end.outcome is Outcome.GOAL
    assert end.time == pytest.approx(0.05, abs=1.5 * STEP)
    assert end.length == pytest.approx(end.time)
    assert end.cost == pytest.approx(2 * end.time)


def test_collision_counts_before_the_goal(tmp_path):
    goal = (1.0, 0.0, 0.495)  # reached at 0.505, and the wall at 0.5
    assert drive_right(tmp_path, 0.495, goal, world=WALL, speed=10.0).outcome is Outcome.COLLISION
    assert drive_right(tmp_path, 0.495, goal, speed=10.0).outcome is Outcome.GOAL


@pytest.mark.parametrize("time", [-1.0, np.nan, np.inf, "1", None])
def test_a_clock_begins_at_no_impossible_time(time):
    plant = prepare("crossing").plant()
    with pytest.raises(OptionError, match="a drive's clock begins at 0"):
        plant.reset(np.array([1.0, 2.5]), time=time)
