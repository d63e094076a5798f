"""On the map of a plan a dot, a number and an outline say where references and bodies are at one moment."""

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from sim import figures
from sim.drawing.colors import ClassColors
from sim.plotting import MOVER
from sim.scenario import Scenario, prepare


@pytest.fixture(scope="module")
def door() -> Any:
    """A door that closes until 1.5 s, and what a plan among it shows."""
    scenario = prepare("closing_door", given={"vertices": 300})
    return scenario, scenario.references(scenario.grown_tree())


def drawn(scenario: Scenario, references: Any) -> Any:
    axes, colors = Figure().subplots(), ClassColors(reference.id for reference in references)
    axes.set_xlim(0.0, 6.0)
    step = figures.draw_moments(axes, scenario, references, colors)
    return axes, step


def within(axes: Any) -> list[Any]:
    """The numbers of outlines."""
    return [text for text in axes.texts if text.get_color() == MOVER]


def test_numbers_stand_where_references_are_at_these_seconds(door):
    scenario, references = door
    axes, step = drawn(scenario, references)
    told = {(float(text.get_text()), *text.xy) for text in axes.texts}
    for reference in references:
        knots = reference.trajectory.path.knots
        for time in np.arange(step, knots[-1, 2], step):
            place = [np.interp(time, knots[:, 2], knots[:, k]) for k in (0, 1)]
            assert any(time == t and np.allclose(place, xy, atol=1e-9) for t, *xy in told)


def test_outlines_are_those_of_bodies_at_these_seconds_until_they_stand_still(door):
    scenario, references = door
    (mover,) = scenario.loaded.scene.movers
    axes, step = drawn(scenario, references)
    rings = [patch.get_xy() for patch in axes.patches if isinstance(patch, Polygon)]
    times = step * np.arange(1, len(rings) + 1)
    assert times[-2] < mover.motion.last <= times[-1]
    for time, ring in zip(times, rings, strict=True):
        assert np.allclose(ring[:-1].mean(axis=0), mover.motion.pose(time)[:2], atol=1e-6)  # of a box
    for time, text in zip(times, within(axes), strict=True):
        assert float(text.get_text()) == time
        assert np.allclose(text.xy, mover.motion.pose(time)[:2], atol=1e-6)
