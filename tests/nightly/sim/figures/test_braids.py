"""Pictures of scenes with moving bodies: bodies where they are, braids around their tubes, two noise levels."""

import numpy as np
import pytest
from discs import disc
from figures import braids, snapshots
from figures.effort import Effort
from moving import moved

from sim import plotting as map_of
from sim.drawing.strokes import timed, tubes
from sim.mjcf import load
from sim.plotting import outline

SMALL = Effort(vertices=250, samples=20, max_time=0.1)
plt = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture(scope="module")
def shown():
    return braids.work(SMALL, lambda: None)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def filled(axes):
    """Corners of the areas of a map in the colour of what moves."""
    from matplotlib.colors import to_hex

    patches = [p for p in axes.patches if p.get_fill() and to_hex(p.get_facecolor()) == map_of.MOVER]
    return [patch.get_xy()[:-1] for patch in patches]


def outlined(axes):
    """Corners and strengths of what is only outlined in it."""
    from matplotlib.colors import to_hex

    patches = [p for p in axes.patches if not p.get_fill() and to_hex(p.get_edgecolor()) == map_of.MOVER]
    return [(patch.get_xy()[:-1], patch.get_alpha()) for patch in patches]


def test_a_panel_per_scene_has_a_braid_per_class_from_the_start_at_0_to_the_goal(shown):
    figure = braids.draw(plt, shown)
    assert len(figure.axes) == len(braids.SCENES) == len(shown)
    for axes, one in zip(figure.axes, shown, strict=True):
        assert [axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()] == ["$x$ [m]", "$y$ [m]", "$t$ [s]"]
        assert len(one.references) >= 2
        goal = one.scenario.loaded.scene.goal
        for reference in one.references:
            way = timed(reference, 0.0)
            np.testing.assert_allclose(way[0], [*one.scenario.start[:2], 0.0])
            assert np.linalg.norm(way[-1, :2] - goal.center) <= goal.radius + 0.02
            assert axes.get_zlim()[1] >= way[-1, 2]
        told = " ".join(text.get_text() for text in axes.texts)
        assert all(f"{reference.cost:.2f}" in told for reference in one.references)


def test_what_lies_behind_a_tube_is_hidden_and_what_lies_before_it_is_not():
    (tube,) = tubes(moved("m", [(0, 3, 3, 0)], disc("d", 0, 0, 0.3)), 0.0, 5.0)
    towards = braids._towards_eye(5.0)
    for off, behind in ((-1.0, True), (-0.5, True), (0.5, False), (1.0, False)):
        point = np.array([3.0, 3.0, 2.0]) + off * towards
        assert bool(braids.hidden(point[None], [tube], 5.0)[0]) is behind
    assert not braids.hidden(np.array([[1.0, 3.0, 2.0], [3.0, 4.0, 4.9]]), [tube], 5.0).any()


def test_a_snapshot_shows_the_body_where_it_is_then_and_where_the_plan_takes_it():
    one = snapshots.drive(SMALL.scenario("crossing"), (0.0, 1.0))
    figure = snapshots.draw(plt, [one], labels=[""], width=7.0, whole=True)
    (mover,) = load("crossing").scene.movers
    for axes, step in zip(figure.axes, one.shown, strict=True):
        (corners,) = filled(axes)
        (solid,) = mover.at(one.frames[step].time)
        np.testing.assert_allclose(corners, outline(solid))
        assert len(outlined(axes)) == len(map_of.MOMENTS)
