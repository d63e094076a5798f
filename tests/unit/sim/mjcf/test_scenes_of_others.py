"""Scenes that were made for another robot: what moves is welded or left out, and all that is in the way is named."""

import mujoco
import numpy as np
import pytest
import trimesh
from mjcf_samples import GOAL, SITES, START, mjcf, refusal

from sim.mjcf import load

TASK = """<mujoco model="task"><compiler angle="degree" fusestatic="true"/>
  <worldbody>
    {sites}
    <body name="agent" pos="2 2 0.1"><joint name="slide x" type="slide" axis="1 0 0"/>
      <joint name="slide y" type="slide" axis="0 1 0"/><geom name="ball" size="0.1"/><site name="nose"/></body>
    <frame pos="1 1 0" euler="0 0 90"><frame euler="0 0 -30">
      <body name="door" pos="3 0 0" euler="0 0 10"><joint name="hinge" axis="0 0 1"/>
        <geom name="leaf" type="box" size="0.5 0.05 0.5" pos="0.5 0 0"/>
        <body name="knob" pos="1 0 0.2"><joint name="turn" type="ball"/><geom name="knob" size="0.05 0.1 0.05"
          type="box"/></body></body></frame></frame>
    <body name="cube"><freejoint/><geom name="cube" type="box" size="0.2 0.2 0.2"/></body>
    <body name="cart" mocap="true" pos="1 8 0"><geom name="cart" size="0.3"/></body>
    <camera name="behind" mode="targetbody" target="agent" pos="0 0 1"/>
    <light mode="targetbodycom" target="agent"/>
  </worldbody>
  <tendon><fixed name="rope"><joint joint="slide x" coef="1"/></fixed></tendon>
  <actuator><motor name="push" joint="slide x"/><motor tendon="rope"/><motor name="open" joint="hinge"/></actuator>
  <equality><joint joint1="slide x" joint2="hinge"/></equality>
  <sensor><jointpos joint="hinge"/><framepos objtype="site" objname="nose"/></sensor>
  <contact><exclude body1="agent" body2="cube"/><pair geom1="ball" geom2="leaf"/></contact>
  <custom><tuple name="parts"><element objtype="joint" objname="hinge"/></tuple></custom>
  <keyframe><key name="home" qpos="0.5 0  40  1 0 0 0  6 2 0.2 1 0 0 0.3" mpos="1 7 0"/></keyframe>
</mujoco>"""


@pytest.fixture
def task(write):
    return write(TASK.format(sites=SITES))


def places(model: mujoco.MjModel, data: mujoco.MjData, names) -> np.ndarray:
    mujoco.mj_kinematics(model, data)
    return np.array([[*data.geom(name).xpos, *data.geom(name).xmat] for name in names])


def test_what_moves_is_welded_where_the_keyframe_has_it(task):
    names = ("ball", "leaf", "knob", "cube", "cart")
    alone = mujoco.MjModel.from_xml_path(str(task))
    data = mujoco.MjData(alone)
    mujoco.mj_resetDataKeyframe(alone, data, 0)
    loaded = load(task, freeze=True)
    frozen = mujoco.MjData(loaded.model)
    np.testing.assert_allclose(places(loaded.model, frozen, names), places(alone, data, names), atol=1e-12)
    assert loaded.model.njnt == 2  # the robot's own
    assert loaded.model.nu == 2
    assert set(names) <= {solid.name for solid in loaded.scene.obstacles}
    assert loaded.notes == ('frozen as keyframe "home" has them: agent, door, cube; 3 actuators dropped',)


def test_without_a_keyframe_bodies_stay_where_their_joints_are_at_rest(write):
    world = '<body name="swing" pos="5 5 0"><joint axis="0 0 1" ref="30"/><geom type="box" size="1 0.1 1"/></body>'
    loaded = load(write(mjcf(SITES + world)), freeze=True)
    np.testing.assert_allclose(loaded.scene.obstacles[0].rotation, np.eye(3), atol=1e-12)
    assert loaded.notes == ("frozen as the default pose has them: swing",)


def test_a_body_is_left_out_with_all_that_refers_to_it(task):
    loaded = load(task, freeze=True, without=["agent"])
    assert "ball" not in {solid.name for solid in loaded.scene.obstacles}
    assert loaded.notes == (
        "left out: agent and 2 actuators",
        'frozen as keyframe "home" has them: door, cube; 1 actuator dropped',
    )


def test_bodies_that_can_or_should_be_left_out_are_named(task):
    assert '"agent", "door", "cube", "cart"' in refusal(task, without=["agnet"])
    assert 'leave out body "agent"' in refusal(task, freeze=True, start=(2.4, 2.0))


def test_all_that_is_in_the_way_is_named_at_once(write):
    message = refusal(write(TASK.format(sites='<geom name="ramp" type="plane" size="1 1 1" euler="20 0 0"/>')))
    for part in (
        '3 actuators ("push", "open")', 'body "agent" moves by joint "slide x", joint "slide y"',
        'body "door" moves by joint "hinge", joint "turn"', 'body "cube" moves by a free joint', 'geom "ramp"',
        'no site "workspace"', 'no site "goal"', 'no site "start"', "--freeze", "--without agent",
    ):  # fmt: skip
        assert part in message


def test_a_workspace_is_given_to_a_scene_with_an_endless_floor(write):
    path = write(mjcf(GOAL + START + '<geom type="plane" size="0 0 0.1"/>'))
    scene = load(path, workspace=(0, 10, -1, 12)).scene
    np.testing.assert_allclose([*scene.lower, *scene.upper], [0, -1, 10, 12])
    assert "--workspace X0 X1 Y0 Y1" in refusal(path)
    assert "x0 < x1" in refusal(path, workspace=(0, 0, -1, 12))


def test_a_concave_mesh_counts_as_its_hull_which_a_note_tells_with_both_volumes(write):
    bounds = [[0, 0, 0], [3, 1, 1]], [[0, 1, 0], [1, 3, 1]]
    angle = trimesh.util.concatenate([trimesh.creation.box(bounds=part) for part in bounds])
    vertices, faces = (" ".join(map(str, part.ravel())) for part in (angle.vertices, angle.faces))
    asset = f'<asset><mesh name="angle" vertex="{vertices}" face="{faces}"/></asset>'
    arms = '<geom name="arms" type="mesh" mesh="angle" pos="4 4 0" euler="0 0 30"/>'
    loaded = load(angled := write(mjcf(SITES + arms, head=asset)))
    (note,) = loaded.notes
    assert 'geom "arms" (7 m3, of which the mesh fills 5)' in note
    assert "pirrht import MESH" in note
    assert len(loaded.scene.obstacles[0].vertices) == 10  # the inner edge is gone
    message = refusal(angled, start=(4.6, 6.2))
    assert 'touches the convex hull of geom "arms" (7 m3' in message
    assert "pirrht import MESH" in message


def test_what_deforms_is_refused_by_name(write):
    cloth = '<flexcomp name="cloth" type="grid" count="5 5 1" spacing=".1 .1 .1" pos="5 5 .5" dim="2"/>'
    assert 'flex "cloth" deforms' in refusal(write(mjcf(SITES + cloth)))
