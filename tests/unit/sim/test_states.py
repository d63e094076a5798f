"""Adapters of states: joints, starts, goals and pictures of robots on the ground and in space."""

import re

import mujoco
import numpy as np
import pytest

from pirrht.errors import SceneError
from pirrht.geometry.scene import Goal
from sim import states
from sim.mjcf.obstacles import read_workspace
from sim.states import adapter_of
from sim.states.space import Space

SLIDES = """<mujoco><worldbody><body name="robot"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="y" type="slide" axis="0 1 0"/>{more}<geom size="0.1"/></body>{sites}</worldbody>
<keyframe><key name="start"/></keyframe></mujoco>"""
UPWARD = '<joint name="z" type="slide" axis="0 0 1"/>'
HINGE = '<joint name="yaw" type="hinge" axis="0 0 1"/>'


@pytest.mark.parametrize(
    ("names", "more"),
    [(("x", "y"), ""), (("x", "y", "vx", "vy"), ""), (("x", "y", "heading"), HINGE),
     (("x", "y", "heading", "speed"), HINGE), (("x", "y", "speed", "heading"), HINGE), (("x", "y", "z"), UPWARD),
     (("x", "y", "z", "vx", "vy", "vz"), UPWARD), (("x", "y", "z", "vz"), UPWARD)],
)  # fmt: skip
def test_a_state_is_read_as_it_was_placed_and_starts_where_it_is(names, more):
    model, rng = mujoco.MjModel.from_xml_string(SLIDES.format(more=more, sites="")), np.random.default_rng(3)
    adapter, data = adapter_of(names), mujoco.MjData(model)
    joints = adapter.joints(model)
    for x in rng.uniform(-3.0, 3.0, (20, len(names))):
        joints.place(data, x, np.zeros(2), np.zeros(0))
        np.testing.assert_allclose(joints.read(data, np.zeros(len(names))), x, atol=1e-12)
        speeds = [x[names.index(name)] if name in names else 0.0 for name in ("vx", "vy", "vz")]
        np.testing.assert_array_equal(data.qvel[:3] if "z" in names else speeds, speeds)
        still = adapter.state_of(adapter.start_of(x))
        np.testing.assert_allclose(still, np.where([name in adapter.pose for name in names], x, 0.0), atol=1e-12)
        far = x.copy()
        far[:2] += rng.normal(size=2)
        assert np.hypot(*adapter.ahead(x, far)[:2]) == pytest.approx(np.hypot(*(far - x)[:2]))


PLACES = '<site name="start" pos="1 2 3"/><site name="goal" type="{}" pos="1 2 0.5" size="0.3 0.3"/>' + (
    '<site name="workspace" type="box" pos="0 0 2" size="4 5 2"/>'
)


def in_space(more: str = UPWARD, goal: str = "sphere") -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(SLIDES.format(more=more, sites=PLACES.format(goal)))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_a_robot_in_space_has_a_ball_as_goal_and_a_box_as_workspace():
    model, data = in_space()
    adapter = adapter_of(("x", "y", "z", "vx", "vy", "vz"))
    assert isinstance(adapter, Space)
    assert (adapter.places, adapter.typed()) == (("x", "y", "z"), "X Y Z VX VY VZ")
    x = adapter.state_of(adapter.start(data, model.site("start").id, None))
    assert x.tolist() == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0]
    assert adapter.drawn(x[None], 0.1).tolist() == [[1.0, 2.0, 3.0]]
    bounds = read_workspace(model, data, None, adapter.dimension)
    assert np.array(bounds).tolist() == [[-4.0, -5.0, 0.0], [4.0, 5.0, 4.0]]
    goal = adapter.goal(model, data, model.site("goal").id, None)
    assert (goal.center.tolist(), goal.radius) == ([1.0, 2.0, 0.5], 0.3)
    assert (adapter.unfit(model, "ball"), adapter.rest(model).tolist()) == ("", [0.0, 0.0, 0.0])
    assert adapter.borders_text(*bounds) == "x -4 to 4, y -5 to 5 and z 0 to 4"
    assert states.forms_of("goal_form") == ("X Y ...", "X Y R, or X Y Z R in space", {3, 4})
    with pytest.raises(ValueError, match='the first two must be "x" and "y", or the first three must be "x", "y" and'):
        adapter_of(("y", "x"))


@pytest.mark.parametrize(
    ("ask", "reason"),
    [
        (lambda space, model, data: space.start(data, -1, None), "or give --start X Y Z"),
        (lambda space, model, data: space.start(data, 0, (1.0, 2.0)), "the start has 2 numbers; give x, y and z"),
        (lambda space, model, data: space.goal(model, data, -1, None), "or give --goal X Y Z R"),
        (lambda space, model, data: space.goal(model, data, 1, None), 'site "goal" is no sphere'),
        (lambda space, model, data: space.goal(model, data, 1, (1, 2, 0.3)), "the goal has 3 numbers; give x, y, z"),
        (lambda space, model, data: space.goal(model, data, 1, (1, 2, 1, 1e5)), "write at most 10000 m"),
        (lambda space, model, data: space.unfit(model, "ball"), "slide along x, slide along y, slide along z"),
        (lambda space, model, data: read_workspace(model, data, (0, 1, 0, 1), 3), "x0 < x1 and y0 < y1 and z0 < z1"),
    ],
)
def test_a_task_in_space_of_too_few_numbers_is_refused(ask, reason):
    with pytest.raises(SceneError, match=re.escape(reason)):
        ask(adapter_of(("x", "y", "z")), *in_space(HINGE, "cylinder"))


@pytest.mark.parametrize("site", ['type="sphere" size="0.4"', 'type="cylinder" size="0.4 0.01"'])
def test_a_goal_on_the_ground_is_the_disc_of_its_site(site):
    model = mujoco.MjModel.from_xml_string(SLIDES.format(more="", sites=f'<site name="goal" pos="1 2 0" {site}/>'))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    goal = adapter_of(("x", "y")).goal(model, data, 0, None)
    assert isinstance(goal, Goal)
    assert (goal.center.tolist(), goal.radius) == ([1.0, 2.0], 0.4)
