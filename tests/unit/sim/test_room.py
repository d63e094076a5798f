"""A scene that names no margin gets one that its noise asks for, where it has room for it."""

from __future__ import annotations

import numpy as np
import pytest

from pirrht.errors import OptionError
from sim.mjcf import load
from sim.scenario import prepare
from sim.scenario.prepared import DEVIATIONS, LEAST, REACTION

GAP = """<mujoco><worldbody><site name="workspace" type="box" size="2 1.5 1" pos="2 1.5 .5"/>
<geom name="low" type="box" size=".1 {half} .5" pos="2 {low} .5"/>
<geom name="high" type="box" size=".1 {half} .5" pos="2 {high} .5"/>
<site name="start" pos=".6 1.5 0"/>
<site name="goal" type="cylinder" size=".3 .01" pos="3.4 1.5 0"/></worldbody></mujoco>"""


def gap(tmp_path, width: float) -> str:
    """A wall with a gap in its middle [m]."""
    half = 0.25 * (3.0 - width)
    (tmp_path / "gap.xml").write_text(GAP.format(half=half, low=half, high=3.0 - half))
    return str(tmp_path / "gap.xml")


@pytest.mark.parametrize("noise", [0.05, 0.1, 0.2])
def test_it_is_three_deviations_of_what_noise_does_before_the_robot_reacts(tmp_path, noise):
    scenario = prepare(gap(tmp_path, 1.0), given={"noise": noise})
    assert scenario.margin == pytest.approx(DEVIATIONS * noise * np.sqrt(REACTION), abs=1e-4)
    assert scenario.loaded.scene.robot_radius == pytest.approx(0.1 + scenario.margin)


def test_a_robot_whose_place_noise_does_not_move_at_once_gets_the_least(tmp_path):
    assert prepare(gap(tmp_path, 1.0), robot="hover").margin == LEAST


def test_it_takes_a_quarter_of_the_room_in_the_narrowest_passage_at_most(tmp_path):
    assert prepare(gap(tmp_path, 0.24)).margin == pytest.approx(0.25 * 0.02, abs=5e-4)
    assert prepare(gap(tmp_path, 0.21)).margin == 0.0


def test_what_is_said_stays_and_the_scenes_of_the_paper_say_none(tmp_path):
    assert prepare(gap(tmp_path, 1.0), margin=0.02).margin == 0.02
    assert prepare(gap(tmp_path, 1.0), margin=0.0).margin == 0.0
    for name in ("slit", "clutter"):
        assert prepare(name).margin == 0.0
        assert prepare(name).loaded.scene.robot_radius == load(name).scene.robot_radius


def test_settings_that_are_none_are_refused_by_name():
    with pytest.raises(OptionError, match=r"'radius' is no setting but an argument: prepare\(..., radius="):
        prepare("slit", given={"radius": 0.2})
    with pytest.raises(OptionError, match="'sample' is no setting; did you mean samples"):
        prepare("slit", given={"sample": 100})
