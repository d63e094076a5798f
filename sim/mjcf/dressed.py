"""How a scene looks that says nothing of its looks: by light, and in the colours of those that are built in.

What a file does say stays. The site `workspace` bounds the plan and is no thing: it is never drawn.
"""

from __future__ import annotations

import mujoco
import numpy as np

from pirrht.arrays import Array
from sim.mjcf.obstacles import MOTION

SITES = {"start": (0.20, 0.45, 0.75, 0.8), "goal": (0.25, 0.65, 0.35, 0.7)}
FLOOR, WALL, MOVING = (0.83, 0.845, 0.86, 1.0), (0.27, 0.33, 0.42, 1.0), (0.50, 0.36, 0.62, 1.0)
PLAIN = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's colour of what has none
DARK = (0.1, 0.4, 0.5)  # its light at the eye: ambient, diffuse, specular; alone it leaves walls black
LIGHT = (0.42, 0.42, 0.0)


def dress(model: mujoco.MjModel) -> None:
    """Give a model looks where it has none."""
    for site, name in ((i, model.site(i).name) for i in range(model.nsite)):
        if name == "workspace":
            model.site_rgba[site, 3], model.site_matid[site] = 0.0, -1
        elif name in SITES and model.site_matid[site] < 0 and _plain(model.site_rgba[site]):
            model.site_rgba[site] = SITES[name]
    bare, flat = (model.geom_matid < 0) & _plain(model.geom_rgba), model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    motions = [name for i in range(model.nnumeric) if (name := model.numeric(i).name).startswith(MOTION)]
    moving = np.isin(model.body_rootid[model.geom_bodyid], [model.body(one.removeprefix(MOTION)).id for one in motions])
    model.geom_rgba[bare] = np.select([flat[bare, None], moving[bare, None]], [FLOOR, MOVING], WALL)
    head = model.vis.headlight
    if model.nlight == 0 and np.allclose([head.ambient[0], head.diffuse[0], head.specular[0]], DARK):
        head.ambient[:], head.diffuse[:], head.specular[:] = LIGHT


def has_sky(model: mujoco.MjModel) -> bool:
    """Whether there is something behind everything."""
    return bool(np.any(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX))


def _plain(rgba: Array) -> Array:
    """Whether colours (..., 4) are the ones that nobody chose."""
    return np.asarray(np.all(np.isclose(rgba, PLAIN), axis=-1))
