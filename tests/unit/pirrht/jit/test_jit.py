"""Compiled kernels give the answers of plain Python, and parts of them hand on no arrays."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from numba import njit
from repository import environment

from pirrht.jit.jit import DISABLED, as_jitable, kernel, part

STRIP = """
import numpy as np
from pirrht import *
import sys
disc = Obstacle(name="disc", kind=Kind.CYLINDER, size=np.array([0.4, 0.3, 0.0]), position=np.array([2.0, 1.5, 0.2]),
                rotation=np.eye(3))
scene = Scene(name="strip", lower=np.zeros(2), upper=np.array([4.0, 3.0]), obstacles=(disc,), robot_radius=0.2,
              goal=Goal(center=np.array([3.4, 1.5]), radius=0.3), start=np.array([0.6, 1.5, 0.0]))
space = FreeSpace.of(scene)
if sys.argv[1] == "point":
    problem = Problem(dynamics=SingleIntegrator(b=0.3), scene=scene, R=2 * np.eye(2))
    steering = StraightLine.of(problem)
else:
    problem = Problem(dynamics=Unicycle(b=0.3, rho=0.4), scene=scene, R=np.eye(1), phi=100.0)
    steering = Dubins.of(problem)
tree = HomologyTree(space, steering, rng=np.random.default_rng(0), limit=0.9)
tree.grow(40)
controller = Controller(problem, space, tree, Sampling(samples=4, threads=1), rng=np.random.default_rng(1))
plan = controller.plan(scene.start[: problem.dynamics.n])
print(*plan.ids, *plan.control, plan.estimate.value)
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["point", "car"])
def test_a_plan_and_a_control_step_without_compiling_are_those_of_the_kernels(kind):
    def words(disabled: str) -> list[str]:
        command = [sys.executable, "-c", STRIP, kind]
        return subprocess.run(
            command, env=environment() | {"NUMBA_DISABLE_JIT": disabled}, capture_output=True, text=True, check=True
        ).stdout.split()

    plain, compiled = words("1"), words("0")
    assert plain[:2] == compiled[:2]
    np.testing.assert_allclose(np.array(plain[2:], float), np.array(compiled[2:], float), rtol=1e-5)


@pytest.mark.skipif(DISABLED, reason="nothing is compiled")
def test_a_part_of_a_kernel_hands_on_no_array_that_it_borrowed():
    """Its caller would let go of what it never held, and the memory be given away under its owner."""
    row = np.arange(3.0)
    assert part(_second)(row) == 1.0
    with pytest.raises(TypeError, match=r"_both is part of a kernel and returns an array; write into one"):
        part(_both)(row)


@pytest.mark.parametrize("made", [kernel, as_jitable, lambda function: as_jitable(njit(function))])
def test_what_a_part_asks_may_make_arrays(made):
    asked = made(_doubled)

    @part
    def asking(row):
        out = row[:2]
        asked(row, out)
        return out[0]

    @kernel
    def whole(row):
        return asking(row)

    assert whole(np.arange(1.0, 4.0)) == 12.0


def _doubled(row, out):
    more = np.zeros(3)
    more[:] = row * 2.0
    out[0] = np.sum(more)


def _second(row):
    return row[1]


def _both(row):
    return 1.0, row
