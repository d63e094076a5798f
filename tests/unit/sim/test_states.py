"""Adapters of states: joints, starts and pictures of robots on the ground, and a robot in space as another one."""

import mujoco
import numpy as np
import pytest

from pirrht.geometry.scene import Goal
from sim import states
from sim.mjcf.obstacles import read_workspace
from sim.states import adapter_of
from sim.states.plane import Plane
from sim.systems import System

SLIDES = """<mujoco><worldbody><body name="robot"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="y" type="slide" axis="0 1 0"/>{more}<geom size="0.1"/></body>{sites}</worldbody>
<keyframe><key name="start"/></keyframe></mujoco>"""
HINGE = '<joint name="yaw" type="hinge" axis="0 0 1"/>'


@pytest.mark.parametrize(
    ("names", "more"),
    [(("x", "y"), ""), (("x", "y", "vx", "vy"), ""), (("x", "y", "heading"), HINGE),
     (("x", "y", "heading", "speed"), HINGE), (("x", "y", "speed", "heading"), HINGE)],
)  # fmt: skip
def test_a_state_is_read_as_it_was_placed_and_starts_where_it_is(names, more):
    model, rng = mujoco.MjModel.from_xml_string(SLIDES.format(more=more, sites="")), np.random.default_rng(3)
    adapter, data = adapter_of(names), mujoco.MjData(model)
    joints = adapter.joints(model)
    for x in rng.uniform(-3.0, 3.0, (20, len(names))):
        joints.place(data, x, np.zeros(2), np.zeros(0))
        np.testing.assert_allclose(joints.read(data, np.zeros(len(names))), x, atol=1e-12)
        still = adapter.state_of(adapter.start_of(x))
        np.testing.assert_allclose(still, np.where([name in adapter.pose for name in names], x, 0.0), atol=1e-12)
        far = x.copy()
        far[:2] += rng.normal(size=2)
        assert np.hypot(*adapter.ahead(x, far)[:2]) == pytest.approx(np.hypot(*(far - x)[:2]))


class Space(Plane):
    """A ball that slides along x, y and z: what another adapter states, and nothing elsewhere."""

    pose = ("x", "y", "z")
    dimension = 3
    velocities = ("vx", "vy", "vz")
    speeds = ()
    goal_form = ("X", "Y", "Z", "R")
    border_form = ("X0", "X1", "Y0", "Y1", "Z0", "Z1")

    def start(self, data, site, given):
        return np.array(data.site_xpos[site] if given is None else given, dtype=float)

    def drawn(self, places, height):
        return places[..., :3]


def test_a_robot_in_space_is_another_adapter_and_a_line_in_the_registry(monkeypatch):
    monkeypatch.setattr(states, "ADAPTERS", (Plane, Space))
    sites = '<site name="start" pos="1 2 3"/><site name="workspace" type="box" pos="0 0 2" size="4 5 2"/>'
    model = mujoco.MjModel.from_xml_string(
        SLIDES.format(more='<joint name="z" type="slide" axis="0 0 1"/>', sites=sites)
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ball = System(name="ball", dynamics=lambda settings: None, R=np.eye(3), states=("x", "y", "z", "vx", "vy", "vz"))
    adapter = ball.adapter
    assert isinstance(adapter, Space)
    assert (adapter.places, adapter.typed()) == (("x", "y", "z"), "X Y Z VX VY VZ")
    x = adapter.state_of(adapter.start(data, model.site("start").id, None))
    assert x.tolist() == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0]
    assert adapter.drawn(x[None], 0.1).tolist() == [[1.0, 2.0, 3.0]]
    assert np.array(read_workspace(model, data, None, adapter.dimension)).tolist() == [
        [-4.0, -5.0, 0.0],
        [4.0, 5.0, 4.0],
    ]
    joints = adapter.joints(model)
    x[3:] = 0.5, -1.0, 2.0
    joints.place(data, x, np.zeros(2), np.zeros(0))
    np.testing.assert_array_equal(data.qpos, x[:3])
    np.testing.assert_array_equal(joints.read(data, np.zeros(6)), x)
    assert states.forms_of("goal_form") == ("X Y R", "+")
    assert isinstance(adapter_of(("x", "y", "heading")), Plane)
    with pytest.raises(ValueError, match='the first two must be "x" and "y", or the first three must be "x", "y" and'):
        adapter_of(("y", "x"))


@pytest.mark.parametrize("site", ['type="sphere" size="0.4"', 'type="cylinder" size="0.4 0.01"'])
def test_a_goal_on_the_ground_is_the_disc_of_its_site(site):
    model = mujoco.MjModel.from_xml_string(SLIDES.format(more="", sites=f'<site name="goal" pos="1 2 0" {site}/>'))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    goal = adapter_of(("x", "y")).goal(model, data, 0, None)
    assert isinstance(goal, Goal)
    assert (goal.center.tolist(), goal.radius) == ([1.0, 2.0], 0.4)
