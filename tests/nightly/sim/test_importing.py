"""The long tests of integration/sim/importing: all worlds of the benchmarks BARN and DynaBARN."""

import json
import re

import numpy as np
import pytest
from integration.sim.importing.test_worlds_of_motions import deviation
from repository import ROOT

from sim.importing.scene_file import import_world
from sim.mjcf import load

BARN, MOTIONS = (ROOT.parent / "shared" / "data" / name for name in ("barn", "dynabarn/worlds.json"))


@pytest.mark.skipif(not BARN.is_dir(), reason="the BARN worlds are not next to the repository")
def test_all_barn_worlds_become_scenes(tmp_path):
    for world in sorted(BARN.glob("*.world")):
        target = tmp_path / f"{world.stem}.xml"
        task = {"start": (-2.25, 3, np.pi / 2), "goal": (-2.25, 13, 1), "workspace": (-4.5, 0, 2, 14)}
        imported = import_world(world, target, **task)
        written = re.findall(r"<collision\b", world.read_text())
        scene = load(target).scene
        assert imported.geoms == len(scene.obstacles) == len(written) - 1  # all but the ground
        np.testing.assert_allclose(scene.start, [-2.25, 3, np.pi / 2])


@pytest.mark.skipif(not MOTIONS.exists(), reason="the benchmark's motions are not here")
def test_every_world_of_motions_is_taken_over_and_its_rows_stay_by_the_spline(tmp_path):
    for number, world in json.loads(MOTIONS.read_text()).items():
        scene = load(import_world(MOTIONS, tmp_path / f"{number}.xml", number=number).path).scene
        assert [m.name for m in scene.movers] == [o["name"] for o in world["obstacles"]]
        for mover, obstacle in zip(scene.movers, world["obstacles"], strict=True):
            assert deviation(mover.motion.rows, np.array(obstacle["keys"])) <= 0.005
            assert mover.motion.repeat
