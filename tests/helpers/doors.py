"""A wall with one door, and somebody who walks into it and stays for a while, or for good."""

from pathlib import Path

DOOR = """<mujoco model="door">
<custom><numeric name="pirrht_motion_guard" data="{rows}"/><numeric name="pirrht_max_time" data="{most}"/></custom>
<worldbody>
<geom name="left" type="box" size=".08 .9 .3" pos="2.6 2.6 .3"/>
<geom name="right" type="box" size=".08 .5 .3" pos="2.6 .5 .3"/>
<body name="guard" mocap="true" pos="3.4 1.9 .3"><geom name="guard" type="cylinder" size=".22 .3"/></body>
<site name="workspace" type="box" size="2.5 1.75 .5" pos="2.5 1.75 .5"/>
<site name="start" pos=".7 1.35 0"/><site name="goal" type="cylinder" size=".3 .01" pos="4.4 1.35 0"/>
</worldbody></mujoco>"""
COMES, GOES = "0 3.4 1.9 0  1.2 2.6 1.35 0", "  5.5 2.6 1.35 0  7 3.6 .5 0"


def door(folder: Path, *, stays: bool = False) -> str:
    """The file of the scene; the guard is in the door from 1.2 to 5.5 s, or until the end at 7 s."""
    path = folder / "door.xml"
    path.write_text(DOOR.format(rows=COMES if stays else COMES + GOES, most=7 if stays else 40))
    return str(path)
