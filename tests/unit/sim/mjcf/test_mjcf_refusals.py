"""Scenes, robots and requests that break a convention are refused in one line that names file and element."""

from pathlib import Path

import pytest
from mjcf_samples import FLOOR, GOAL, ROBOT, SITES, SPACE, START, mjcf, refusal, robot_mjcf

from sim.mjcf import load, models_folder

JOINT = '<body name="swing"><joint name="hinge"/><geom size="0.1"/></body>'
FIELD = '<asset><hfield name="hills" nrow="2" ncol="2" size="1 1 1 1" elevation="0 1 1 0"/></asset>'
PLANE = '<geom name="side" type="plane" size="1 1 1" {}/>'


def custom(kind: str, name: str, data: str) -> str:
    return mjcf(SITES, head=f'<custom><{kind} name="pirrht_{name}" data="{data}"/></custom>')


BAD_SCENES: list[tuple[str | bytes, str]] = [
    (mjcf(START + SPACE), 'site "goal"'),
    (mjcf(SITES.replace("cylinder", "box")), 'site "goal"'),
    (mjcf(SITES.replace('size="0.4 0.01"', 'size="0.4 0.01" euler="90 0 0"')), 'site "goal"'),
    (mjcf(GOAL + SPACE), 'site "start"'),
    (mjcf(SITES.replace("1 1 0", "11 1 0")), "start"),
    (mjcf(SITES + '<geom name="rock" size="0.5" pos="1.2 1 0"/>'), 'geom "rock"'),
    (mjcf(SITES.replace("9 9 0", "9 19 0")), "goal"),
    (mjcf(GOAL + START), '"workspace"'),
    (mjcf(GOAL + START + FLOOR.replace("6 7", "0 0")), 'geom "floor"'),
    (mjcf(SITES.replace('type="box"', 'type="sphere"')), 'site "workspace"'),
    (mjcf(SITES.replace("5 5 1", '5 5 1" euler="0 0 20')), 'site "workspace"'),
    (mjcf(SITES + PLANE.format('euler="90 0 0"')), 'geom "side"'),
    (mjcf(SITES + PLANE.format('pos="0 0 1" euler="180 0 0"')), "side"),
    (mjcf(SITES + PLANE.format('pos="0 0 0.1"')), 'geom "side"'),
    (mjcf(SITES + '<geom name="hill" type="hfield" hfield="hills"/>', head=FIELD), 'geom "hill"'),
    (mjcf(SITES + '<geom type="hfield" hfield="hills"/>', head=FIELD), "geom number 0"),
    (mjcf(SITES + JOINT), 'body "swing" moves by joint "hinge"'),
    (mjcf(SITES + JOINT.replace('joint name="hinge"', "freejoint")), 'body "swing" moves by a free joint; obstacles'),
    (custom("numeric", "nois", "1"), '"pirrht_nois"'),
    (custom("numeric", "dt", "1 2"), '"pirrht_dt"'),
    (custom("numeric", "radius", "0"), "radius"),
    (custom("text", "a", "b"), "pirrht_robot, pirrht_about"),
    (custom("text", "robot", "bike"), "bike"),
    (mjcf(SITES, head='<option timestep="0"/>'), "timestep"),
    (mjcf(SITES + '<geom blob="1" size="1"/>'), "blob"),
    (mjcf(SITES + '<geom name="hole" size="-1"/>'), "hole"),
    (mjcf(SITES, head='<asset><mesh name="m" file="nowhere.stl"/></asset>'), "nowhere.stl"),
    ("<mujoco><worldbody>", "not MJCF"),
    ("once upon a time", "not MJCF"),
    (bytes(range(256)), "not MJCF"),
    (b"", "empty"),
]


@pytest.mark.parametrize(("text", "element"), BAD_SCENES)
def test_a_bad_scene_is_refused_with_its_file_and_element(write, text, element, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    message = refusal(write(text))
    assert element in message
    assert "scene" in message
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_a_robot_file_that_keeps_the_conventions_is_read_and_one_by_another_ending_is_not(write):
    loaded = load("slit", robot=write(robot_mjcf(), "machine.xml"))
    assert (loaded.robot, loaded.scene.robot_radius) == ("machine", 0.1)
    assert "rename" in refusal("slit", robot=write(robot_mjcf(), "machine.mjcf"))


BAD_ROBOTS = [
    ({"body": '<body name="car">'}, 'body "robot"'),
    ({"geom": '<geom size="0.1"/>'}, 'this file has no sphere geom "footprint" in its body "robot"; add it'),
    ({"geom": '<geom name="footprint" type="box" size=".1 .1 .1"/>'}, '"footprint"'),
    ({"geom": '<geom name="footprint" size="0.1" pos="0.1 0 0.1"/>'}, '"footprint"'),
    ({"geom": '<geom name="footprint" size="0.1" contype="0" conaffinity="0"/>'}, "contype"),
    ({"geom": ROBOT["geom"] + '<geom name="crate" type="box" size=".1 .1 .1"/>'}, 'geom "crate"'),
    ({"dynamics": ""}, '"pirrht_dynamics"'),
    ({"dynamics": '<text name="pirrht_dynamics" data="bicycle"/>'}, '"bicycle"'),
    ({"command": ""}, '"pirrht_command"'),
    ({"command": '<numeric name="pirrht_command" data="1 0 0"/>'}, '"pirrht_command"'),
    ({"joints": ROBOT["joints"].replace("0 1 0", "0 0 1")}, "slide along y"),
    ({"joints": ROBOT["joints"] + '<joint name="z" axis="0 0 1"/>'}, "joints"),
    ({"body": '<body name="robot" pos="1 0 0">'}, "origin"),
]
BAD_WHEELS = [
    ('data="unicycle"', 'data="single_integrator"', '"unicycle"'),
    ('<body name="robot">', '<body name="robot" pos="0 0 0.1">', "origin"),
    ('type="plane" size="0 0 0.1"', 'type="box" size="9 9 0.1"', '"ground"'),
    ('group="4" contype="0"', 'group="4" contype="1"', '"ground"'),
    ('pos="0 0.08 0.05"', 'pos="0 0.08 0.08"', "come to rest"),
    ('<pair geom1="ground" geom2="left wheel"', '<pair geom1="bumper" geom2="left wheel"', "come to"),
    ('name="left" class="wheel" joint="left"', 'joint="base"', "hinge"),
]


@pytest.mark.parametrize(("changes", "element"), [*BAD_ROBOTS, *((bad[:2], bad[2]) for bad in BAD_WHEELS)])
def test_a_bad_robot_is_refused_with_its_file_and_element(write, changes, element):
    wheels = (models_folder() / "robots" / "diffdrive.xml").read_text()
    assert isinstance(changes, dict) or changes[0] in wheels
    text = robot_mjcf(**changes) if isinstance(changes, dict) else wheels.replace(*changes)
    message = refusal("slit", robot=write(text, "machine.xml"))
    assert element in message
    assert "machine.xml" in message


@pytest.mark.parametrize(
    ("scene", "options", "word"),
    [
        ("labyrinth", {}, "slit"),
        ("nowhere/maze.xml", {}, "maze.xml"),
        (Path("."), {}, "folder"),
        ("slit", {"robot": "tank"}, "puck"),
        ("slit", {"start": (1.0,)}, "start"),
        ("slit", {"start": (3.4, 2.8)}, "upper wall"),
        ("slit", {"goal": (5.0, 2.0)}, "radius"),
        ("slit", {"goal": (5.0, 2.0, 0.0)}, "goal radius"),
    ],
)
def test_a_bad_request_is_refused_in_one_line(scene, options, word):
    assert word in refusal(scene, **options)
