"""Mouse and keys in a viewer that is made up."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim.play.drive import Play, first
from sim.play.events import Move, Noise
from sim.play.window import HOME, LESS, MORE, PULLED, Window
from sim.scenario import prepare


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


@pytest.fixture(scope="module")
def play() -> Play:
    known = prepare("slit", loose=True, given={"vertices": 60, "samples": 20})
    return Play(known, first(known), real_time=True)


@pytest.fixture
def window(play: Play) -> Window:
    play.plant.asked.clear()
    return Window(play.plant, Viewer)


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


def test_the_picture_is_that_of_the_plant_from_above_until_the_window_is_closed(window, play):
    camera = window.handle.cam
    np.testing.assert_allclose(camera.lookat, [3.0, 2.5, 0.0], atol=0.1)
    assert 5.0 < camera.distance < 8.0
    assert camera.elevation < -60.0
    assert window.model.site_rgba[window.model.site("workspace").id, 3] == 0.0  # it would hide what is in it
    for place in ([2.0, 1.0], [1.0, 2.5]):
        play.plant.reset(np.array(place))
        window.refresh()
        np.testing.assert_allclose(window.data.body("robot/robot").xpos[:2], place)
    window.start()
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
def test_keys_change_the_noise_and_home_is_for_the_one_who_waits(window, play, key, noise):
    window.handle.key(key)
    window.refresh()
    assert list(play.plant.asked) == [Noise(at=0.0, noise=pytest.approx(one)) for one in noise]
    assert window.home == (key == HOME)
