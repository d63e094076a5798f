"""The line about compiling tells what is left to compile for the robot at hand."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from pirrht.compiled import jit
from pirrht.geometry.scene import Scene
from pirrht.systems.double_integrator import DoubleIntegrator
from sim.cli import warm
from sim.cli.compile_work import AMONG, GUIDES, MOTIONS, WAYS, Work
from sim.rehearsal import BUSY_ROOM, ROOM
from sim.scenario import prepare
from sim.systems import System, named

ALL = {warm.PLANNER, warm.POINT, warm.OTHERS}


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


def work_of(system: System, room: Scene = ROOM) -> Work:
    return Work.of(system, system.problem(room, system.settings))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installation where the kernels of a point, and some of others, have been compiled."""
    monkeypatch.setattr(jit, "_FOLDER", tmp_path)
    monkeypatch.setattr(jit, "cached", lambda module: module in ALL)
    return tmp_path


def seconds(capsys: pytest.CaptureFixture[str], work: Work, *, sampling: bool = True) -> tuple[str, int, str]:
    notice = warm.Notice()
    notice.sampling, notice.work = sampling, work
    notice.tell()
    told = re.fullmatch(r"compiling kernels, (once|every time): about (\d+) s(.*)\n", capsys.readouterr().err)
    assert told is not None
    return told[1], int(told[2]), told[3]


@pytest.mark.parametrize("name", ["double_integrator", "rover", "unicycle"])
def test_the_first_use_of_a_robot_is_told_as_long_as_it_takes(folder, capsys, name):
    work = work_of(named(name))
    assert seconds(capsys, work) == ("once", MOTIONS + GUIDES, f", most of them for {named(name).robots}")
    assert seconds(capsys, work, sampling=False)[1] == MOTIONS


def test_a_robot_whose_references_are_a_points_takes_no_time_to_plan(folder, capsys):
    assert seconds(capsys, work_of(named("second_order_car")))[1] == GUIDES
    assert seconds(capsys, work_of(named("second_order_car")), sampling=False)[1] == warm.LITTLE


def test_what_has_been_done_is_told_no_more(folder, capsys):
    work = work_of(named("rover"))
    work.done("plan")
    assert seconds(capsys, work)[1] == GUIDES
    work.done("sample")
    assert seconds(capsys, work)[1] == warm.LITTLE
    assert seconds(capsys, work_of(named("double_integrator")))[1] == MOTIONS + GUIDES


def test_among_bodies_that_move_all_is_new_to_whoever_knows_what_stands(folder, capsys):
    puck, rover = (work_of(named(name), BUSY_ROOM) for name in ("single_integrator", "rover"))
    work_of(named("single_integrator")).done("plan", "sample")
    assert seconds(capsys, puck) == ("once", WAYS + AMONG, ", most of them for puck among bodies that move")
    assert seconds(capsys, puck, sampling=False)[1] == WAYS
    puck.done("plan")
    assert seconds(capsys, rover)[1] == AMONG  # ways in space and time are the same for both
    puck.done("sample")
    assert seconds(capsys, puck)[1] == warm.LITTLE
    assert seconds(capsys, rover)[1] == AMONG


def test_an_edited_system_is_told_as_long_as_a_new_one(folder, capsys):
    work_of(windy(0.1)).done("plan", "sample")
    assert seconds(capsys, work_of(windy(0.1)))[1] == warm.LITTLE
    assert seconds(capsys, work_of(windy(0.2))) == ("once", GUIDES, ", most of them for kite")


def test_kernels_that_cannot_be_kept_are_told_every_time(folder, capsys):
    strange = object()  # its value could change unseen

    def drift(x, p, out):
        out[0] = strange

    system = windy(0.1)
    problem = system.problem(ROOM, system.settings)
    type(problem.dynamics).drift = staticmethod(drift)
    work = Work.of(system, problem)
    work.done("plan", "sample")
    assert seconds(capsys, work)[:2] == ("every time", GUIDES)


def test_what_takes_longer_than_was_said_is_told_again_and_ever_less_often(folder, capsys, monkeypatch):
    now = 100.0
    monkeypatch.setattr(warm.time, "perf_counter", lambda: now)
    notice = warm.Notice()
    notice.tell_if_late()  # nothing has been said
    notice.sampling, notice.work = True, work_of(named("rover"))
    notice.tell()
    late = int(warm.LATE * (MOTIONS + GUIDES) + warm.SLACK)
    for now in np.arange(100.0, 1000.0):  # noqa: B007
        notice.tell_if_late()
    told = [int(line.split()[3]) for line in capsys.readouterr().err.splitlines()[1:]]
    assert told == [late, 2 * late, 4 * late, 8 * late]


def test_a_point_is_told_what_every_command_needs(folder, capsys, monkeypatch):
    work = work_of(named("single_integrator"))
    assert seconds(capsys, work) == ("once", warm.LITTLE, "")
    monkeypatch.setattr(jit, "cached", lambda module: False)
    assert seconds(capsys, work)[1] == warm.PLANNING + warm.SAMPLING


def test_where_nothing_can_be_written_notes_are_left_out(folder):
    work = work_of(named("rover"))
    (folder / jit.NOTES).touch()  # a file where the folder should be
    work.done("plan")
    assert work.seconds(False) == MOTIONS


@pytest.mark.parametrize("name", ["single_integrator", "unicycle"])
@pytest.mark.parametrize("sampling", [False, True])
def test_the_process_on_the_other_core_compiles_what_commands_look_for(name, sampling):
    """Nobody would hear of its errors, and one that left nothing would be started by every command."""
    warm.compile_rest(name, sampling=sampling)
    assert jit.cached((warm.sampler if sampling else warm.shortening)(name))


def test_among_bodies_that_move_guides_are_compiled_elsewhere_until_they_are_known(folder, monkeypatch):
    begun = []
    monkeypatch.setattr(warm.subprocess, "Popen", lambda command, **_: begun.append(command[3:]))
    monkeypatch.setattr(warm.jit, "kept", lambda: True)
    scenario = prepare("crossing", known=warm.notice().known)
    warm.start(scenario.loaded)
    assert begun == [["single_integrator", "--among"]]
    warm.notice().done("sample")
    assert warm.start(scenario.loaded) is None
    assert len(begun) == 1


def test_the_process_on_the_other_core_compiles_what_samples_among_bodies_that_move():
    warm.compile_among("single_integrator")
    assert all(map(jit.cached, ("listed", "backward_pass", warm.OTHERS)))


@pytest.mark.parametrize("scene", ["slit", "clutter", "crossing"])
def test_once_its_kernels_are_there_no_command_starts_to_compile(scene, monkeypatch):
    loaded = prepare(scene).loaded
    monkeypatch.setattr(jit, "cached", lambda module: module in {warm.shortening(loaded.dynamics_name), *ALL})
    monkeypatch.setattr(jit, "noted", lambda name: True)
    assert warm.start(loaded) is None
    assert warm.start(loaded, sampling=False) is None


def test_what_moves_is_planned_around_without_what_shortens_standing_paths(monkeypatch):
    monkeypatch.setattr(jit, "cached", lambda module: False)
    assert warm.start(prepare("crossing").loaded, sampling=False) is None
