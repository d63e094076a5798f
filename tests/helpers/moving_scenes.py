"""Scenes with bodies that move, written as MJCF."""

from pathlib import Path

SIZE = 50.0  # of the workspace around the origin [m]


def body(name: str, geom: str, pos: str = "0 0 0.1", *, more: str = "") -> str:
    """A mocap body of one geom, named alike."""
    return f'<body name="{name}" mocap="true" pos="{pos}" {more}><geom name="{name}" {geom}/></body>'


def rows(name: str, data: str, *, repeat: bool = False) -> str:
    """A motion."""
    text = f'<text name="pirrht_motion_{name}" data="repeat"/>' if repeat else ""
    return f'<numeric name="pirrht_motion_{name}" data="{data}"/>{text}'


def moving_scene(folder: Path, world: str, custom: str, *, start: str = "0 0 0", name: str = "moving.xml") -> Path:
    """A scene file with a goal far from the start."""
    path = folder / name
    path.write_text(
        f"""<mujoco><compiler angle="degree"/><option timestep="0.002"/><custom>{custom}</custom><worldbody>
        <site name="start" pos="{start}"/>
        <site name="workspace" type="box" size="{SIZE} {SIZE} 1" rgba="0 0 0 0"/>
        <site name="goal" type="cylinder" pos="{0.9 * SIZE} 0 0" size="0.1 0.01"/>{world}</worldbody></mujoco>"""
    )
    return path
