"""Runs that somebody interferes with: a push moves the robot, a moved obstacle is there, and plans follow."""

import json
import re
import threading
from contextlib import nullcontext
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from repository import ROOT
from thoroughly import thorough

from pirrht import HomologyTree, OptionError, Outcome
from sim.cli import main
from sim.play import drive, events
from sim.play.drive import LATENCY, Play, first
from sim.play.events import Event, Move, Noise, Push
from sim.play.window import HOME, LESS, MORE, PULLED, Window
from sim.scenario import Scenario, prepare

FEW = {"vertices": 150, "samples": 40, "max_time": 8.0}


def scenario(robot: str = "puck", **given) -> Scenario:
    return prepare("slit", robot=robot, loose=True, given={**FEW, **given})


def played(known: Scenario, *script: Event, until: float = np.inf, real_time=False) -> tuple[Play, list, list[str]]:
    """A run, its frames up to a time, and what was reported."""
    said: list[str] = []
    play = Play(known, first(known), script=script, real_time=real_time, tell=said.append)
    frames = []
    for frame in play.drive():
        frames.append(frame)
        if frame.end_time >= until - 1e-9:
            break
    play.close()
    return play, frames, said


def test_without_interference_a_loose_run_is_that_of_run():
    known = prepare("slit", given={**FEW, "max_time": 0.3})
    plain = list(known.drive(known.plant(), known.driver(known.grown_tree())))
    _, frames, said = played(scenario(max_time=0.3))
    assert said == []
    for ours, theirs in zip(frames, plain, strict=True):
        np.testing.assert_array_equal(ours.state, theirs.state)
        assert (ours.cost, ours.length, ours.driven_class) == (theirs.cost, theirs.length, theirs.driven_class)
        assert ours.clearance == pytest.approx(theirs.clearance, abs=1e-12)


@pytest.mark.parametrize("robot", ["puck", thorough("hover")])
def test_a_push_moves_the_robot_by_about_as_much_as_it_says(robot):
    """A puck is carried at that speed meanwhile, a mass has it afterwards, less what the controls do against it."""
    quiet = scenario(robot, noise=1e-3, period=0.05)
    _, still, _ = played(quiet, until=0.6)
    _, pushed, said = played(quiet, Push(at=0.2, speed=(0.0, 0.5), lasts=0.2), until=0.6)
    assert said == ["pushed by (0, 0.5) m/s for 0.2 s at 0.20 s"]
    away = np.array([a.state[1] - b.state[1] for a, b in zip(pushed, still, strict=True)])
    assert np.all(np.abs(away[:4]) < 1e-12)
    assert 0.03 < away[7] < 0.11
    if robot == "hover":
        assert 0.2 < pushed[7].state[3] - still[7].state[3] < 0.55


def test_a_moved_obstacle_makes_the_tree_anew_in_the_background(monkeypatch):
    threads, grow = [], HomologyTree.grow

    def watched(tree, *arguments, **named):
        threads.append(threading.current_thread() is threading.main_thread())
        grow(tree, *arguments, **named)

    monkeypatch.setattr(HomologyTree, "grow", watched)
    play, frames, _ = played(scenario(), Move(at=0.5, what="upper wall", to=(3.4, 2.45)), until=1.2)
    assert [*dict.fromkeys(threads)] == [True, False]
    spaces = [frame.plan.space for frame in frames]
    change = next(i for i, space in enumerate(spaces) if space is not spaces[0])
    assert frames[change].time == pytest.approx(0.5 + LATENCY)
    moved = next(o for o in spaces[-1].scene.obstacles if o.name == "upper wall")
    np.testing.assert_allclose(moved.position, [3.4, 2.45, 0.25])
    assert len(frames[change].plan.references) == 2  # the slit is closed
    assert [frame.step for frame in frames] == list(range(len(frames)))
    assert np.all(np.diff([(frame.cost, frame.noisy_length) for frame in frames], axis=0) > 0)
    assert play.plant.data.mocap_pos[play.plant.rows["upper wall"], 1] == pytest.approx(2.45)


def test_a_wall_is_there_for_the_robot_before_plans_know_of_it(monkeypatch):
    monkeypatch.setattr(drive, "LATENCY", 5.0)
    _, frames, _ = played(scenario(noise=0.01, period=0.05), Move(at=1.0, what="lower wall", to=(3.6, 2.5)))
    assert frames[-1].outcome is Outcome.COLLISION
    assert frames[-1].state[0] == pytest.approx(2.7, abs=0.05)  # its end at 2.8, less the radius


def test_another_noise_keeps_the_tree_and_shakes_robot_and_samples_alike():
    play, frames, _ = played(scenario(noise=0.01), Noise(at=0.3, noise=0.3), until=1.0)
    assert play.live.built.driver.problem.dynamics.b == 0.3
    assert len({(id(frame.plan.space), frame.vertices) for frame in frames}) == 1
    before, after = ([f for f in frames if (f.time < 0.3 - 1e-9) is early] for early in (True, False))
    spread = [np.std(np.concatenate([f.advance.states[:, 1] for f in part])) for part in (before, after)]
    assert spread[1] > 5 * spread[0]


@pytest.mark.parametrize(
    ("event", "reasons"),
    [
        (Move(at=0.1, what="lamp", to=(1.0, 1.0)), ["could be moved; there are upper wall, lower wall, goal"]),
        (Move(at=0.1, what="goal", to=(3.4, 2.8)), ["on top of the goal"]),
        (Move(at=0.1, what="upper wall", to=(1.1, 2.5)), ["on top of the robot"]),
        (Move(at=0.1, what="goal", to=(50.0, 2.5)), ["outside the workspace"]),
        (
            Move(at=0.1, what="goal", to=(5.0, 3.0)),
            ["goal moved", "no plan here; the run continues with the earlier plan"],
        ),
    ],
)
def test_what_cannot_be_moved_or_planned_changes_no_plan_and_is_reported(monkeypatch, event, reasons):
    def nothing(*_) -> None:
        raise OptionError("no plan here")

    monkeypatch.setattr(drive, "build", nothing)
    play, frames, said = played(scenario(), event, until=0.6)
    assert len(said) == len(reasons)
    assert all(reason in line for reason, line in zip(reasons, said, strict=True))
    assert len(play.plant.done) == len(reasons) - 1
    assert len({id(frame.plan.space) for frame in frames}) == 1


@pytest.mark.parametrize(("real_time", "to"), [(False, (5.0, 4.0)), (True, (2.5, 3.8))])
def test_a_moved_goal_is_reached_and_so_is_one_that_is_moved_after_the_end(real_time, to):
    known = scenario(noise=0.02, samples=20, period=0.02, real_time=real_time)
    play, frames, said = played(known, Move(at=0.5, what="goal", to=to), real_time=real_time)
    assert said[0].startswith(f"goal moved to ({to[0]:g}, {to[1]:g}) at 0.5")
    assert frames[-1].outcome is Outcome.GOAL
    assert np.hypot(*(frames[-1].state[:2] - to)) <= 0.3
    play = Play(known, play.live.built, real_time=real_time)
    play.plant.reset(frames[-1].state)
    play.plant.asked.append(Move(at=0.0, what="goal", to=(1.0, 2.5)))
    start = play.again(home=False)
    np.testing.assert_array_equal(start, frames[-1].state)
    *_, last = play.drive(start)
    play.close()
    assert last.outcome is Outcome.GOAL
    assert last.state[0] < 1.4


@pytest.mark.slow
def test_a_played_script_is_the_same_every_time_and_reports_what_was_done(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = re.search(r"```json\n(.*?)```", (ROOT / "docs" / "play.md").read_text(), re.S)[1]
    Path("push.json").write_text(json.dumps(json.loads(text)[::-1]))  # steps come in the order of their times
    results = []
    for name in ("a.json", "b.json"):
        line = f"play slit --headless --script push.json --vertices 150 --samples 40 --json {name}"
        assert main(line.split()) == 0
        results.append(json.loads(Path(name).read_text()))
        del results[-1]["step_ms"], results[-1]["deadline_misses"]
    assert "upper wall moved by (0, 0.3) at 1.00 s" in capsys.readouterr().out
    assert results[0] == results[1]
    done = [(one["kind"], one["at"]) for one in results[0]["events"]]
    assert done == [("push", 0.5), ("move", 1.0), ("move", 1.5), ("noise", 2.0)]


def test_without_a_display_one_line_says_what_would_work(monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["play", "slit"]) == 2
    assert re.fullmatch(r".*needs a display.*--headless.*\n", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "it does not exist; give a JSON file like"),
        ("{}", "no list of steps"),
        ("[1]", "step 1 is not one of push, move and noise"),
        ('[{"at": 1, "push": [1, 0], "noise": 1}]', "step 1 is not one of"),
        ('[{"at": 1, "push": [1]}]', "two numbers"),
        ('[{"at": 1, "push": 1}]', "two numbers"),
        ('[{"push": [1, 0]}]', '"at" is null'),
        ('[{"at": -1, "noise": 0.1}]', '"at" is -1'),
        ('[{"at": [1, 2], "noise": 0.1}]', '"at" is [1, 2]; it must be a number from 0 to 100000'),
        ('[{"at": 1, "noise": true}]', '"noise" is true'),
        ('[{"at": 1, "noise": NaN}]', '"noise" is NaN'),
        ('[{"at": 1, "move": "goal"}]', 'either "to"'),
        ('[{"at": 1, "move": "goal", "to": [1, 1], "by": [1, 1]}]', 'either "to"'),
        ('[{"at": 1, "move": "goal", "too": [1, 1]}]', 'has "too"'),
        ("no", "no JSON"),
    ],
)
def test_a_script_that_is_none_is_refused_by_step_and_key(tmp_path, text, reason):
    if text is not None:
        (tmp_path / "script.json").write_text(text)
    with pytest.raises(OptionError, match=re.escape(reason)):
        events.read(tmp_path / "script.json")


# -- the window --------------------------------------------------------------------------------------------------


class Viewer:
    """A handle as MuJoCo's passive viewer has it."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, *, key_callback) -> None:
        self.key, self.m, self.runs = key_callback, model, True
        self.perturb = SimpleNamespace(select=0, active=0, refpos=np.zeros(3))
        self.cam, self.lock, self.sync = mujoco.MjvCamera(), nullcontext, lambda: None
        mujoco.mjv_defaultFreeCamera(model, self.cam)

    def is_running(self) -> bool:
        return self.runs

    def close(self) -> None:
        self.runs, self.m = False, None


@pytest.fixture
def window() -> Window:
    known = scenario(vertices=60)
    return Window(Play(known, first(known), real_time=True).plant, Viewer)


def drag(window: Window, body: str, *places: tuple[float, float, float]) -> list:
    """Hold a body, move the cursor from place to place, and let go: the events."""
    hand = window.handle.perturb
    hand.select, hand.active = window.model.body(body).id, 1
    for place in places:
        hand.refpos = np.array(place)
        window.refresh()
    hand.active = 0
    window.refresh()
    return list(window._plant.asked)


def test_the_picture_is_that_of_the_plant_from_above_until_the_window_is_closed(window):
    camera = window.handle.cam
    np.testing.assert_allclose(camera.lookat, [3.0, 2.5, 0.0], atol=0.1)
    assert 5.0 < camera.distance < 8.0
    assert camera.elevation < -60.0
    assert window.model.site_rgba[window.model.site("workspace").id, 3] == 0.0  # it would hide what is in it
    for place in ([2.0, 1.0], [1.0, 2.5]):
        window._plant.reset(np.array(place))
        window.refresh()
        np.testing.assert_allclose(window.data.body("robot/robot").xpos[:2], place)
    window.thread.start()
    window.close()
    assert (window.open, window.thread.is_alive()) == (False, False)


@pytest.mark.parametrize(
    ("body", "places", "moved"),
    [  # up is away from the camera
        ("loose/upper wall", [(3.4, 2.8, 0.2), (3.6, 2.8, 0.2), (3.6, 2.8, 0.7)], [("upper wall", (3.6, 3.3))]),
        ("loose/goal", [(5.5, 2.5, 0.0), (5.0, 3.0, 0.0)], [("goal", (5.0, 3.0))]),
        ("loose/goal", [(5.5, 2.5, 0.0)], []),  # only taken hold of
    ],
)
def test_a_body_that_is_let_go_has_been_moved_along_the_ground(window, body, places, moved):
    assert drag(window, body, *places) == [Move(at=0.0, what=what, to=pytest.approx(to)) for what, to in moved]


def test_the_robot_is_pulled_towards_the_cursor_and_not_too_fast(window):
    pulls = drag(window, "robot/robot", (1.0, 2.5, 0.1), (1.0, 2.6, 0.1), (9.0, 2.5, 0.1))
    np.testing.assert_allclose([one.speed for one in pulls], [(0.0, 0.0), (0.0, 0.4), (PULLED, 0.0)], atol=1e-9)


@pytest.mark.parametrize(("key", "noise"), [(MORE, [0.125]), (LESS, [0.08]), (HOME, [])])
def test_keys_change_the_noise_and_home_is_for_the_one_who_waits(window, key, noise):
    window.handle.key(key)
    window.refresh()
    assert list(window._plant.asked) == [Noise(at=0.0, noise=pytest.approx(one)) for one in noise]
    assert window.home == (key == HOME)


@pytest.mark.slow
def test_a_lidar_sees_a_moved_obstacle_and_no_plan_is_made_anew_for_it():
    known = scenario(noise=0.01, sense="lidar", cell=0.1, period=0.05)
    play, frames, said = played(known, Move(at=0.2, what="upper wall", to=(3.4, 2.45)), until=0.6)
    assert [line for line in said if "moved" in line] == ["upper wall moved to (3.4, 2.45) at 0.20 s"]
    assert len({id(frame.run) for frame in frames}) == 1
    assert play.plant.scenario.loaded.scene.obstacles[0].position[1] == pytest.approx(2.45)
    grids = [frame.believed.occupied for frame in frames]
    assert (grids[-1] & ~grids[0]).any()


@pytest.mark.slow
def test_a_moved_goal_and_another_noise_keep_the_map():
    known = scenario(noise=0.01, sense="lidar", cell=0.1, period=0.05)
    script = [Noise(at=0.1, noise=0.02), Move(at=0.6, what="goal", to=(1.8, 3.0))]
    play, frames, _ = played(known, *script, until=1.1)
    assert len({id(frame.run) for frame in frames}) == 3
    seen = [~frame.believed.unknown for frame in frames]
    assert all(np.all(after >= before) for before, after in pairwise(seen))
    assert play.live.built.driver.problem.dynamics.b == 0.02
    np.testing.assert_allclose(play.live.built.driver.problem.scene.goal.center, [1.8, 3.0])
    assert frames[-1].plan.space.scene.obstacles
