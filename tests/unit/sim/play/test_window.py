"""What a mouse and keys do in the viewer, told by a viewer that is made up."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim.play.drive import Play, first
from sim.play.events import Move, Noise, Push
from sim.play.window import HOME, LESS, MORE, PULLED, Window
from sim.scenario import prepare


class Viewer:
    """A handle as MuJoCo's passive viewer has it."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, *, key_callback) -> None:
        self.key, self.m, self.synced, self.runs = key_callback, model, 0, True
        self.perturb = SimpleNamespace(select=0, active=0, refpos=np.zeros(3))
        self.cam = mujoco.MjvCamera()
        self.lock = nullcontext

    def is_running(self) -> bool:
        return self.runs

    def sync(self) -> None:
        self.synced += 1

    def close(self) -> None:
        self.runs, self.m = False, None

    def drag(self, window: Window, body: str, *places: tuple[float, float, float]) -> None:
        """Hold a body, move the cursor from place to place, and let go."""
        self.perturb.select, self.perturb.active = window.model.body(body).id, 1
        for place in places:
            self.perturb.refpos = np.array(place)
            window.refresh()
        self.perturb.active = 0
        window.refresh()


@pytest.fixture(scope="module")
def play() -> Play:
    known = prepare("slit", loose=True, given={"vertices": 60, "samples": 20})
    return Play(known, first(known), real_time=True)


@pytest.fixture
def window(play: Play) -> Window:
    play.plant.asked.clear()
    return Window(play.plant, Viewer)


def test_the_workspace_is_looked_at_from_above(window):
    camera = window.handle.cam
    np.testing.assert_allclose(camera.lookat, [3.0, 2.5, 0.0])
    assert camera.distance > 5.0
    assert camera.elevation < -60.0


def test_what_is_let_go_has_been_moved_along_the_ground(window, play):
    window.handle.drag(window, "loose/upper wall", (3.4, 2.8, 0.2), (3.6, 2.8, 0.2), (3.6, 2.8, 0.7))
    (event,) = play.plant.asked
    assert event == Move(at=0.0, what="upper wall", to=pytest.approx((3.6, 3.3)))  # up is away from the camera


def test_the_goal_is_dragged_by_its_disc(window, play):
    window.handle.drag(window, "loose/goal", (5.5, 2.5, 0.0), (5.0, 3.0, 0.0))
    assert list(play.plant.asked) == [Move(at=0.0, what="goal", to=pytest.approx((5.0, 3.0)))]


def test_what_is_only_taken_hold_of_is_not_moved(window, play):
    window.handle.drag(window, "loose/goal", (5.5, 2.5, 0.0))
    assert not play.plant.asked


def test_the_robot_is_pulled_towards_the_cursor_and_not_too_fast(window, play):
    window.handle.drag(window, "robot/robot", (1.0, 2.5, 0.1), (1.0, 2.6, 0.1), (9.0, 2.5, 0.1))
    still, near, far = play.plant.asked
    assert isinstance(near, Push)
    assert still.speed == (0.0, 0.0)
    assert near.speed == pytest.approx((0.0, 0.4))
    assert far.speed == pytest.approx((PULLED, 0.0))


@pytest.mark.parametrize(("key", "noise"), [(MORE, 0.125), (LESS, 0.08)])
def test_keys_change_the_noise(window, play, key, noise):
    window.handle.key(key)
    window.refresh()
    assert list(play.plant.asked) == [Noise(at=0.0, noise=pytest.approx(noise))]


def test_home_is_for_the_one_who_waits(window, play):
    window.handle.key(HOME)
    window.refresh()
    assert window.home
    assert not play.plant.asked


def test_no_workspace_hides_what_is_in_it(window):
    """MuJoCo's viewer draws sites of the first groups; the model that is driven keeps its own."""
    site = window.model.site("workspace").id
    assert window.model.site_rgba[site, 3] == 0.0


def test_the_picture_is_that_of_the_plant(window, play):
    play.plant.reset(np.array([2.0, 1.0]))
    window.refresh()
    np.testing.assert_allclose(window.data.body("robot/robot").xpos[:2], [2.0, 1.0])
    assert window.handle.synced == 1


def test_a_window_that_is_closed_shows_nothing_more(window):
    window.start()
    window.close()
    assert not window.open
    assert not window._thread.is_alive()
