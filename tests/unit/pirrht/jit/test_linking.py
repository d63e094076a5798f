"""What Python calls and what kernels call, by name and by address; code of several processes; parts of kernels."""

import subprocess
import sys

import numpy as np
import pytest
from numba import njit
from numba.core import event
from repository import environment

from pirrht.jit import linking
from pirrht.jit.jit import DISABLED, address_of, as_jitable, as_tuple, caller, jitable, kernel, part

pytestmark = pytest.mark.skipif(DISABLED, reason="nothing is compiled")

TIMES = """
import math
import sys
from pirrht.jit.jit import kernel

def times(factor):
    @kernel
    def product(x):  # too long to be inlined
LINES        return factor * x

    @kernel
    def twice(x):
        return product(x) + product(2.0 * x)
    return twice

if __name__ == "__main__":
    for factor in sys.argv[1:]:
        print(round(times(float(factor))(1.0)))
""".replace("LINES", "        x += math.sin(x) ** 2 + math.cos(x) ** 2 - 1.0\n" * 100)


def ran(*words: object, **known: object) -> subprocess.CompletedProcess[str]:
    """Python with some words and variables of its environment."""
    env = environment() | {name: str(value) for name, value in known.items()}
    return subprocess.run([sys.executable, *map(str, words)], env=env, capture_output=True, text=True, check=True)


@pytest.mark.slow
def test_a_third_process_does_not_mistake_code_of_two_that_compiled_alike(tmp_path):
    script = tmp_path / "times.py"
    script.write_text(TIMES)
    rows = [ran(script, *factors, NUMBA_CACHE_DIR=tmp_path / "cache").stdout.split() for factors in ("2", "3", "23")]
    assert rows == [["6"], ["9"], ["6", "9"]]


def test_a_kernel_is_compiled_once_for_every_short_whole_number_and_literal(monkeypatch):
    monkeypatch.setattr(linking.cache, "key_of", lambda *_: None)  # compiled, whatever lies on disk

    @kernel
    def next_of(i):
        return i + 1

    @kernel
    def asking(row):
        return next_of(row[0]) + next_of(5) + next_of(row.shape[0])

    with event.install_recorder("numba:compile") as compiled:
        assert asking(np.array([3], np.int32)) == 12
    begun = [one.data["dispatcher"].py_func.__name__ for _, one in compiled.buffer if one.is_start]
    assert begun.count("next_of") == 1


PUBLIC = """
import sys
sys.modules["pirrht.jit.linking"] = None  # as if it failed to import
import numpy as np
from pirrht.jit.jit import address_of, caller, inlined, jitable, kernel, part
from pirrht.jit.vectors import axpy, copy_row

@jitable
def squared(x):
    return x * x

@inlined
def more(x):
    return squared(x) + 1.0

@part
def first(row):
    return more(row[0])

call, add = caller(1.0), axpy(2)

@kernel
def whole(address, row, out):
    copy_row(row, out)
    add(out.ctypes.data, row.ctypes.data, 2.0, row.ctypes.data, 1.0)
    return first(row) + call(address, (row,))

def last(row):
    return squared(row[1])

row, out = np.array([3.0, 4.0]), np.zeros(2)
print(whole(address_of(last, (row,)), row, out), *out)
"""


def test_without_the_private_interface_kernels_are_compiled_with_the_public_one():
    done = ran("-c", PUBLIC)
    assert done.stdout.split() == ["26.0", "9.0", "12.0"]
    assert "compiled anew by every command" in done.stderr


HALVES = """
import numpy as np
from numba.core import event
from pirrht.jit.jit import address_of, caller, kernel

call = caller(np.empty(0))

def half(row):
    return 0.5 * row

@kernel
def calling(address, row):
    return call(address, (row,))

with event.install_recorder("numba:compile") as compiled:
    row = np.array([3.0])
    print(calling(address_of(half, (row,)), row), len(compiled.buffer))
"""


@jitable
def _twice_first(row, count):
    a, b = as_tuple(row, 2)
    return np.full(count, 2.0 * a), b


@jitable
def _counted(row, count):
    return np.arange(count) + row[0], float(row.shape[0])


_call = caller((np.empty(0), 0.0))


@kernel
def _calling(address, row, count):
    numbers, rest = _call(address, (row, count))
    return numbers.sum() + rest


ROW = np.array([3.0, 5.0, 7.0])


def test_a_kernel_calls_different_functions_by_address_and_owns_the_arrays_that_they_return():
    for _ in range(1000):  # a wrong count of references would end the process or grow its memory
        assert _calling(address_of(_twice_first, (ROW, 1)), ROW, 4) == 2.0 * 3.0 * 4 + 5.0
        assert _calling(address_of(_counted, (ROW, 1)), ROW, 4) == 0 + 1 + 2 + 3 + 4 * 3.0 + 3.0


def test_machine_code_from_disk_is_called_by_address(tmp_path):
    script = tmp_path / "halves.py"
    script.write_text(HALVES)
    first, second = (ran(script, NUMBA_CACHE_DIR=tmp_path / "cache").stdout.split() for _ in range(2))
    assert (first[0], second) == ("[1.5]", ["[1.5]", "0"])
    assert int(first[1]) > 0


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
    plain, compiled = (ran("-c", STRIP, kind, NUMBA_DISABLE_JIT=disabled).stdout.split() for disabled in (1, 0))
    assert plain[:2] == compiled[:2]
    np.testing.assert_allclose(np.array(plain[2:], float), np.array(compiled[2:], float), rtol=1e-5)


def test_a_part_of_a_kernel_hands_on_no_array_that_it_borrowed():
    """Its caller would let go of what it never held, and the memory be given away under its owner."""
    row = np.arange(3.0)
    assert part(lambda row: row[1])(row) == 1.0
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


def _both(row):
    return 1.0, row
