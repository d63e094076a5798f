"""The plant: MuJoCo is the stochastic equation up to contacts, and runs are judged and paid for alike."""

from itertools import product

import numpy as np
import pytest
from plants import QUIET, STEP, WALL, both, driven, hold, problem_of, scene_file, states_of

from pirrht import OptionError, Outcome, SingleIntegrator, Unicycle
from sim.drive.executor import ClearanceChecker, Executor, Plant
from sim.drive.metrics import EpisodeMetrics
from sim.mjcf import load
from sim.scenario import prepare
from sim.states import adapter_of


def pair(folder, robot: str, b: float, option: str = "", world: str = "", steps: int = 10) -> tuple[Executor, Plant]:
    loaded = load(scene_file(folder, option=option, world=world), robot=robot)
    dynamics = SingleIntegrator(b=b) if robot == "puck" else Unicycle(V=0.8, rho=0.7, b=b)
    return both(loaded, problem_of(loaded, dynamics), steps * float(loaded.model.opt.timestep))


@pytest.mark.parametrize("b", [QUIET, 0.3])
@pytest.mark.parametrize("timestep", [0.001, STEP, 0.01])
@pytest.mark.parametrize("robot", ["puck", "unicycle"])
def test_mujoco_follows_the_sde(tmp_path, robot, timestep, b):
    option = f'<option timestep="{timestep}" integrator="implicitfast" density="1000" gravity="0 0 -9.81"/>'
    m = 2 if robot == "puck" else 1

    def wander(x: np.ndarray, s: float) -> np.ndarray:
        return np.array([np.cos(3 * x[0]) + s, np.sin(2 * x[1]) - s])[:m]

    mujoco, sde = (driven(plant, wander, 7, 20) for plant in pair(tmp_path, robot, b, option))
    assert np.ptp(states_of(mujoco)[:, 0]) > 0.05
    np.testing.assert_allclose(states_of(mujoco), states_of(sde), atol=1e-8)
    assert sum(a.cost for a in mujoco) == pytest.approx(sum(a.cost for a in sde))


@pytest.mark.parametrize(("robot", "b", "actuated"), [("puck", 0.3, slice(0, 2)), ("unicycle", 0.5, slice(2, 3))])
def test_displacement_without_control_has_covariance_b_b_t(tmp_path, robot, b, actuated):
    plant, _ = pair(tmp_path, robot, b)
    m = actuated.stop - actuated.start
    ends = np.array([a.states[-1] for a in driven(plant, hold(*np.zeros(m)), 11, 1500)])
    moves = np.diff(np.vstack([np.zeros(ends.shape[1]), ends]), axis=0)[:, actuated]
    measured = moves.T @ moves / len(moves)
    expected = b**2 * 10 * STEP * np.eye(m)
    error = b**2 * 10 * STEP * np.sqrt((1 + np.eye(m)) / len(moves))  # of a Gaussian sample covariance
    assert np.all(np.abs(measured - expected) < 3 * error)


@pytest.mark.parametrize("period", [0.003, 0.0, -0.01, 0.0101, np.nan, np.inf])
def test_a_period_that_is_no_multiple_of_the_physics_step_is_refused_with_both(period):
    loaded = load("slit")
    problem = problem_of(loaded, SingleIntegrator())
    for build in (lambda: Executor(loaded, problem, period=period), lambda: Plant(problem, len, period=period)):
        with pytest.raises(OptionError, match=rf"{period:g} s .* 0\.002 s"):
            build()


@pytest.mark.parametrize("period", [STEP, 0.006, 0.1, 0.3])
def test_a_period_is_driven_in_whole_physics_steps_and_paid_for_where_they_begin(period):
    loaded = load("slit")
    problem = problem_of(loaded, SingleIntegrator(b=QUIET), q=lambda x, p: x[0], q_min=0.1)
    plant = Executor(loaded, problem, period=period)
    advance = plant.advance(hold(1.0, 0.0), np.random.default_rng(0))
    count = round(period / STEP)
    assert advance.outcome is None
    assert (advance.time, advance.length) == pytest.approx((period, period))
    assert advance.cost == pytest.approx(STEP * np.sum(1.0 + STEP * np.arange(count) + 1.0))  # q + u'Ru/2 = x + 1
    assert advance.states.shape == advance.controls.shape == advance.noise.shape == (count, 2)
    np.testing.assert_allclose(plant.state, advance.states[-1])


def test_what_cannot_be_driven_is_refused(tmp_path):
    loaded = load("slit", robot="unicycle")
    with pytest.raises(OptionError, match="unicycle with 3 states"):
        Executor(loaded, problem_of(loaded, SingleIntegrator()), period=0.01)
    for plant in pair(tmp_path, "puck", 0.1):
        with pytest.raises(OptionError, match="not finite"):
            plant.advance(hold(np.nan, 0.0), np.random.default_rng(0))
        for time in (-1.0, np.nan, np.inf):
            with pytest.raises(OptionError, match="a run's clock begins at 0"):
                plant.reset(np.array([1.0, 2.5]), time=time)


@pytest.mark.parametrize("robot", ["puck", "unicycle", "diffdrive"])
def test_reset_forgets_the_run(tmp_path, robot):
    plant, _ = pair(tmp_path, robot, 0.2)
    runs = []
    for _ in range(2):
        plant.reset(np.array([1.0, 2.0, 7.5]))
        np.testing.assert_allclose(plant.state, [1.0, 2.0, 7.5][: len(plant.state)])
        runs.append(plant.advance(hold(*np.zeros(2 if robot == "puck" else 1)), np.random.default_rng(1)))
    np.testing.assert_array_equal(runs[0].states, runs[1].states)


@pytest.mark.parametrize("speed", [0.5, 1.0, 20.0])
def test_a_run_ends_at_its_first_contact(tmp_path, speed):
    ends = [
        plant.advance(hold(speed, 0.1), np.random.default_rng(0))
        for plant in pair(tmp_path, "puck", QUIET, world=WALL, steps=650)
    ]
    for end in ends:
        assert end.outcome is Outcome.COLLISION
        assert end.states[-2, 0] <= 0.5 + 1e-9 < end.states[-1, 0] + 2e-9
        assert end.time == pytest.approx(STEP * len(end.states))
    assert abs(len(ends[0].states) - len(ends[1].states)) <= 1  # a contact at distance zero may count or not


THIN = '<geom name="thin" type="box" size="0.002 3 0.3" pos="0.15 0 0.3"/>'  # a step of b = 0.5 is 22 mm


@pytest.mark.parametrize(("radius", "margin"), [(0.001, 0.01), (0.02, 0.01), (0.02, 0.0)])
@pytest.mark.parametrize("timestep", [STEP, 0.01])
def test_nothing_passes_a_wall_within_a_step(tmp_path, radius, timestep, margin):
    """Also a robot of 1 mm at 20 m/s, which goes 0.2 m in a step of 10 ms, by either plant, with a margin or none."""
    file = scene_file(tmp_path, world=THIN, option=f'<option timestep="{timestep}"/>', size=2.0, goal="1.8 0 0")
    for kind in ("mujoco", "sde"):
        scenario = prepare(file, radius=radius, margin=margin, plant=kind, noise=0.1, period=0.1)
        advance = scenario.plant().advance(hold(20.0, 0.0), np.random.default_rng(0))
        assert (advance.outcome, advance.clearance) == (Outcome.COLLISION, 0.0)
        assert advance.states[:-1, 0].max(initial=0.0) < 0.15


def test_the_clearance_of_a_run_is_around_the_robot_whatever_margin_plans_keep(tmp_path):
    """The wall is 0.5 m off the robot, and the border 2 m off its centre."""
    file = scene_file(tmp_path, world=WALL, size=2.0, goal="1.8 0 0")
    for kind, margin in product(("mujoco", "sde"), (0.0, 0.2, 0.45)):
        scenario = prepare(file, margin=margin, plant=kind, noise=1e-6, period=0.1)
        assert EpisodeMetrics(scenario, scenario.start, period=0.1, max_time=1.0).min_clearance == pytest.approx(0.5)
        advance = scenario.plant().advance(hold(4.5, 0.0), np.random.default_rng(0))
        assert advance.outcome is None
        assert advance.clearance == pytest.approx(0.05, abs=1e-4)
        advance = scenario.plant().advance(hold(-19.0, 0.0), np.random.default_rng(0))
        assert advance.clearance == pytest.approx(0.1, abs=1e-4)


def test_a_robot_that_is_no_ball_has_no_negative_clearance_where_it_does_not_touch(tmp_path):
    """`hover` is a cylinder of 0.09 m in a ball of 0.095 m, and stands 0.002 m from a wall."""
    world = '<geom name="wall" type="box" size="0.05 3 0.3" pos="0.142 0 0.3"/>'
    file = scene_file(tmp_path, world=world, start="-1 0 0", size=2.0, goal="1.8 0 0")
    plant = prepare(file, robot="hover", margin=0.0, noise=1e-6, period=0.1).plant()
    plant.reset(np.zeros(4))
    advance = plant.advance(hold(0.0, 0.0), np.random.default_rng(0))
    assert (advance.outcome, advance.clearance) == (None, 0.0)


@pytest.mark.parametrize(("y", "blocked"), [(0.0, True), (0.499, True), (0.501, False)])
def test_what_is_between_two_free_places_blocks_and_what_is_next_to_them_does_not(y, blocked):
    checker = ClearanceChecker(load("slit").scene, adapter_of(("x", "y")), lambda points: np.hypot(*points.T) - 0.5)
    assert checker.blocked(np.array([-1.0, y]), np.array([1.0, y])) is blocked


def drive_right(folder, x: float, goal: tuple[float, float, float], *, world: str = "", speed: float = 1.0):
    loaded = load(scene_file(folder, world=world, size=2.0, goal="1.8 0 0"), start=(x, 0), goal=goal)
    plant = Executor(loaded, problem_of(loaded, SingleIntegrator(b=QUIET)), period=0.1)
    return plant.advance(hold(speed, 0.0), np.random.default_rng(0))


def test_the_border_stops_the_centre_the_goal_ends_a_period_and_a_collision_counts_before_it(tmp_path):
    end = drive_right(tmp_path, 1.95, (0, 1, 0.3))
    assert end.outcome is Outcome.COLLISION
    assert end.states[-1, 0] >= 2.0 > end.states[-2, 0]
    end = drive_right(tmp_path, 0.0, (0.35, 0, 0.3))
    assert end.outcome is Outcome.GOAL
    assert end.time == pytest.approx(0.05, abs=1.5 * STEP)
    assert (end.length, end.cost) == pytest.approx((end.time, 2 * end.time))
    goal = (1.0, 0.0, 0.495)  # reached at 0.505, and the wall at 0.5
    assert drive_right(tmp_path, 0.495, goal, world=WALL, speed=10.0).outcome is Outcome.COLLISION
    assert drive_right(tmp_path, 0.495, goal, speed=10.0).outcome is Outcome.GOAL
