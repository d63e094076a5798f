"""Small MJCF texts and the way tests load what is wrong."""

import pytest

from pirrht.errors import PirrhtError
from sim.mjcf import load
from sim.systems import SYSTEMS

ON_GROUND = tuple(robot for one in SYSTEMS if one.adapter.dimension == 2 for robot in one.robots)
GOAL = '<site name="goal" type="cylinder" pos="9 9 0" size="0.4 0.01"/>'
START = '<site name="start" pos="1 1 0"/>'
SPACE = '<site name="workspace" type="box" pos="5 5 0" size="5 5 1"/>'
SITES = GOAL + START + SPACE
FLOOR = '<geom name="floor" type="plane" size="6 7 0.1"/>'
ROBOT = {
    "body": '<body name="robot">',
    "joints": '<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>',
    "geom": '<geom name="footprint" size="0.1" pos="0 0 0.1"/>',
    "dynamics": '<text name="pirrht_dynamics" data="single_integrator"/>',
    "command": '<numeric name="pirrht_command" data="1 0 0 1"/>',
}
# a wall from side to side, so that no way leads to the goal
WALL = """<mujoco model="wall"><worldbody>
  <geom name="floor" type="plane" pos="2 2 0" size="2 2 0.1"/>
  <geom name="wall" type="box" pos="2 2 0.25" size="0.1 2.1 0.25"/>
  <site name="start" pos="0.4 2 0"/>
  <site name="goal" type="cylinder" pos="3.6 2 0" size="0.2 0.01"/>
  <site name="workspace" type="box" pos="2 2 0.5" size="2 2 0.5"/>
</worldbody></mujoco>"""


def mjcf(world: str, *, head: str = "") -> str:
    return f'<mujoco><compiler angle="degree"/>{head}<worldbody>{world}</worldbody></mujoco>'


def robot_mjcf(**changes: str) -> str:
    part = ROBOT | changes
    return (
        "<mujoco><custom>" + part["dynamics"] + part["command"] + "</custom>"
        "<worldbody>" + part["body"] + part["joints"] + part["geom"] + "</body></worldbody>"
        '<actuator><velocity joint="x" kv="500"/><velocity joint="y" kv="500"/></actuator></mujoco>'
    )


def refusal(*args, by=load, **options) -> str:
    with pytest.raises(PirrhtError) as caught:
        by(*args, **options)
    message = str(caught.value)
    assert "\n" not in message
    return message
