"""Scenes that a lidar finds other than expected: a person who steps into a door, and a door that is closed."""

from pathlib import Path

SCENE = """<mujoco model="surprise">
<custom>{motion}<numeric name="pirrht_radius" data=".2"/></custom>
<worldbody>
{parts}
<site name="workspace" type="box" size="{sides}" pos="{sides}"/>
<site name="start" pos="{start} 0"/><site name="goal" type="cylinder" size=".3 .01" pos="{goal} 0"/>
</worldbody></mujoco>"""
PERSON = '<body name="person" mocap="true" pos="3.6 .6 .3"><geom name="person" type="cylinder" size=".25 .3"/></body>'


def box(name: str, x0: float, y0: float, x1: float, y1: float) -> str:
    size = f"{(x1 - x0) / 2:g} {(y1 - y0) / 2:g} .3"
    return f'<geom name="{name}" type="box" size="{size}" pos="{(x0 + x1) / 2:g} {(y0 + y1) / 2:g} .3"/>'


def person_in_a_door(folder: Path, rows: str) -> Path:
    """A wall with two doors; a person comes to the nearer one."""
    path = folder / "person.xml"
    walls = (box("low", 2.9, 0, 3.1, 1), box("middle", 2.9, 2, 3.1, 4), box("high", 2.9, 5, 3.1, 5.5))
    motion = f'<numeric name="pirrht_motion_person" data="{rows}"/>'
    parts = "\n".join([*walls, PERSON])
    path.write_text(SCENE.format(motion=motion, parts=parts, sides="3 2.75 .5", start=".8 1.5", goal="5.2 1.5"))
    return path


def closed_door(folder: Path) -> Path:
    """Two ways around a block; the shorter one has a door behind a corner, which is closed."""
    path = folder / "closed.xml"
    parts = "\n".join([box("block", 2.5, 1.5, 5.5, 4), box("door", 5, 4, 5.2, 5)])
    path.write_text(SCENE.format(motion="", parts=parts, sides="4 2.5 .5", start="1 3.2", goal="7 3.6"))
    return path
