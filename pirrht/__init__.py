"""PI-RRHT*: topology-guided path integral control (Ha and Choi, ICRA 2016).

A package per idea, each of which says its purpose; imports run downward only, so read from the bottom up:

    arrays errors formatting outcome | jit < geometry < topology moving < freespace < plotting < systems < problem
    traits
    steering < planner | rollouts < proposals < estimation
    control
    exact

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

from importlib import import_module
from typing import Any

_NAMES = {
    "control.baselines": "Mppi", "control.controller": "Controller", "control.plan": "Plan",
    "errors": "NoReference NoSurvivingSample NotLinearlySolvable OptionError PirrhtError SceneError",
    "estimation.assembly": "path_integral", "estimation.estimate": "Estimate",
    "estimation.risk": "CollisionProbability collision_probability", "estimation.sampler": "PathIntegral",
    "estimation.sampling": "Sampling", "exact.desirability": "Desirability Optimal", "freespace": "FreeSpace",
    "geometry.footprint": "Footprint",
    "geometry.scene": "Goal Kind Obstacle Scene", "outcome": "Outcome", "planner.references": "Reference",
    "planner.limits": "grown_tree",
    "planner.tree": "HomologyTree", "problem": "Problem", "steering.dubins": "Dubins", "steering.motion": "Trajectory",
    "steering.pieces": "SpaceLine TrackedInSpace", "systems.ball": "Ball", "systems.drone": "Drone",
    "steering.double_integrator": "MassSteering", "steering.turn_and_go": "TurnAndGo", "systems.rover": "Rover",
    "systems.double_integrator": "DoubleIntegrator", "systems.second_order_car": "SecondOrderCar",
    "steering.steering": "Steering", "steering.straight_line": "StraightLine Tracked", "systems.dynamics": "Dynamics",
    "systems.single_integrator": "SingleIntegrator", "systems.unicycle": "Unicycle", "topology.homology": "Homology",
}  # fmt: skip
_HOME = {name: module for module, names in sorted(_NAMES.items()) for name in names.split()}

__all__ = [*_HOME]
__version__ = "0.33.13"


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'pirrht' has no attribute {name!r}")
    return getattr(import_module(f"pirrht.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*_HOME, "__version__"])
