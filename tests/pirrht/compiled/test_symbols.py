"""Machine code of several processes in one: each function keeps its own."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from repository import environment

from pirrht.compiled.jit import DISABLED

TIMES = """
import math
import sys
from pirrht.compiled.jit import kernel

def times(factor):
    @kernel
    def product(x):  # too long to be inlined
LINES        return factor * x

    @kernel
    def twice(x):
        return product(x) + product(2.0 * x)
    return twice

def loaded(factor):
    made = times(factor)
    value = made(1.0)
    return round(value), sum(made.stats.cache_hits.values())

if __name__ == "__main__":
    for factor in sys.argv[1:]:
        print(*loaded(float(factor)))
""".replace("LINES", "        x += math.sin(x) ** 2 + math.cos(x) ** 2 - 1.0\n" * 100)
FORKED = """
import os
from pirrht.compiled import jit
from numba.core.bytecode import FunctionIdentity
child = os.fork()
if child:
    os.waitpid(child, 0)
print(next(FunctionIdentity._unique_ids), flush=True)
"""


@pytest.mark.skipif(DISABLED, reason="nothing is compiled")
def test_what_two_processes_compiled_alike_a_third_does_not_mistake_for_each_other(tmp_path):
    script = tmp_path / "times.py"
    script.write_text(TIMES)

    def said(*factors: str) -> list[str]:
        known = environment() | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        command = [sys.executable, str(script), *factors]
        return subprocess.run(command, env=known, capture_output=True, text=True, check=True).stdout.splitlines()

    assert [said("2"), said("3")] == [["6 0"], ["9 0"]]
    assert said("2", "3") == ["6 1", "9 1"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_child_counts_otherwise_than_its_parent():
    done = subprocess.run([sys.executable, "-c", FORKED], env=environment(), capture_output=True, text=True, check=True)
    childs, mine = map(int, done.stdout.split())
    assert abs(mine - childs) > 1000  # both alike with a chance of one in 10^11
