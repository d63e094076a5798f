"""MJCF of random scenes in which bodies move, by the conventions of `sim.mjcf`."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from sim.scenario import Scenario, prepare

REACH = 0.3  # radius of the goal's disc [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """A robot's radius [m], the sides of a workspace (2,), start and goal, (2,) each [m], and what stands and moves."""

    name: str
    radius: float
    sides: Array
    start: Array
    goal: Array
    standing: Sequence[str]  # geoms
    movers: Sequence[tuple[str, str]]  # of `mover`

    def text(self) -> str:
        """The model."""
        half = f"{self.sides[0] / 2:g} {self.sides[1] / 2:g} 0.5"
        return f"""<mujoco model="{self.name}">
  <custom>
    <numeric name="pirrht_radius" data="{self.radius}"/>
{chr(10).join(motion for _, motion in self.movers)}
  </custom>
  <worldbody>
{chr(10).join([*self.standing, *(body for body, _ in self.movers)])}
    <site name="workspace" type="box" pos="{half}" size="{half}"/>
    <site name="start" pos="{self.start[0]:.6f} {self.start[1]:.6f} 0"/>
    <site name="goal" type="cylinder" pos="{self.goal[0]:.6f} {self.goal[1]:.6f} 0" size="{REACH} 0.01"/>
  </worldbody>
</mujoco>
"""


def mover(name: str, shape: str, rows: Array, repeat: bool = False) -> tuple[str, str]:
    """A body of one geom, its type and size, and its motion, rows (k, 4) of t [s], x, y [m] and yaw [rad]."""
    x, y, yaw = rows[0, 1:]
    data = "  ".join(" ".join(f"{v:.6f}" for v in row) for row in rows)
    again = f'<text name="pirrht_motion_{name}" data="repeat"/>' if repeat else ""
    pose = f'pos="{x:.6f} {y:.6f} 0.3" euler="0 0 {np.degrees(yaw):.6f}"'
    body = f'    <body name="{name}" mocap="true" {pose}><geom name="{name}" {shape}/></body>'
    return body, f'    <numeric name="pirrht_motion_{name}" data="{data}"/>{again}'


def prepared(name: str, text: str, **task: Any) -> Scenario:
    """A model ready to be planned in, by what `prepare` takes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.xml"
        path.write_text(text)
        return prepare(path, **task)
