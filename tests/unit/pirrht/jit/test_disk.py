"""Kernels of somebody else are not run, however they came to lie where kernels are looked for."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from pirrht.jit import cache

KEY = "kernels.four-0123"
NOBODY = 65534
ROOT = pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")


class Trap:
    """Leaves a file where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


@pytest.fixture
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of kernels in which there is one that runs code when it is loaded."""
    monkeypatch.setattr(cache, "folder", lambda: tmp_path / "kernels")
    monkeypatch.setattr(cache, "_warned", set())
    before = os.umask(0)  # a user who lets everybody write: not to what is run
    try:
        cache.save(KEY, Trap(tmp_path / "ran"))
    finally:
        os.umask(before)
    return tmp_path / "kernels"


def given_away(path: Path) -> None:
    os.chown(path, NOBODY, NOBODY)


def opened(path: Path) -> None:
    path.chmod(0o777)


def shared(path: Path) -> None:
    path.chmod(0o775)


def linked(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))
    path.symlink_to("elsewhere")
    os.lchown(path, NOBODY, NOBODY)


@pytest.mark.parametrize("which", ["folder", "file"])
@pytest.mark.parametrize(
    "done", [opened, shared, pytest.param(given_away, marks=ROOT), pytest.param(linked, marks=ROOT)]
)
def test_what_others_may_have_written_is_not_run_and_one_line_says_so(
    kernels: Path, tmp_path: Path, caplog, which: str, done: Callable[[Path], None]
):
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


def test_a_file_of_the_current_folder_does_not_say_where_kernels_are(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(cache.numba.config, "CACHE_DIR", str(tmp_path))  # as .numba_config.yaml does
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "mine"))
    cache.folder.cache_clear()
    try:
        assert cache.folder() == tmp_path / "mine" / "pirrht" / "kernels"
    finally:
        cache.folder.cache_clear()
