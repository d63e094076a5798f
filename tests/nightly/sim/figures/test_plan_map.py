"""The map of a plan among bodies: sides in words, numbers of classes, dots and outlines at equal moments, a legend."""

import warnings

import numpy as np
import pytest
from matplotlib import image
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from pirrht.plotting import maps
from pirrht.plotting.colors import ClassColors
from sim import plotting
from sim.scenario import prepare

CART = "\n".join(f'<geom name="p{k}" type="cylinder" size="0.12 0.2" pos="{0.7 * k - 1.05:g} 0 0"/>' for k in range(4))
SCENE = f"""<mujoco model="carts">
  <custom>
    <text name="pirrht_robot" data="puck"/>
    <numeric name="pirrht_motion_cart" data="0 2.2 0.6 0  4 2.2 4.4 0"/>
    <numeric name="pirrht_motion_disc" data="0 4 4 0  4 4 1 0"/>
  </custom>
  <worldbody>
    <body name="cart" mocap="true" pos="2.2 0.6 0.2">{CART}</body>
    <body name="disc" mocap="true" pos="4 4 0.2"><geom type="cylinder" size="0.2 0.2"/></body>
    <site name="workspace" type="box" pos="3 2.5 0.5" size="3 2.5 0.5"/>
    <site name="start" pos="0.5 2.5 0"/>
    <site name="goal" type="cylinder" pos="5.5 2.5 0" size="0.3 0.005"/>
  </worldbody>
</mujoco>"""


@pytest.fixture(scope="module")
def carts(tmp_path_factory: pytest.TempPathFactory):
    file = tmp_path_factory.mktemp("carts") / "carts.xml"
    file.write_text(SCENE)
    scenario = prepare(str(file), given={"vertices": 400})
    tree = scenario.grown_tree()
    return scenario, tree, scenario.references(tree)


def test_the_map_of_many_classes_is_drawn_without_a_warning_and_no_higher_than_wide(carts, tmp_path):
    scenario, tree, references = carts
    assert len(references) >= 8
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plotting.draw_plan(tmp_path / "map.png", scenario, tree, references)
    high, wide = image.imread(tmp_path / "map.png").shape[:2]
    assert high < wide


@pytest.fixture(scope="module")
def door():
    """A door that closes until 1.5 s, references past it, and a map of both with the time between its moments."""
    scenario = prepare("closing_door", given={"vertices": 300})
    references = scenario.references(scenario.grown_tree())
    axes, colors = Figure().subplots(), ClassColors(reference.id for reference in references)
    axes.set_xlim(0.0, 6.0)
    return (
        scenario.loaded.scene.movers[0].motion,
        references,
        axes,
        plotting.draw_moments(axes, scenario, references, colors),
    )


def test_numbers_stand_where_references_are_at_these_seconds(door):
    _, references, axes, step = door
    told = {(float(text.get_text()), *text.xy) for text in axes.texts}
    for reference in references:
        knots = reference.trajectory.path.knots
        for time in np.arange(step, knots[-1, 2], step):
            place = [np.interp(time, knots[:, 2], knots[:, k]) for k in (0, 1)]
            assert any(time == t and np.allclose(place, xy, atol=1e-9) for t, *xy in told)


def test_outlines_are_those_of_bodies_at_these_seconds_until_they_stand_still(door):
    motion, _, axes, step = door
    rings = [patch.get_xy() for patch in axes.patches if isinstance(patch, Polygon)]
    numbers = [text for text in axes.texts if text.get_color() == maps.MOVER]
    times = step * np.arange(1, len(rings) + 1)
    assert times[-2] < motion.last <= times[-1]
    for time, ring, text in zip(times, rings, numbers, strict=True):
        assert np.allclose(ring[:-1].mean(axis=0), motion.pose(time)[:2], atol=1e-6)  # of a box
        assert float(text.get_text()) == time
        assert np.allclose(text.xy, motion.pose(time)[:2], atol=1e-6)
