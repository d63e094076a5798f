"""PI-RRHT*: topology-guided path integral control (Ha and Choi, ICRA 2016).

A package per idea, each of which says its purpose; imports run downward only, so read from the bottom up:

    arrays errors formatting outcome | files jit < geometry < topology < freespace < systems < problem
    steering < shortening < planner | rollouts < proposals < estimation
    control
    moving < exact

The tree knows nothing of noise, the path integral nothing of topology; `control` is where they meet (Algorithm 4).
Names are imported when they are first used, so that importing the package is quick. At the prompt objects show
themselves in a line, trees and plans as pictures: `tree.plot(x)`, `plan.plot()` (extra `pirrht[figures]`).

Examples:
    >>> import pirrht
    >>> pirrht.Sampling(samples=500)
    Sampling(samples=500)
    >>> pirrht.Outcome.GOAL
    Outcome.GOAL
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "Controller": "control.controller",
    "Desirability": "exact.desirability",
    "Dubins": "steering.dubins",
    "Dynamics": "systems.dynamics",
    "Estimate": "estimation.estimate",
    "FreeSpace": "freespace",
    "Goal": "geometry.scene",
    "Homology": "topology.homology",
    "HomologyTree": "planner.tree",
    "Kind": "geometry.scene",
    "Mppi": "control.baselines",
    "NoReference": "errors",
    "NoSurvivingSample": "errors",
    "NotLinearlySolvable": "errors",
    "Obstacle": "geometry.scene",
    "Optimal": "exact.desirability",
    "OptionError": "errors",
    "Outcome": "outcome",
    "PathIntegral": "estimation.sampler",
    "PirrhtError": "errors",
    "Plan": "control.plan",
    "Problem": "problem",
    "Reference": "planner.references",
    "Sampling": "estimation.sampling",
    "Scene": "geometry.scene",
    "SceneError": "errors",
    "SingleIntegrator": "systems.single_integrator",
    "Steering": "steering.steering",
    "StraightLine": "steering.straight_line",
    "Trajectory": "steering.motion",
    "Unicycle": "systems.unicycle",
    "path_integral": "estimation.assembly",
}

__all__ = [*_HOME]
__version__ = "0.31.1"


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'pirrht' has no attribute {name!r}")
    return getattr(import_module(f"pirrht.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*_HOME, "__version__"])
