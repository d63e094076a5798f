"""The map of a plan among bodies of several parts: words of sides, numbers of classes, a legend that fits."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import image

from sim import figures
from sim.drawing.colors import passing
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
    parts = ["cart (1)", "cart (2)", "cart (3)", "cart (4)", "disc"]
    names = [name.split()[0] for name in scenario.homology.names]
    assert sorted(names) == [part.split()[0] for part in parts]
    for reference in references:
        told = [line.split(": ")[0] for line in passing(reference, scenario.homology)]
        assert set(told) <= set(parts)
        assert len(told) == np.count_nonzero(reference.winding)


def test_the_map_of_many_classes_is_drawn_without_a_warning_and_no_higher_than_wide(carts, tmp_path: Path):
    scenario, tree, references = carts
    assert len(references) >= 8
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figures.draw_plan(tmp_path / "map.png", scenario, tree, references)
    high, wide = image.imread(tmp_path / "map.png").shape[:2]
    assert high < wide
