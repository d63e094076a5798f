"""A crate that stands in MuJoCo all along, and of which the controller learns under way."""

from dataclasses import replace

import numpy as np
import pytest
from thoroughly import first

from pirrht import Controller, FreeSpace, HomologyTree, Outcome, Problem, Sampling, SingleIntegrator, StraightLine
from sim.drive.episode import run
from sim.drive.executor import Executor
from sim.mjcf import load

PERIOD = 0.04
SCENE = """<mujoco model="room"><worldbody>
  <geom name="low" type="box" pos="2.2 1.4 0.25" size="0.2 0.7 0.25"/>
  <geom name="high" type="box" pos="2.2 3.6 0.25" size="0.2 0.7 0.25"/>
  <geom name="crate" type="box" pos="3.6 2.5 0.25" size="0.3 0.3 0.25"/>
  <site name="start" pos="0.5 2.5 0"/><site name="goal" type="cylinder" pos="5.5 2.45 0" size="0.25 0.01"/>
  <site name="workspace" type="box" pos="3 2.5 0.5" size="3 2.5 0.5"/>
</worldbody></mujoco>"""


def driven(file, seed: int, *, informed: bool):
    """A run of which the controller learns of the crate after 0.6 s, or never."""
    file.write_text(SCENE)
    loaded = load(file)
    whole = loaded.scene
    known = replace(whole, obstacles=tuple(o for o in whole.obstacles if o.name != "crate"))
    problem, space = Problem(dynamics=SingleIntegrator(b=0.1), scene=known, R=2 * np.eye(2)), FreeSpace.of(known)
    tree = HomologyTree(space, StraightLine.of(problem), limit=0.8, rng=np.random.default_rng(0))
    tree.grow(300)
    controller = Controller(problem, space, tree, Sampling(samples=100, first=PERIOD), rng=np.random.default_rng(1))
    plant = Executor(loaded, replace(problem, scene=whole), period=PERIOD)
    frames = []
    for frame in run(plant, controller, whole.start, np.random.default_rng(seed), max_time=20.0):
        frames.append(frame)
        if informed and frame.end_time > 0.6:
            controller.update(whole)
    return frames


@pytest.mark.parametrize("seed", first(range(4)))
def test_a_crate_is_passed_once_the_controller_is_informed_of_it(seed: int, tmp_path):
    frames = driven(tmp_path / "room.xml", seed, informed=True)
    assert frames[-1].outcome is Outcome.GOAL
    assert {len(frame.driven_class) for frame in frames} == {2, 3}
    result = frames[-1].metrics
    assert result.executed_class in ("0,0", "0,0,-1", "0,0,1")
    assert result.executed_class == frames[-1].plan.favourite
    assert 0.0 < result.min_clearance < 0.3
    assert driven(tmp_path / "room.xml", seed, informed=False)[-1].outcome is Outcome.COLLISION
