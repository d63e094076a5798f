"""Small SDF worlds, the task they are imported with, and how imports are refused."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from mjcf_samples import refusal

from sim.importing.scene_file import Imported, import_world
from sim.mjcf import load

TASK = {"start": (0, 0), "goal": (8, 0, 0.5), "workspace": (-1, 9, -5, 5)}
BALL = "<geometry><sphere><radius>0.4</radius></sphere></geometry>"
PLANE = "<geometry><plane><normal>0 0 1</normal><size>{size}</size></plane></geometry>"


def collision(geometry: str, *, name: str = "c", pose: str = "") -> str:
    return f'<collision name="{name}">{pose}{geometry}</collision>'


def model(inner: str, *, name: str = "m", static: str = "<static>1</static>") -> str:
    return f'<model name="{name}">{static}{inner}</model>'


def link(inner: str, *, name: str = "l") -> str:
    return f'<link name="{name}">{inner}</link>'


def ball(pose: str, *, name: str = "m") -> str:
    return model(pose + link(collision(BALL)), name=name)


def sdf(world: str) -> str:
    return f'<?xml version="1.0"?><sdf version="1.7"><world name="w">{world}</world></sdf>'


def imported(folder: Path, text: str | bytes, **task) -> Imported:
    """A world file in a folder, imported as maze.xml in it."""
    source = folder / "maze.world"
    source.write_bytes(text if isinstance(text, bytes) else text.encode())
    return import_world(source, folder / "maze.xml", **(TASK | task))


def places(found: Imported) -> dict[str, np.ndarray]:
    """Poses (3, 4) of all geoms that were taken over, by name."""
    loaded = load(found.path)
    data = mujoco.MjData(loaded.model)
    mujoco.mj_kinematics(loaded.model, data)
    turns, geoms = data.geom_xmat.reshape(-1, 3, 3), np.flatnonzero(~loaded.robot_geoms)
    poses = {loaded.model.geom(g).name: np.column_stack([turns[g], data.geom_xpos[g]]) for g in geoms}
    return {name: pose for name, pose in poses.items() if name != "floor"}


def refused(work: Callable[[], object], *words: str) -> None:
    """Assert that work is refused in one short line that has some words."""
    message = refusal(by=work)
    assert len(message) < 1000
    for word in words:
        assert word in message, message
