"""One robot in an empty field, in MuJoCo and by its equation alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pirrht.arrays import Array
from pirrht.problem import Problem
from sim.drive.executor import Executor
from sim.drive.plant import Advance, Analytic
from sim.mjcf import Loaded, load

QUIET = 1e-12  # a noise level that is as good as none
STEP = 0.002
SIZE = 1e4  # of the workspace [m]


def scene_file(folder: Path, *, world: str = "", option: str = "", goal: str = "9000 0 0") -> Path:
    path = folder / "field.xml"
    path.write_text(
        f"""<mujoco>{option}<worldbody><site name="start" pos="0 0 0"/>
        <site name="workspace" type="box" size="{SIZE} {SIZE} 1"/>
        <site name="goal" type="cylinder" pos="{goal}" size="0.1 0.01"/>{world}</worldbody></mujoco>"""
    )
    return path


def free(points: Array) -> Array:
    return np.ones(len(points))


def plants(
    path: Path, robot: str, problem_of: Callable[[Loaded, float], Problem], b: float, steps: int
) -> tuple[Executor, Analytic]:
    """Both plants of a robot under noise b, with a period of so many physics steps."""
    loaded = load(path, robot=robot)
    problem, h = problem_of(loaded, b), float(loaded.model.opt.timestep)
    analytic = Analytic(problem, free, period=steps * h, physics_step=h)
    return Executor(loaded, problem, period=steps * h), analytic


def driven(plant: Executor | Analytic, control, seed: int, periods: int) -> list[Advance]:
    rng = np.random.default_rng(seed)
    return [plant.advance(control, rng) for _ in range(periods)]
