"""Hover, rover and car: a step of MuJoCo is that of their equation, and contacts and goals end a run."""

import numpy as np
import pytest
from plants import QUIET, STEP, WALL, both, driven, hold, scene_file, states_of

from pirrht import OptionError, Outcome, Problem
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.rover import Rover
from pirrht.systems.second_order_car import SecondOrderCar, cruising
from sim.drive.metrics import Length, spread
from sim.mjcf import Loaded, load, models_folder
from sim.mjcf.robot import control_limits
from sim.scenario import prepare


def problem_of(robot: str):
    def problem(loaded: Loaded, b: float) -> Problem:
        made = {
            "hover": (DoubleIntegrator(b=b), {"R": 2.0 * np.eye(2), "q": 1.0}),
            "rover": (Rover(b=b), {"R": np.diag([2.0, 0.5])}),
            "car": (SecondOrderCar(b=b), {"R": np.eye(2), "q": cruising, "q_min": 1.0}),
        }
        return Problem(dynamics=made[robot][0], scene=loaded.scene, **made[robot][1])

    return problem


def pair(folder, robot: str, b: float, *, steps: int = 10, **scene: str):
    loaded = load(scene_file(folder, **scene), robot=robot)
    return both(loaded, problem_of(robot)(loaded, b), steps * float(loaded.model.opt.timestep))


START = {"hover": [1.0, -2.0, 0.7, -0.4], "rover": [1.0, -2.0, 0.7], "car": [1.0, -2.0, 0.7, 1.4]}
WANDER = {  # a control that depends on the state and time
    "hover": lambda x, s: np.array([np.cos(3.0 * x[0]) - 0.4 * x[2] + s, np.sin(2.0 * x[1]) + x[3] - s]),
    "rover": lambda x, s: np.array([1.0 + np.cos(3.0 * x[0]) + s, 2.0 * np.sin(2.0 * x[1] + x[2])]),
    "car": lambda x, s: np.array([np.cos(3.0 * x[0]) - 0.4 * x[3] + s, np.sin(2.0 * x[1]) + x[2] - s]),
}


def check_hover(before: np.ndarray, after: np.ndarray, u: np.ndarray, dw: np.ndarray, h: float, b: float) -> None:
    """The semi-implicit Euler step."""
    np.testing.assert_allclose(after[:, 2:], before[:, 2:] + u * h + b * dw, rtol=0, atol=1e-9)
    np.testing.assert_allclose(after[:, :2], before[:, :2] + after[:, 2:] * h, rtol=0, atol=1e-9)


def check_rover(before: np.ndarray, after: np.ndarray, u: np.ndarray, dw: np.ndarray, h: float, b: float) -> None:
    """The Euler-Maruyama step."""
    way, turn = (u * h + dw * (b, 2.0 * b)).T
    moved = np.column_stack([way * np.cos(before[:, 2]), way * np.sin(before[:, 2]), turn])
    np.testing.assert_allclose(after - before, moved, rtol=0, atol=1e-8)


def check_car(before: np.ndarray, after: np.ndarray, u: np.ndarray, dw: np.ndarray, h: float, b: float) -> None:
    """The step along the heading half way: the heading exactly, speed and place but for terms that shrink faster."""
    turn, gain = (u * h + b * dw).T
    most, more = np.abs(turn).max(), np.abs(gain).max()
    np.testing.assert_allclose(after[:, 2], before[:, 2] + turn, rtol=0, atol=1e-9)
    np.testing.assert_allclose(after[:, 3], before[:, 3] + gain, rtol=0, atol=most**2 * more + 3.0 * most**4 + 1e-9)
    half = before[:, 2] + 0.5 * turn
    way = (before[:, 3] + gain)[:, None] * np.column_stack([np.cos(half), np.sin(half)]) * h
    assert np.abs(after[:, :2] - before[:, :2] - way).max() < h * (most**2 + most * more) + 1e-9


@pytest.mark.parametrize("b", [QUIET, 0.3])
@pytest.mark.parametrize("timestep", [0.001, STEP, 0.01])
@pytest.mark.parametrize(("robot", "check"), [("hover", check_hover), ("rover", check_rover), ("car", check_car)])
def test_a_step_of_mujoco_is_that_of_the_equation(tmp_path, robot, check, timestep, b):
    option = f'<option timestep="{timestep}" integrator="implicitfast" density="1000" gravity="0 0 -9.81"/>'
    plant, _ = pair(tmp_path, robot, b, option=option)
    plant.reset(np.array(START[robot]))
    advances = driven(plant, WANDER[robot], 7, 20)
    states = np.vstack([START[robot], states_of(advances)])
    u, dw = (np.concatenate([getattr(a, name) for a in advances]) for name in ("controls", "noise"))
    check(states[:-1], states[1:], u, dw, timestep, b)
    assert np.ptp(states[:, 2]) > 0.05


@pytest.mark.parametrize(
    ("robot", "start", "end"),
    [
        ("hover", [3.0, 4.0, -1.0, 2.0], [2.0, 6.0, -1.0, 2.0]),  # it glides on
        ("rover", [3.0, 4.0, 1.0], [3.0, 4.0, 1.0]),  # it waits
        ("car", [0.0, 0.0, np.pi / 2.0, -1.0], [0.0, -1.0, np.pi / 2.0, -1.0]),  # it reverses
    ],
)
def test_without_control_a_robot_goes_on_for_a_second_and_a_reset_forgets_the_run(tmp_path, robot, start, end):
    for plant in pair(tmp_path, robot, QUIET):
        runs = []
        for _ in range(2):
            plant.reset(np.array(start))
            np.testing.assert_allclose(plant.state, start, rtol=0, atol=1e-15)
            runs.append(states_of(driven(plant, hold(0.0, 0.0), 0, 50)))
        np.testing.assert_allclose(runs[0][-1], end, atol=1e-6)
        np.testing.assert_array_equal(*runs)


@pytest.mark.parametrize(
    ("robot", "start", "control", "bumper"),
    [("hover", [0.0, 0.0, v, 0.0], (0.0, 0.0), 0.09) for v in (0.5, 2.0, 90.0)]
    + [("rover", [0.0, 0.0, 0.0], (v, 0.0), 0.09) for v in (0.5, 2.0, 90.0)]  # noise would leap over the wall
    + [("car", [0.0, 0.0, 0.0, 0.5], (0.0, 0.0), 0.11)],
)
def test_contact_is_a_collision(tmp_path, robot, start, control, bumper):
    plant, _ = pair(tmp_path, robot, QUIET, steps=650, world=WALL)
    plant.reset(np.array(start))
    end = plant.advance(hold(*control), np.random.default_rng(0))
    assert end.outcome is Outcome.COLLISION
    before = end.states[-2, 0] if len(end.states) > 1 else 0.0
    assert before + bumper <= 0.6 + 1e-9 < end.states[-1, 0] + bumper + 2e-9


@pytest.mark.parametrize(("robot", "apart"), [("hover", 0.01), ("rover", 0.01), ("car", 0.02)])
def test_mujoco_and_the_equation_stay_together_under_the_same_noise(tmp_path, robot, apart):
    """A step goes along its end's velocity or its start's heading in MuJoCo; over 2 s it is a centimetre or two."""
    ends = []
    for plant in pair(tmp_path, robot, 0.1):
        plant.reset(np.array(START[robot]))
        ends.append(states_of(driven(plant, hold(1.0, 0.5), 3, 100)) - START[robot])
    assert np.hypot(*(ends[0] - ends[1])[:, :2].T).max() < apart
    np.testing.assert_allclose(ends[0][:, 2:], ends[1][:, 2:], rtol=0, atol=5e-3 if robot == "car" else 1e-8)
    assert np.hypot(*ends[1][-1, :2]) > 0.5


@pytest.mark.parametrize("which", [0, 1], ids=["mujoco", "sde"])
def test_a_hovers_velocity_and_place_spread_as_integrated_white_noise_does(tmp_path, which):
    """Within 3 standard errors of a Gaussian sample covariance, plus the 2 / steps that discrete time costs."""
    steps, count, b = 100, 800, 0.3
    plant = pair(tmp_path, "hover", b, steps=steps)[which]
    states = np.vstack([plant.state, *(a.states[-1] for a in driven(plant, hold(0.0, 0.0), 11, count))])
    t = steps * STEP
    p = np.diff(states[:, :2], axis=0) - states[:-1, 2:] * t  # what the velocity of the start does not explain
    moves = np.hstack([p, np.diff(states[:, 2:], axis=0)])
    expected = np.kron(b * b * np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]]), np.eye(2))  # x, y, vx, vy
    error = np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / count)
    assert np.all(np.abs(moves.T @ moves / count - expected) < 3.0 * error + 2.0 / steps * expected)
    assert np.all(np.abs(moves.mean(axis=0)) < 3.0 * np.sqrt(np.diag(expected) / count))


def test_a_hover_enters_the_goal_at_any_velocity(tmp_path):
    plant, _ = pair(tmp_path, "hover", QUIET, steps=500, goal="1 0 0")
    plant.reset(np.array([0.0, 0.0, 2.0, 0.0]))
    end = plant.advance(hold(1.0, 0.0), np.random.default_rng(0))
    assert end.outcome is Outcome.GOAL
    assert 2.0 * end.time + 0.5 * end.time**2 == pytest.approx(0.9, abs=3.0 * STEP)


def test_a_rovers_path_is_as_long_as_its_mean_whatever_the_noise_along_it(tmp_path):
    problem = problem_of("rover")(load(scene_file(tmp_path), robot="rover"), 0.1)
    rng, totals, rough = np.random.default_rng(1), [], []
    assert spread(problem, np.zeros(3)) == pytest.approx(0.0, abs=1e-18)
    for _ in range(40):
        x = np.zeros((3001, 3))
        x[1:, 0] = np.cumsum(STEP + 0.1 * np.sqrt(STEP) * rng.standard_normal(3000))
        length = Length(x[0, :2])
        length.add(problem, x[1:], STEP, float(np.abs(np.diff(x[:, 0])).sum()))
        totals.append(length.total / x[-1, 0])
        rough.append(length.noisy / x[-1, 0])
    assert np.mean(totals) == pytest.approx(1.0, rel=0.01)
    assert np.mean(rough) > 1.5


@pytest.mark.parametrize(("robot", "values"), [("rover", (0.03, 0.05, 300, 2000)), ("car", (0.1, 0.1, 300, 1000))])
def test_a_scene_for_others_leaves_a_robot_its_own_settings_and_gives_a_rover_its_noise(robot, values):
    scenario = prepare("clutter", robot=robot)
    s = scenario.settings
    assert (s.noise, s.period, s.samples, s.vertices) == values
    assert np.all(np.isinf(control_limits(scenario.loaded.model, scenario.loaded.command, scenario.problem.dynamics)))
    if robot == "rover":
        np.testing.assert_allclose(scenario.problem.dynamics.input_noise, np.diag([0.03, 0.06]))
        assert scenario.problem.temperature == pytest.approx(2.0 * 0.03**2)


def test_neither_turns_nor_noise_on_the_heading_slow_a_car_down(tmp_path):
    """After 4 s of 3 rad/s and noise of 0.5: a share of 3e-4 at most, where projection alone would brake by 0.4."""
    plant, _ = pair(tmp_path, "car", QUIET, steps=2000)
    plant.reset(np.array([0.0, 0.0, 0.0, 1.0]))
    turns = 3.0 + 0.5 * np.random.default_rng(3).standard_normal(2000) / np.sqrt(STEP)
    end = plant.advance(lambda x, s: np.array([turns[round(s / STEP)], 0.0]), np.random.default_rng(0)).states[-1]
    assert end[3] == pytest.approx(1.0, abs=3e-4)
    assert end[2] == pytest.approx(STEP * turns.sum(), abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0 0.5 0", "0 0 0"), ('mass="1"', 'mass="2"'), ('<joint name="x" ', '<joint name="x" damping="1" '),
        ('<motor name="ahead" site="axis" gear="1', '<motor name="ahead" site="axis" gear="2'),
    ],
    ids=["cornering costs speed", "heavier", "damped", "geared"],
)  # fmt: skip
def test_a_car_whose_speed_does_not_follow_is_refused_in_one_line(tmp_path, old, new):
    text = (models_folder() / "robots" / "car.xml").read_text()
    assert text.count(old) == 1
    (tmp_path / "machine.xml").write_text(text.replace(old, new))
    with pytest.raises(OptionError) as caught:
        prepare("slit", robot=tmp_path / "machine.xml")
    said = str(caught.value)
    assert "instead of" in said
    assert "half of the sideways acceleration keeps the speed in turns" in said
    assert "\n" not in said


def test_speed_is_no_state_of_a_robot_with_commanded_velocities():
    with pytest.raises(OptionError, match="is no motor, and car is commanded forces"):
        prepare("slit", robot="unicycle", system="second_order_car")
    assert len(prepare("slit", robot="unicycle", system="second_order_car", given={"plant": "sde"}).plant().state) == 4
