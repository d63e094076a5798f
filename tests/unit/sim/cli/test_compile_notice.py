"""Compiling is reported in one line, done on both cores, and noted: later commands neither report nor repeat it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pirrht.geometry.scene import Scene
from pirrht.jit import cache
from pirrht.problem import Problem
from pirrht.systems.double_integrator import DoubleIntegrator
from sim.cli import warm
from sim.rehearsal import BUSY_ROOM, ROOM
from sim.systems import System, named

KERNEL = SimpleNamespace(
    data={"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__="pirrht.planner.expand"))}
)


def windy(speed: float) -> System:
    """A mass in a wind; its drift is another function for every speed."""

    def drift(x, p, out):
        out[0], out[1], out[2], out[3] = x[2], x[3], speed, 0.0

    class Kite(DoubleIntegrator):
        """A mass in a wind."""

    Kite.drift = staticmethod(drift)
    return System(
        name="kite", dynamics=lambda s: Kite(b=s.noise), R=2.0 * np.eye(2), states=("x", "y", "vx", "vy"), pace=1.0
    )


def key_of(system: System, room=ROOM) -> str | None:
    return warm.key_of(system, system.problem(room, system.settings))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of kernels."""
    monkeypatch.setattr(cache, "folder", lambda: tmp_path)
    return tmp_path


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """What other processes were asked to compile."""
    words: list[list[str]] = []
    notice = warm.Notice()
    monkeypatch.setattr(warm.subprocess, "Popen", lambda command, **_: words.append(command[1:]))
    monkeypatch.setattr(warm, "notice", lambda: notice)
    monkeypatch.setattr(cache, "kept", lambda: True)
    return words


def test_the_first_kernel_that_is_compiled_is_reported_in_one_line(folder, capsys):
    notice = warm.Notice()
    for _ in range(3):
        notice.on_start(KERNEL)
        notice.on_end(KERNEL)
    notice.close()
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("compiling kernels, once for each kind of robot and scene")
    assert "pirrht warm" in line


def test_where_kernels_cannot_be_kept_the_line_says_so(monkeypatch, capsys):
    monkeypatch.setattr(cache, "kept", lambda: False)
    warm.Notice().report()
    assert "every time" in capsys.readouterr().err


def test_robots_edits_and_moving_obstacles_have_notes_of_their_own():
    keys = [key_of(named(name), room) for name in ("rover", "unicycle") for room in (ROOM, BUSY_ROOM)]
    keys += [key_of(windy(0.1)), key_of(windy(0.2))]
    assert None not in keys
    assert len(set(keys)) == len(keys)
    assert key_of(windy(0.1)) == key_of(windy(0.1))


def test_a_robot_whose_kernels_cannot_be_kept_has_no_note(folder):
    strange = object()  # its value could change unseen

    def drift(x, p, out):
        out[0] = strange

    notice, system = warm.Notice(), windy(0.1)
    problem = system.problem(ROOM, system.settings)
    type(problem.dynamics).drift = staticmethod(drift)
    notice.known(system, problem)
    notice.done("plan", "sample")
    assert not notice.noted("sample")
    assert not list(folder.iterdir())


def test_where_nothing_can_be_written_notes_are_left_out(folder, monkeypatch):
    (folder / "file").touch()
    monkeypatch.setattr(cache, "folder", lambda: folder / "file" / "kernels")
    notice = warm.Notice()
    notice.known(named("rover"), named("rover").problem(ROOM, named("rover").settings))
    notice.done("plan")
    assert not notice.noted("plan")


def of(name: str, room: Scene) -> tuple[System, Problem]:
    system = named(name)
    return system, system.problem(room, system.settings)


@pytest.mark.parametrize("room", [ROOM, BUSY_ROOM], ids=["static", "moving"])
def test_the_other_core_compiles_until_that_is_noted_and_imports_nothing_of_this_folder(folder, begun, room):
    warm.begin(*of("rover", room))
    assert begun == [["-P", "-m", "sim.cli.warm", "rover"] + ["--moving"] * (room is BUSY_ROOM)]
    warm.notice().done("sample")
    warm.begin(*of("rover", room))
    assert len(begun) == 1


def test_a_plan_shortens_on_the_other_core_in_static_scenes_only(folder, begun):
    for room in (ROOM, BUSY_ROOM):
        warm.begin(*of("single_integrator", room), sampling=False)
    assert begun == [["-P", "-m", "sim.cli.warm", "single_integrator", "--plan"]]


def test_what_compiles_elsewhere_ends_when_this_process_has_all(folder, monkeypatch):
    monkeypatch.setattr(warm, "notice", lambda notice=warm.Notice(): notice)  # noqa: B008
    warm.begin(*of("single_integrator", ROOM))
    helper = warm.notice().helper
    assert helper is not None
    warm.finish("sample")
    assert helper.poll() is not None
    assert warm.notice().noted("sample")


@pytest.mark.parametrize("name", ["single_integrator", "unicycle"])
def test_what_the_other_core_does_works(name):
    """Nobody would hear of its errors."""
    warm.compile_shortening(name)
    warm.compile_rest(name, moving=False)


@pytest.mark.slow
def test_what_the_other_core_does_for_moving_obstacles_works():
    warm.compile_rest("single_integrator", moving=True)
