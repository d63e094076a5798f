"""Kernels on disk: named by what they compute, found by the next process, and run only where nobody else wrote them."""

import os
import shutil
import subprocess
import sys
import time

import pytest
from repository import environment

from pirrht.jit import cache, ownership
from pirrht.jit.cache import identity
from pirrht.jit.jit import DISABLED

pytestmark = pytest.mark.skipif(DISABLED, reason="nothing is compiled")

SYSTEM = '''
import math
import numpy as np
from typing import NamedTuple
class Pair(NamedTuple):
    first: float
    second: float
SPEED = 1.5
TABLE = np.array([1.0, 2.0])
def helper(x):
    """A helper."""
    return SPEED * x
def drift(x, p, out): out[0] = math.cos(x[0]) * helper(1.0) + np.abs(TABLE[0]) + Pair(1.0, 2.0).first
'''


def named(source: str) -> str | None:
    """The name of `drift` in a module of some source."""
    scope: dict[str, object] = {"__name__": "users"}
    exec(source, scope)
    return identity(scope["drift"])  # type: ignore[arg-type]


TUNED = """
from enum import IntEnum
from typing import NamedTuple
class Nested(NamedTuple):
    gains: tuple[float, float] = (1.0, 2.0)
class Tuning(NamedTuple):
    share: float = 0.5
    most: int = 3
    nested: Nested = Nested()
class Column(IntEnum):
    FIRST = 0
    LAST = 2
TUNING = Tuning()
REST = slice(1, 3)
def scaled(x): return x * TUNING.share + TUNING.nested.gains[1]
def drift(x):
    total = x[Column.LAST] + x[REST].sum()
    for k in range(TUNING.most):
        total += scaled(x[k])
    return total
"""


@pytest.mark.parametrize(
    ("edit", "same"),
    [
        (("SPEED =", "\n\n# a comment\nSPEED ="), True), (("A helper.", "What it does."), True),
        (("1.5", "1.6"), False), (("[1.0, 2.0]", "[1.0, 2.5]"), False), (("SPEED * x", "SPEED + x"), False),
        (("math.cos", "math.sin"), False), (("out[0]", "out[1]"), False),
        (("    first: float\n    second: float", "    second: float\n    first: float"), False),
        (("Tuning()", "Tuning(share=0.5)"), True), (("share: float = 0.5", "share: float = 0.25"), False),
        (("Tuning()", "Tuning(most=4)"), False), (("(1.0, 2.0)\n", "(1.0, 2.5)\n"), False),
        (("LAST = 2", "LAST = 1"), False), (("slice(1, 3)", "slice(2, 3)"), False),
    ],
)  # fmt: skip
def test_a_name_is_of_whatever_a_function_reads_and_of_neither_place_nor_docstring(edit: tuple[str, str], same: bool):
    (source,) = (text for text in (SYSTEM, TUNED) if edit[0] in text)
    assert named(source) is not None
    assert (named(source) == named(source.replace(*edit))) is same


@pytest.mark.parametrize("value", ["object()", "[1.0]", "__import__('os')"])
def test_what_could_change_unseen_leaves_a_function_without_a_name(value: str):
    assert named(SYSTEM.replace("SPEED = 1.5", f"SPEED = {value}")) is None


# A package of three folders: a kernel calls an inlined function, which calls one two folders down.
PACKAGE = {
    "outer/__init__.py": "",
    "outer/inner/__init__.py": "",
    "outer/inner/deep.py": '''
from pirrht.jit.jit import inlined
@inlined
def step(x):
    """A step."""
    return x + 1.0
''',
    "outer/middle.py": """
from pirrht.jit.jit import inlined
from outer.inner.deep import step
@inlined
def twice(x):
    return step(step(x))
""",
    "kernels.py": """
import sys
from numba.core import event
from pirrht.jit.jit import kernel
from outer.inner.deep import step
from outer.middle import twice
@kernel
def four(x):
    return twice(twice(x))
@kernel
def other(x):
    return 10.0 * x
made = []
class Heard(event.Listener):
    def on_start(self, happening): made.append(happening.data["dispatcher"].py_func.__name__)
    def on_end(self, happening): pass
event.register("numba:compile", Heard())
print(four(1.0), other(1.0), *sorted(set(made)))
""",
}


class Users:
    """A folder with a package of somebody's kernels, and what a process that runs it prints."""

    def __init__(self, folder) -> None:
        self.folder, self.cache = folder, folder / "cache"
        for name, source in PACKAGE.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(source)

    def edit(self, name: str, before: str, after: str) -> None:
        path = self.folder / name
        path.write_text(path.read_text().replace(before, after))
        shutil.rmtree(path.parent / "__pycache__", ignore_errors=True)

    def begin(self, cache=None) -> subprocess.Popen[str]:
        known = environment() | {"NUMBA_CACHE_DIR": str(cache or self.cache)}
        command = [sys.executable, str(self.folder / "kernels.py")]
        return subprocess.Popen(command, env=known, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def run(self, cache=None) -> tuple[list[str], list[str]]:
        process = self.begin(cache)
        said, told = process.communicate()
        assert process.returncode == 0, told
        return said.split(), told.splitlines()


ALL = ["5.0", "10.0", "four", "other", "step", "twice"]


@pytest.fixture
def users(tmp_path) -> Users:
    return Users(tmp_path)


@pytest.mark.slow
def test_an_edit_costs_the_kernels_that_it_touches_and_their_callers(users: Users):
    assert (users.run(), users.run()) == ((ALL, []), (["5.0", "10.0"], []))
    users.edit("outer/inner/deep.py", "A step.", "One step, in other words.")
    users.edit("outer/middle.py", "@inlined", "# a comment\n@inlined")
    assert users.run() == (["5.0", "10.0"], [])
    users.edit("kernels.py", "10.0 * x", "11.0 * x")
    assert users.run() == (["5.0", "11.0", "other"], [])
    users.edit("outer/inner/deep.py", "x + 1.0", "x + 2.0")
    assert users.run() == (["9.0", "11.0", "four", "step", "twice"], [])
    users.edit("outer/inner/deep.py", "x + 2.0", "x + 1.0")
    assert users.run() == (["5.0", "11.0"], [])


@pytest.mark.slow
@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:-100] + bytes([content[-100] ^ 1]) + content[-99:],
        lambda content: b"",
        lambda content: content[: len(content) // 2],
        lambda content: b"\x80\x05X\xff\xff\xff\x7f",  # a pickle that asks for 2 GB
    ],
    ids=["a bit", "empty", "half", "greedy"],
)
def test_a_damaged_file_is_compiled_anew_with_one_line(users: Users, damage):
    users.run()
    for path in (users.cache / "pirrht" / "kernels").iterdir():
        if path.suffix != ".lock":
            path.write_bytes(damage(path.read_bytes()))
    said, told = users.run()
    assert said == ALL
    assert len(told) == 1
    assert "damaged" in told[0]
    assert users.run() == (["5.0", "10.0"], [])


@pytest.mark.slow
@pytest.mark.parametrize("cache", ["kernels.py/cache", "/proc/nowhere"])
def test_where_nothing_can_be_kept_kernels_work_and_one_line_says_so(users: Users, cache: str):
    said, told = users.run(users.folder / cache)
    assert said == ALL
    assert len(told) == 1
    assert "NUMBA_CACHE_DIR" in told[0]


KEY = "kernels.four-0123"
NOBODY = 65534
ROOT = pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")


class Trap:
    """Leaves a file where it is unpickled."""

    def __init__(self, mark) -> None:
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


@pytest.fixture
def kernels(tmp_path, monkeypatch: pytest.MonkeyPatch):
    """A folder of kernels in which there is one that runs code when it is loaded."""
    monkeypatch.setattr(cache, "folder", lambda: tmp_path / "kernels")
    monkeypatch.setattr(cache, "_warned", set())
    ownership._is_below_foreign.cache_clear()
    before = os.umask(0)  # a user who lets everybody write: not to what is run
    try:
        cache.save(KEY, Trap(tmp_path / "ran"))
    finally:
        os.umask(before)
    return tmp_path / "kernels"


def linked(path) -> None:
    path.rename(path.with_name("elsewhere"))
    path.symlink_to("elsewhere")
    os.lchown(path, NOBODY, NOBODY)


@pytest.mark.parametrize("which", ["folder", "file"])
@pytest.mark.parametrize(
    "done",
    [
        lambda path: path.chmod(0o777), lambda path: path.chmod(0o775),
        pytest.param(lambda path: os.chown(path, NOBODY, NOBODY), marks=ROOT), pytest.param(linked, marks=ROOT),
    ],
    ids=["open", "shared", "given away", "linked"],
)  # fmt: skip
def test_what_others_may_have_written_is_not_run_and_one_line_says_so(kernels, tmp_path, caplog, which: str, done):
    done({"folder": kernels, "file": kernels / KEY}[which])
    assert cache.load(KEY, lambda found: found) is None
    cache.save(KEY, 1.0)
    assert not (tmp_path / "ran").exists()
    assert len(caplog.messages) == (which != "file" or done is not linked)  # a link is replaced without a word
    assert all("another user may" in line for line in caplog.messages)
    if which == "file":
        assert cache.load(KEY, lambda found: found) == 1.0  # replaced by what was compiled
    else:
        assert not cache.kept()


def test_a_file_of_the_current_folder_does_not_say_where_kernels_are(tmp_path, monkeypatch):
    monkeypatch.setattr(cache.numba.config, "CACHE_DIR", str(tmp_path))  # as .numba_config.yaml does
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "mine"))
    assert cache.folder.__wrapped__() == tmp_path / "mine" / "pirrht" / "kernels"


def test_who_may_rename_a_folder_above_may_replace_kernels_so_they_are_not_run(tmp_path, kernels, caplog):
    tmp_path.chmod(0o777)
    ownership._is_below_foreign.cache_clear()  # it is asked once per process
    assert cache.load(KEY, lambda found: found) is None
    assert not (tmp_path / "ran").exists()
    assert "another user may write there" in caplog.text
    ownership._is_below_foreign.cache_clear()
    tmp_path.chmod(0o1777)  # as /tmp: others may add files, but rename none
    assert cache.load(KEY, lambda found: "loaded") == "loaded"


def test_a_pipe_in_place_of_a_kernel_keeps_nobody_waiting(kernels):
    (kernels / KEY).unlink()
    os.mkfifo(kernels / KEY)
    assert cache.load(KEY, lambda found: found) is None


def test_who_waits_long_for_a_lock_compiles_and_waits_for_no_other(kernels, monkeypatch, caplog):
    monkeypatch.setattr(cache, "_patience", [0.05])
    with cache.locked(KEY):
        began = time.monotonic()
        for _ in range(5):
            with cache.locked(KEY):
                assert (kernels / f"{KEY}.lock").stat().st_mode & 0o077 == 0  # others cannot hold it
        assert 0.05 < time.monotonic() - began < 0.2
    assert len(caplog.messages) == 1


def test_a_kernel_that_numba_does_not_write_is_not_kept_and_one_line_says_so(
    tmp_path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    monkeypatch.setattr(cache, "folder", lambda: tmp_path)
    monkeypatch.setattr(cache, "_warned", set())
    for key in ("one", "other"):
        cache.save(key, (number for number in range(3)))
    assert [record.getMessage().split(",")[0] for record in caplog.records] == [
        "pirrht: a compiled kernel cannot be kept"
    ]
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(("home", "found"), [("home/.cache", "home/.cache"), (None, "temporary/pirrht-")])
def test_kernels_are_kept_where_this_user_may_write(tmp_path, monkeypatch, home: str | None, found: str):
    for name in ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "package").touch()  # no folder, so that even root cannot write there
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(cache, "_PACKAGE", tmp_path / "package")
    monkeypatch.setattr(cache.tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setattr(cache.os.path, "expanduser", lambda path: str(tmp_path / home) if home else path)
    assert str(cache.folder.__wrapped__()).startswith(str(tmp_path / found))
