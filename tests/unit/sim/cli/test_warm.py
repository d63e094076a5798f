"""Compiling is reported in one line and done on both cores; what is compiled already costs neither."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from sim.cli import warm

KERNEL = SimpleNamespace(
    data={"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__="pirrht.planner.expand"))}
)


def compile_one(notice: warm.Notice) -> None:
    notice.on_start(KERNEL)
    notice.on_end(KERNEL)


@pytest.mark.parametrize(("kept", "often"), [(True, "once"), (False, "every time")])
def test_the_first_kernel_that_is_compiled_is_reported_in_one_line(kept, often, monkeypatch, capsys):
    monkeypatch.setattr(warm.cache, "kept", lambda: kept)
    notice = warm.Notice()
    for _ in range(3):
        compile_one(notice)
    notice.finish()
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"compiling kernels, {often} for each kind of robot and scene")
    assert "pirrht warm" in line


def test_the_other_core_compiles_from_the_first_kernel_on_and_imports_nothing_of_this_folder(monkeypatch):
    started: list[list[str]] = []
    helper = SimpleNamespace(kill=lambda: started.append(["killed"]), communicate=lambda: None)
    monkeypatch.setattr(warm.subprocess, "Popen", lambda command, **_: started.append(command[1:]) or helper)
    monkeypatch.setattr(warm.cache, "kept", lambda: True)
    notice = warm.Notice()
    compile_one(notice)  # before it is known what for
    notice.words = ["slit", "rover"]
    assert started == []
    for _ in range(2):
        compile_one(notice)
    notice.finish()
    assert started == [["-P", "-m", "sim.cli.warm", "slit", "rover"], ["killed"]]
    compile_one(notice)
    assert len(started) == 2


def test_where_kernels_cannot_be_kept_no_other_process_compiles_them(monkeypatch):
    monkeypatch.setattr(warm.cache, "kept", lambda: False)
    notice = warm.Notice()
    notice.words = ["slit", "puck"]
    compile_one(notice)
    assert notice.helper is None


@pytest.mark.parametrize("robot", ["puck", "unicycle"])
def test_what_the_other_core_does_works(robot):
    """Nobody would hear of its errors."""
    warm.compile_for("slit", robot, sampling=False)
    warm.compile_for("slit", robot, sampling=True)


@pytest.mark.slow
def test_what_the_other_core_does_for_moving_obstacles_works():
    warm.compile_for("crossing", None, sampling=True)
