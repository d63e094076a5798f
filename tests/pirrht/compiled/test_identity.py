"""Functions that compute the same have one name in all processes, and others have another or none."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from repository import environment

from pirrht.compiled.identity import identity
from pirrht.compiled.jit import as_jitable, kernel

SYSTEM = """
import math
import numpy as np
SPEED = 1.5
TABLE = np.array([1.0, 2.0])
def helper(x): return SPEED * x
def drift(x, p, out): out[0] = math.cos(x[0]) * helper(1.0) + np.abs(TABLE[0])
"""


def made(source: str) -> str | None:
    """The name of `drift` in a module of some source."""
    scope: dict[str, object] = {"__name__": "users"}
    exec(source, scope)
    return identity(scope["drift"])  # type: ignore[arg-type]


def test_where_a_function_stands_does_not_matter():
    assert made(SYSTEM) is not None
    assert made(SYSTEM) == made("\n\n# a comment\n" + SYSTEM)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("1.5", "1.6"),
        ("[1.0, 2.0]", "[1.0, 2.5]"),
        ("SPEED * x", "SPEED + x"),
        ("math.cos", "math.sin"),
        ("out[0]", "out[1]"),
    ],
)
def test_whatever_a_function_reads_is_part_of_its_name(before: str, after: str):
    assert made(SYSTEM) != made(SYSTEM.replace(before, after))


@pytest.mark.parametrize("value", ["object()", "[1.0]", "__import__('os')"])
def test_what_could_change_unseen_leaves_it_without_a_name(value: str):
    assert made(SYSTEM.replace("SPEED = 1.5", f"SPEED = {value}")) is None


def test_a_kernel_around_a_nameless_function_has_no_name_either():
    hidden = [1.0]

    def nameless(x: float) -> float:
        return x + len(hidden)

    inner = as_jitable(nameless)

    def outer(x: float) -> float:
        return float(inner(x))

    assert identity(nameless) is None
    assert identity(outer) is None


def test_a_function_that_calls_itself_does_not_hang():
    def around(x: float) -> float:
        return around(x - 1.0) if x > 0.0 else x

    assert identity(around) is None
    np.testing.assert_equal(kernel(lambda x: 2.0 * x)(1.5), 3.0)


PROGRAM = """
import sys
from typing import NamedTuple
import numpy as np
from numba.core import event
from pirrht.compiled.jit import as_jitable
from pirrht.guidance.step_map import step_of
from pirrht.rollouts.general.kind import Kind
GAIN = float(sys.argv[1])
made = []
class Heard(event.Listener):
    def on_start(self, happening): made.append(happening.data["dispatcher"].py_func.__name__)
    def on_end(self, happening): pass
class Setup(NamedTuple):
    parameters: np.ndarray
    rate: float
def drift(x, p, out): out[0] = GAIN * x[0]
kind = Kind(as_jitable(drift), None, None, as_jitable(drift), n=1, m=1, varying_rate=False, noisy_position=False)
event.register("numba:compile", Heard())
out = np.zeros(1)
step_of(kind)[0](Setup(np.zeros(0), 1.0), np.array([2.0]), out)
print(out[0], "velocity" in made)
"""


@pytest.mark.slow
def test_a_kernel_of_somebodys_function_is_found_by_the_next_process_until_that_changes(tmp_path):
    (tmp_path / "users.py").write_text(PROGRAM)

    def told(gain: str) -> list[str]:
        command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import users", gain]
        more = {"NUMBA_CACHE_DIR": str(tmp_path)}
        return subprocess.run(
            command, env=environment() | more, capture_output=True, text=True, check=True
        ).stdout.split()

    assert told("3") == ["6.0", "True"]
    assert told("3") == ["6.0", "False"]
    assert told("4") == ["8.0", "True"]
    assert told("3") == ["6.0", "False"]
