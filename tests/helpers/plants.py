"""One robot in an empty field, in MuJoCo and by its equation alone."""

from pathlib import Path

import numpy as np

from pirrht import Dynamics, Problem
from sim.drive.executor import Advance, Executor, Plant
from sim.mjcf import Loaded

QUIET = 1e-12  # a noise level that is as good as none
STEP = 0.002
SIZE = 1e4  # of the workspace [m]
WALL = '<geom name="wall" type="box" size="0.05 3 0.3" pos="0.65 0 0.3"/>'  # face at 0.6


def scene_file(
    folder: Path, *, world: str = "", option: str = "", start: str = "0 0 0", goal: str = "9000 0 0", size: float = SIZE
) -> Path:
    path = folder / "field.xml"
    path.write_text(
        f"""<mujoco>{option}<worldbody><site name="start" pos="{start}"/>
        <site name="workspace" type="box" size="{size} {size} 1"/>
        <site name="goal" type="cylinder" pos="{goal}" size="0.1 0.01"/>{world}</worldbody></mujoco>"""
    )
    return path


def moving_scene(folder: Path, world: str, custom: str, *, start: str = "0 0 0") -> Path:
    """A scene with bodies that move."""
    option = f'<compiler angle="degree"/><option timestep="0.002"/><custom>{custom}</custom>'
    return scene_file(folder, world=world, option=option, start=start, goal="45 0 0", size=50.0)


def body(name: str, geom: str, pos: str = "0 0 0.1", *, more: str = "") -> str:
    """A mocap body of one geom, named alike."""
    return f'<body name="{name}" mocap="true" pos="{pos}" {more}><geom name="{name}" {geom}/></body>'


def flown_over(
    folder: Path, geom: str, poses: str, *, repeat: bool = False, start: str = "0 0 0", more: str = ""
) -> Path:
    """A scene in space with body "b" of one geom on rows of poses, in which it stands at the first."""
    row = poses.split()[:8]
    pose = f'pos="{" ".join(row[1:4])}" quat="{" ".join(row[4:])}"'
    text = '<text name="pirrht_poses_b" data="repeat"/>' * repeat
    path = folder / "air.xml"
    path.write_text(
        f"""<mujoco><option timestep="0.002"/><custom><text name="pirrht_robot" data="ball"/>{text}
        <numeric name="pirrht_poses_b" data="{poses}"/>{more}</custom><worldbody>
        <site name="workspace" type="box" size="50 50 50"/><site name="start" pos="{start}"/>
        <site name="goal" type="sphere" pos="45 0 0" size="0.1"/>
        <body name="b" mocap="true" {pose}><geom name="b" {geom}/></body></worldbody></mujoco>"""
    )
    return path


def rows(name: str, data: str, *, repeat: bool = False) -> str:
    """A motion."""
    text = f'<text name="pirrht_motion_{name}" data="repeat"/>' if repeat else ""
    return f'<numeric name="pirrht_motion_{name}" data="{data}"/>{text}'


def problem_of(loaded: Loaded, dynamics: Dynamics, **options) -> Problem:
    return Problem(dynamics=dynamics, scene=loaded.scene, **{"R": 2.0 * np.eye(dynamics.m), **options})


def both(loaded: Loaded, problem: Problem, period: float) -> tuple[Executor, Plant]:
    """Both plants of a problem."""
    return Executor(loaded, problem, period=period), Plant(
        problem, period=period, physics_step=float(loaded.model.opt.timestep)
    )


def ahead(x: np.ndarray) -> np.ndarray:
    """Through the slit at unit speed, with a pull to its middle."""
    return np.array([1.0, 4.0 * (2.5 - x[1])])


def hold(*control: float):
    """A control that stays."""
    return lambda x, s: np.array(control)


def driven(plant: Plant, control, seed: int, periods: int) -> list[Advance]:
    rng = np.random.default_rng(seed)
    return [plant.advance(control, rng) for _ in range(periods)]


def states_of(advances: list[Advance]) -> np.ndarray:
    return np.concatenate([advance.states for advance in advances])
