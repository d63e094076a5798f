"""Scenes, robots and requests that break a convention are refused in one line that names file and element."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mjcf_samples import FLOOR, GOAL, ROBOT, SITES, SPACE, START, mjcf, refusal, robot_mjcf

from sim.mjcf import load, models_folder


@pytest.fixture
def write(tmp_path: Path):
    def write(text: str | bytes, name: str = "scene.xml") -> Path:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


JOINT = '<body name="swing"><joint name="hinge"/><geom size="0.1"/></body>'
FIELD = '<asset><hfield name="hills" nrow="2" ncol="2" size="1 1 1 1" elevation="0 1 1 0"/></asset>'
BAD_SCENES = {
    "no goal": (mjcf(START + SPACE), 'site "goal"'),
    "box as goal": (mjcf(SITES.replace("cylinder", "box")), 'site "goal"'),
    "lying goal": (mjcf(SITES.replace('size="0.4 0.01"', 'size="0.4 0.01" euler="90 0 0"')), 'site "goal"'),
    "no start": (mjcf(GOAL + SPACE), 'site "start"'),
    "start outside": (mjcf(SITES.replace("1 1 0", "11 1 0")), "start"),
    "start in a wall": (mjcf(SITES + '<geom name="rock" size="0.5" pos="1.2 1 0"/>'), 'geom "rock"'),
    "goal outside": (mjcf(SITES.replace("9 9 0", "9 19 0")), "goal"),
    "no border": (mjcf(GOAL + START), '"workspace"'),
    "endless floor": (mjcf(GOAL + START + FLOOR.replace("6 7", "0 0")), 'geom "floor"'),
    "sphere as workspace": (mjcf(SITES.replace('type="box"', 'type="sphere"')), 'site "workspace"'),
    "askew workspace": (mjcf(SITES.replace("5 5 1", '5 5 1" euler="0 0 20')), 'site "workspace"'),
    "wall plane": (
        mjcf(SITES + '<geom name="side" type="plane" size="1 1 1" euler="90 0 0"/>'),
        'geom "side"',
    ),
    "ceiling": (
        mjcf(SITES + '<geom name="lid" type="plane" size="1 1 1" pos="0 0 1" euler="180 0 0"/>'),
        "lid",
    ),
    "raised floor": (
        mjcf(SITES + '<geom name="deck" type="plane" size="1 1 1" pos="0 0 0.1"/>'),
        'geom "deck"',
    ),
    "height field": (
        mjcf(SITES + '<geom name="hill" type="hfield" hfield="hills"/>', head=FIELD),
        'geom "hill"',
    ),
    "unnamed height field": (
        mjcf(SITES + '<geom type="hfield" hfield="hills"/>', head=FIELD),
        "geom number 0",
    ),
    "joint": (mjcf(SITES + JOINT), 'body "swing" moves by joint "hinge"'),
    "joint without a name": (
        mjcf(SITES + JOINT.replace('joint name="hinge"', "freejoint")),
        'body "swing" moves by a free joint; obstacles stand, or move by rows',
    ),
    "unknown default": (
        mjcf(SITES, head='<custom><numeric name="pirrht_nois" data="1"/></custom>'),
        '"pirrht_nois"',
    ),
    "two values": (
        mjcf(SITES, head='<custom><numeric name="pirrht_dt" data="1 2"/></custom>'),
        '"pirrht_dt"',
    ),
    "unknown text": (
        mjcf(SITES, head='<custom><text name="pirrht_a" data="b"/></custom>'),
        "and pirrht_about",
    ),
    "unknown robot": (mjcf(SITES, head='<custom><text name="pirrht_robot" data="bike"/></custom>'), "bike"),
    "zero radius": (mjcf(SITES, head='<custom><numeric name="pirrht_radius" data="0"/></custom>'), "radius"),
    "no time": (mjcf(SITES, head='<option timestep="0"/>'), "timestep"),
    "attribute": (mjcf(SITES + '<geom blob="1" size="1"/>'), "blob"),
    "negative size": (mjcf(SITES + '<geom name="hole" size="-1"/>'), "hole"),
    "missing mesh": (mjcf(SITES, head='<asset><mesh name="m" file="nowhere.stl"/></asset>'), "nowhere.stl"),
    "not closed": ("<mujoco><worldbody>", "not MJCF: no element found: line 1"),
    "words": ("once upon a time", "not MJCF"),
    "bytes": (bytes(range(256)), "not MJCF"),
    "nothing": (b"", "empty"),
}


@pytest.mark.parametrize("case", BAD_SCENES)
def test_a_bad_scene_is_refused_with_its_file_and_element(write, case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text, element = BAD_SCENES[case]
    message = refusal(write(text))
    assert element in message
    assert "scene" in message
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


BAD_ROBOTS = {
    "no root": ({"body": '<body name="car">'}, 'body "robot"'),
    "no footprint": ({"geom": '<geom size="0.1"/>'}, '"footprint"'),
    "box as footprint": ({"geom": '<geom name="footprint" type="box" size=".1 .1 .1"/>'}, '"footprint"'),
    "footprint aside": ({"geom": '<geom name="footprint" size="0.1" pos="0.1 0 0.1"/>'}, '"footprint"'),
    "nothing collides": (
        {"geom": '<geom name="footprint" size="0.1" contype="0" conaffinity="0"/>'},
        "contype",
    ),
    "no dynamics": ({"dynamics": ""}, '"pirrht_dynamics"'),
    "unknown dynamics": ({"dynamics": '<text name="pirrht_dynamics" data="bicycle"/>'}, '"bicycle"'),
    "no command": ({"command": ""}, '"pirrht_command"'),
    "short command": ({"command": '<numeric name="pirrht_command" data="1 0 0"/>'}, '"pirrht_command"'),
    "wrong axis": ({"joints": ROBOT["joints"].replace("0 1 0", "0 0 1")}, "slide along y"),
    "wrong place": ({"body": '<body name="robot" pos="1 0 0">'}, "origin"),
    "one joint too many": ({"joints": ROBOT["joints"] + '<joint name="z" axis="0 0 1"/>'}, "joints"),
    "wide load": (
        {"geom": ROBOT["geom"] + '<geom name="crate" type="box" size=".1 .1 .1"/>'},
        'geom "crate"',
    ),
}


WHEELS = {
    "sliding dynamics": ('data="unicycle"', 'data="single_integrator"', '"unicycle"'),
    "raised body": ('<body name="robot">', '<body name="robot" pos="0 0 0.1">', "origin"),
    "no ground": ('type="plane" size="0 0 0.1"', 'type="box" size="9 9 0.1"', '"ground"'),
    "colliding ground": ('group="4" contype="0"', 'group="4" contype="1"', '"ground"'),
    "raised wheels": ('pos="0 0.08 0.05"', 'pos="0 0.08 0.08"', "come to rest"),
    "no pair": (
        '<pair geom1="ground" geom2="left wheel"',
        '<pair geom1="bumper" geom2="left wheel"',
        "come to",
    ),
    "driven base": ('name="left" class="wheel" joint="left"', 'joint="base"', "hinge"),
}


@pytest.mark.parametrize("case", WHEELS)
def test_a_bad_robot_on_wheels_is_refused(write, case):
    good, bad, element = WHEELS[case]
    text = (models_folder() / "robots" / "diffdrive.xml").read_text()
    assert good in text
    message = refusal("slit", robot=write(text.replace(good, bad), "machine.xml"))
    assert element in message
    assert "machine.xml" in message


@pytest.mark.parametrize("case", BAD_ROBOTS)
def test_a_bad_robot_is_refused_with_its_file_and_element(write, case):
    changes, element = BAD_ROBOTS[case]
    path = write(robot_mjcf(**changes), "machine.xml")
    message = refusal("slit", robot=path)
    assert element in message
    assert "machine.xml" in message


def test_a_robot_file_that_keeps_the_conventions_drives(write):
    loaded = load("slit", robot=write(robot_mjcf(), "machine.xml"))
    assert (loaded.robot, loaded.scene.robot_radius) == ("machine", 0.1)


@pytest.mark.parametrize(
    ("scene", "options", "word"),
    [
        ("labyrinth", {}, "slit"),
        ("nowhere/maze.xml", {}, "maze.xml"),
        (Path("."), {}, "folder"),
        ("slit", {"robot": "tank"}, "puck"),
        ("slit", {"radius": 0.0}, "--radius"),
        ("slit", {"radius": -1.0}, "--radius"),
        ("slit", {"radius": np.nan}, "--radius"),
        ("slit", {"start": (1.0,)}, "start"),
        ("slit", {"start": (7.0, 1.0)}, "start"),
        ("slit", {"start": (np.nan, 1.0)}, "start"),
        ("slit", {"start": (3.4, 2.8)}, "upper wall"),
        ("slit", {"goal": (5.0, 2.0)}, "radius"),
        ("slit", {"goal": (5.0, 2.0, 0.0)}, "goal radius"),
        ("slit", {"goal": (5.0, 20.0, 0.3)}, "goal"),
    ],
)
def test_a_bad_request_is_refused_in_one_line(scene, options, word):
    assert word in refusal(scene, **options)


def test_a_file_by_another_ending_is_refused(write):
    assert "rename" in refusal(write(mjcf(SITES), "scene.mjcf"))
