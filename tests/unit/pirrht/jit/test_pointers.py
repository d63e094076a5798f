"""Kernels that call others by address."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from repository import environment

from pirrht.jit.jit import DISABLED, address_of, as_tuple, caller, jitable, kernel

HALVES = """
import numpy as np
from numba.core import event
from pirrht.jit.jit import kernel
from pirrht.jit.jit import address_of, caller

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
def _doubled(row, count):
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
        assert _calling(address_of(_doubled, (ROW, 1)), ROW, 4) == 2.0 * 3.0 * 4 + 5.0
        assert _calling(address_of(_counted, (ROW, 1)), ROW, 4) == 0 + 1 + 2 + 3 + 4 * 3.0 + 3.0


@pytest.mark.skipif(DISABLED, reason="nothing is compiled")
def test_machine_code_from_disk_is_called_by_address(tmp_path):
    script = tmp_path / "halves.py"
    script.write_text(HALVES)
    command, known = [sys.executable, str(script)], environment() | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    first, second = (subprocess.run(command, env=known, capture_output=True, text=True, check=True) for _ in range(2))
    assert (first.stdout.split()[0], second.stdout.split()) == ("[1.5]", ["[1.5]", "0"])
    assert int(first.stdout.split()[1]) > 0
