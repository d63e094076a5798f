"""Compiling on the second core: after installation the sampler's kernels are built while the planner's are.

`python -m sim.cli.warm DYNAMICS` builds the kernels of one kind of dynamics and leaves them in the cache on disk.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from pirrht.compiled.jit import cached
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.rollouts.point.block import is_point
from sim.systems import BUILT_IN, named

# Modules of kernels that take long, by which one knows whether they have been compiled.
PLANNER, POINT, OTHERS = "extend", "block", "loops"


def announce(dynamics_name: str, *, sampling: bool) -> None:
    """Tell a person at a terminal why the first command of an installation is slow."""
    ready = cached(PLANNER) and (not sampling or cached(sampler(dynamics_name)))
    if sys.stderr.isatty() and not ready:
        print("compiling kernels, once: about a minute", file=sys.stderr)


def sampler(dynamics_name: str) -> str:
    """The module of kernels that samples a system."""
    system = named(dynamics_name)
    return POINT if is_point(system.dynamics(system.settings)) else OTHERS


def start(dynamics_name: str) -> subprocess.Popen[bytes] | None:
    """Begin to compile in another process, if there is anything to compile; wait for it before sampling."""
    if dynamics_name not in BUILT_IN or cached(sampler(dynamics_name)):
        return None
    command = [sys.executable, "-m", "sim.cli.warm", dynamics_name]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def compile_sampler(dynamics_name: str) -> None:
    """Compile what drives of one kind of dynamics need for sampling."""
    scene = Scene(
        name="warm",
        lower=np.zeros(2),
        upper=np.full(2, 4.0),
        obstacles=(),
        goal=Goal(center=np.array([3.0, 2.0]), radius=0.3),
        start=np.array([1.0, 2.0, 0.0]),
        robot_radius=0.2,
    )
    system = named(dynamics_name)
    PathIntegral(system.problem(scene, system.settings), FreeSpace.of(scene), Sampling()).warm_up()


if __name__ == "__main__":
    compile_sampler(sys.argv[1])
