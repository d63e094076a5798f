"""The map of a plan among bodies of several parts: words of sides, numbers of classes, a legend that fits."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import image
from matplotlib.figure import Figure

from sim.drawing.sides import by_side, called, passed, passing
from sim.figures import draw
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
def carts(tmp_path_factory: pytest.TempPathFactory) -> Any:
    file = tmp_path_factory.mktemp("carts") / "carts.xml"
    file.write_text(SCENE)
    scenario = prepare(str(file), given={"vertices": 400})
    tree = scenario.grown_tree()
    return scenario, tree, scenario.references(tree)


def test_each_part_that_paths_may_lead_through_has_its_number(carts):
    scenario, _, references = carts
    homology = scenario.homology
    names = called(homology)
    assert sorted(names) == ["cart (1)", "cart (2)", "cart (3)", "cart (4)", "disc"]
    for reference in references:
        told = passed(reference, homology)
        assert {name for name, _ in told} == {name for name, turn in zip(names, reference.winding, strict=True) if turn}
        assert passing(reference, homology) == [
            f"{name}: {side}{' it' if side.endswith('of') else ''}" for name, side in told
        ]
        lines = by_side(told)
        assert sum(line.count(",") + 1 for line in lines) == len(told)
        for name, side in told:
            assert any(line.startswith(f"{side} ") and name in line for line in lines)


def test_the_map_of_many_classes_is_drawn_without_a_warning_and_no_higher_than_wide(carts, tmp_path: Path):
    scenario, tree, references = carts
    assert len(references) >= 8
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw.draw_plan(tmp_path / "map.png", scenario, tree, references)
    high, wide = image.imread(tmp_path / "map.png").shape[:2]
    assert high < wide


def test_bodies_bear_the_numbers_that_classes_are_called_by(carts):
    scenario, tree, references = carts
    axes = Figure().subplots()
    spoken = draw._spoken([passed(one, tree.homology) for one in references], tree.homology)
    draw.draw_scene(axes, scenario, spoken)
    texts = {text.get_text() for text in axes.texts}
    assert texts == {label for labels in spoken.values() for label, _ in labels}
    turned = {str(j + 1) for one in references for j in np.flatnonzero(one.winding)}
    assert {label.split()[-1].strip("()") for label in texts} == turned
    called_so = set(called(tree.homology))
    assert {label for label in texts if label.startswith("cart")} <= called_so
    places = [text.get_position() for text in axes.texts if text.get_text().startswith("cart")]
    assert len(set(places)) == len(places) == 4  # each part has its own, where it is
