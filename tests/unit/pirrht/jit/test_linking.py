"""What Python calls and what kernels call; code of several processes in one; what is used of numba's own."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from repository import environment

from pirrht.jit import linking
from pirrht.jit.jit import DISABLED, inlined, jitable, kernel

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


def test_a_third_process_does_not_mistake_code_of_two_that_compiled_alike(tmp_path):
    script = tmp_path / "times.py"
    script.write_text(TIMES)

    def said(*factors: str) -> list[str]:
        known = environment() | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        command = [sys.executable, str(script), *factors]
        return subprocess.run(command, env=known, capture_output=True, text=True, check=True).stdout.splitlines()

    assert [said("2"), said("3")] == [["6"], ["9"]]
    assert said("2", "3") == ["6", "9"]


@jitable
def _squared(x):
    return x * x


@inlined
def _sum(x, y):
    return _squared(x) + y


def test_a_function_is_called_alike_from_python_and_from_kernels():
    @kernel
    def whole(row):
        out = np.empty(row.shape[0])
        for i in range(row.shape[0]):
            out[i] = _sum(row[i], 2)
        return out

    np.testing.assert_array_equal(whole(np.arange(3.0)), [2.0, 3.0, 6.0])
    assert (_squared(3.0), _sum(3.0, 1.0)) == (9.0, 10.0)


@pytest.fixture
def nothing_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels are compiled, whatever lies on disk."""
    monkeypatch.setattr(linking.cache, "key_of", lambda *_: None)


@pytest.mark.usefixtures("nothing_kept")
def test_a_kernel_is_compiled_once_for_every_short_whole_number_and_literal():
    @kernel
    def next_of(i):
        return i + 1

    @kernel
    def asking(row):
        return next_of(row[0]) + next_of(5) + next_of(row.shape[0])

    assert asking(np.array([3], np.int32)) == 12
    assert len(next_of.part.overloads) == 1


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
    done = subprocess.run([sys.executable, "-c", PUBLIC], env=environment(), capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["26.0", "9.0", "12.0"]
    assert "compiled anew by every command" in done.stderr
