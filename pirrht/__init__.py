"""PI-RRHT*: topology-guided path integral control (Ha and Choi, ICRA 2016).

Read from the bottom up: scene, dynamics, problem; collision, components, freespace; homology, steering, tree;
path_integral; controller. Names are imported when they are first used, so that importing the package is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "Controller": "controller",
    "Desirability": "desirability",
    "Dubins": "dubins",
    "Dynamics": "dynamics",
    "Estimate": "estimate",
    "FreeSpace": "freespace",
    "Goal": "scene",
    "Homology": "homology",
    "HomologyTree": "tree",
    "Kind": "scene",
    "Mppi": "mppi",
    "NoReference": "errors",
    "NoSurvivingSample": "errors",
    "NotLinearlySolvable": "errors",
    "Obstacle": "scene",
    "Optimal": "optimal",
    "OptionError": "errors",
    "Outcome": "outcome",
    "PathIntegral": "path_integral",
    "PirrhtError": "errors",
    "Plan": "plan",
    "Problem": "problem",
    "Reference": "tree",
    "Sampling": "sampling",
    "Scene": "scene",
    "SceneError": "errors",
    "SingleIntegrator": "dynamics",
    "Steering": "steering",
    "StraightLine": "steering",
    "Trajectory": "steering",
    "Unicycle": "dynamics",
}

__all__ = [*_HOME]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'pirrht' has no attribute {name!r}")
    return getattr(import_module(f"pirrht.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*_HOME, "__version__"])
