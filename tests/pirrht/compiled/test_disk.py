"""Compiled kernels on disk: found again, and made anew with one line where what lies there is not what was written."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from repository import environment
from thoroughly import first

from pirrht.compiled.disk import Files

SQUARES = """
from numba.core import event
from pirrht.compiled.streams import antithetic

compiled = []
class Listener(event.Listener):
    def on_start(self, happening):
        compiled.append(happening.data["dispatcher"].py_func.__name__)
    def on_end(self, happening):
        pass
event.register("numba:compile", Listener())
print(*antithetic(5, 2, True), *antithetic(6.0, 2, True), len(compiled))
"""


SAID = ["4", "-1.0", "6.0", "1.0"]


def asked(cache: Path) -> tuple[list[str], list[str]]:
    """What a kernel says of two kinds of numbers and how often one was compiled; what stands on standard error."""
    known = environment() | {"NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run([sys.executable, "-c", SQUARES], env=known, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split(), done.stderr.splitlines()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, bytes]:
    """A folder's files after a first process, by their path in it."""
    folder = tmp_path_factory.mktemp("cache")
    assert asked(folder)[0] == [*SAID, "2"]
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.nb?")}


def laid_out(files: dict[Path, bytes], folder: Path) -> None:
    for path, content in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)


@pytest.mark.slow
def test_a_second_process_finds_what_the_first_has_compiled(whole, tmp_path):
    laid_out(whole, tmp_path)
    assert asked(tmp_path) == ([*SAID, "0"], [])


WAITS = """
import os, sys, time
from pathlib import Path
import pirrht
folder = Path(sys.argv[1])
(folder / f"{os.getpid()}.ready").touch()
while not (folder / "go").exists():
    time.sleep(0.001)
"""


@pytest.mark.slow
def test_of_processes_that_want_a_kernel_at_once_one_compiles_it(tmp_path):
    known = environment() | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "-c", WAITS + SQUARES, str(tmp_path)]
    both = [subprocess.Popen(command, env=known, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    while len(list(tmp_path.glob("*.ready"))) < 2:
        assert all(process.poll() is None for process in both)
        time.sleep(0.01)
    (tmp_path / "go").touch()
    said = [process.communicate()[0].split() for process in both]
    assert [one[:4] for one in said] == [SAID, SAID]
    assert sum(int(one[4]) for one in said) == 2  # its two kinds of numbers


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"], ids=["index", "machine code"])
@pytest.mark.parametrize(
    "damage",
    first(
        [
            lambda content: content[:-100] + bytes([content[-100] ^ 1]) + content[-99:],
            lambda content: b"",
            lambda content: content[: len(content) // 2],
            lambda content: np.random.default_rng(0).bytes(len(content)),
            lambda content: b"\x80\x05X\xff\xff\xff\x7f",  # a pickle that asks for 2 GB
        ]
    ),
    ids=["a bit", "empty", "half", "noise", "greedy"],
)
def test_a_damaged_file_is_compiled_anew_with_one_line(whole, tmp_path, suffix, damage):
    laid_out({path: damage(whole[path]) if path.suffix == suffix else whole[path] for path in whole}, tmp_path)
    said, told = asked(tmp_path)
    assert said == [*SAID, "2"]
    assert len(told) == 1
    assert "damaged" in told[0]
    assert asked(tmp_path) == ([*SAID, "0"], [])  # and is whole again


@pytest.mark.slow
@pytest.mark.parametrize("cache", ["file/cache", "/proc/nowhere"])
def test_where_nothing_can_be_kept_kernels_work_and_one_line_says_so(tmp_path, cache):
    (tmp_path / "file").write_text("")
    said, told = asked(tmp_path / cache)
    assert said == [*SAID, "2"]
    assert len(told) == 1
    assert "NUMBA_CACHE_DIR" in told[0]


def test_two_that_write_at_once_never_hand_out_each_others_content(tmp_path):
    """The second has read the index before the first wrote it: the first's entry is lost, not mistaken."""
    one, other = (Files(tmp_path, "kernel", "stamp") for _ in range(2))
    other._names = lambda: {}  # type: ignore[method-assign]
    one.save("a", "of a")
    other.save("b", "of b")
    fresh = Files(tmp_path, "kernel", "stamp")
    assert (fresh.load("a"), fresh.load("b")) == (None, "of b")
    assert Files(tmp_path, "kernel", "another stamp").load("b") is None
    assert sorted(os.listdir(tmp_path)) == sorted({path.name for path in tmp_path.glob("kernel.*nb?")})
