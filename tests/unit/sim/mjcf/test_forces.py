"""Robots that are driven by forces, and what of them is refused in one line."""

from contextlib import nullcontext

import numpy as np
import pytest
from mjcf_samples import ROBOT, refusal, robot_mjcf

from pirrht import OptionError
from pirrht.systems.double_integrator import DoubleIntegrator
from sim.mjcf import load, models_folder
from sim.mjcf.robot import check_motion
from sim.scenario import prepare

MOTORS = '<motor name="x" joint="x"/>\n    <motor name="y" joint="y"/>'
SERVOS = '<velocity name="x" joint="x" kv="500"/><velocity name="y" joint="y" kv="500"/>'


def robot(folder, *pairs: tuple[str, str], name: str = "robots/hover"):
    """A copy of a built-in file with parts of its text replaced."""
    text, path = (models_folder() / f"{name}.xml").read_text(), folder / "machine.xml"
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path.write_text(text)
    return path


def test_actuators_suit_the_system(tmp_path):
    for pair, words in (
        ((MOTORS, SERVOS), 'actuator "x" is no motor, and double_integrator is commanded forces'),
        (("double_integrator", "single_integrator"), 'actuator "x" is a motor, and single_integrator'),
    ):
        assert f"machine.xml: {words}" in refusal("slit", robot=robot(tmp_path, pair))


@pytest.mark.parametrize(
    ("machine", "system", "words"),
    [
        ("puck", "double_integrator", 'actuator "robot/x" is no motor'),
        ("diffdrive", "second_order_car", "no speed, which is a state of car; states that it can have are x, y, head"),
    ],
)
def test_what_a_robot_cannot_do_is_refused_unless_the_plant_is_the_equation(machine, system, words):
    assert words in refusal("slit", robot=machine, system=system, by=prepare)
    assert len(prepare("slit", robot=machine, system=system, given={"plant": "sde"}).plant().state) == 4


@pytest.mark.parametrize(
    ("change", "control", "made"),
    [
        (('mass="1"', 'mass="2"'), "(1, 0)", "(0.5, 0)"),
        (('data="1 0  0 1"', 'data="0 1  1 0"'), "(1, 0)", "(0, 1)"),
        (('data="1 0  0 1"', 'data="-1 0  0 1"'), "(1, 0)", "(-1, 0)"),
        (('<joint name="x" ', '<joint name="x" damping="0.1" '), "(0, 0)", "(-0.1, 0)"),
        (('<joint name="x" ', '<joint name="x" damping="0.0006" '), "(0, 0)", "(-0.0006, 0)"),
        (('<joint name="y" ', '<joint name="y" armature="1" '), "(0, 1)", "(0, 0.5)"),
        (('integrator="Euler"', 'integrator="Euler" gravity="1 0 0"'), "(0, 0)", "(1, 0)"),
        (('<motor name="x" ', '<motor name="x" gear="3" '), "(1, 0)", "(3, 0)"),
        (('<motor name="x" ', '<motor name="x" ctrlrange="-0.5 0.5" ctrllimited="true" '), "(1, 0)", "(0.5, 0)"),
    ],
)
def test_a_command_that_does_not_accelerate_the_robot_by_itself_is_refusal(tmp_path, change, control, made):
    message = refusal("slit", robot=robot(tmp_path, change), by=prepare)
    assert f"the control {control} of hover" in message
    assert f"vx, vy change by {made} per second instead of {control}: make pirrht_command its mass over" in message


class Raft(DoubleIntegrator):
    """A mass of 1 kg in water that brakes it."""

    parameters = np.array([4.0])  # [1/s]

    @staticmethod
    def drift(x, p, out):
        out[0], out[1], out[2], out[3] = x[2], x[3], -p[0] * x[2], -p[0] * x[3]

    def twist(self, x, rate):
        return rate + self.parameters[0] * x[2:]


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_damping_is_that_of_the_equation_however_mujoco_integrates_it(tmp_path, integrator):
    for damping, fits in (("4", True), ("4.001", False)):
        changes = [(f'<joint name="{name}" ', f'<joint name="{name}" damping="{damping}" ') for name in "xy"]
        loaded = load("slit", robot=robot(tmp_path, *changes, ('integrator="Euler"', f'integrator="{integrator}"')))
        with nullcontext() if fits else pytest.raises(OptionError, match=r"change by \(-4.001, -4.001\) per second"):
            check_motion(loaded.model, "raft", Raft(b=0.1), loaded.command)


def test_mass_and_gear_may_be_any_if_the_command_knows_them(tmp_path):
    changes = (
        ('mass="1"', 'mass="3"'),
        ('data="1 0  0 1"', 'data="1.5 0  0 3"'),
        ('name="x" joint', 'name="x" gear="2" joint'),
    )
    plant = prepare("slit", robot=robot(tmp_path, *changes), given={"noise": 1e-6}).plant()
    states = plant.advance(lambda x, s: np.array([1.0, -2.0]), np.random.default_rng(0)).states
    np.testing.assert_allclose(states[-1, 2:], np.array([1.0, -2.0]) * 0.002 * len(states), atol=1e-5)


def test_forces_are_not_tuned_to_the_physics_step(tmp_path):
    scene = robot(tmp_path, ('timestep="0.002"', 'timestep="0.005"'), name="scenes/slit")
    np.testing.assert_array_equal(load(scene, robot="hover").model.actuator_gainprm[:, 0], 1.0)


def test_a_robot_of_ones_own_is_driven_by_motors_in_twenty_lines(write):
    text = robot_mjcf(
        dynamics=ROBOT["dynamics"].replace("single", "double"), geom=ROBOT["geom"].replace("/>", ' mass="1"/>')
    )
    scenario = prepare("slit", robot=write(text.replace("<velocity", "<motor").replace(' kv="500"', "")))
    assert isinstance(scenario.problem.dynamics, DoubleIntegrator)
    np.testing.assert_array_equal(scenario.plant().state, [1.0, 2.5, 0.0, 0.0])
