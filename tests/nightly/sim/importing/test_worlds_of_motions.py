"""The long tests of integration/sim/importing/test_worlds_of_motions.py."""

from __future__ import annotations

import json

import numpy as np
import pytest
from integration.sim.importing.test_worlds_of_motions import deviation
from repository import ROOT

from sim.importing.scene_file import import_world
from sim.mjcf import load

WORLDS = ROOT.parent / "shared" / "data" / "dynabarn" / "worlds.json"


@pytest.mark.skipif(not WORLDS.exists(), reason="the benchmark's motions are not here")
def test_every_world_of_the_benchmark_is_taken_over_and_its_rows_stay_by_the_spline(tmp_path):
    for number, world in json.loads(WORLDS.read_text()).items():
        imported = import_world(WORLDS, tmp_path / f"{number}.xml", number=number)
        scene = load(imported.path).scene
        assert [m.name for m in scene.movers] == [o["name"] for o in world["obstacles"]]
        for mover, obstacle in zip(scene.movers, world["obstacles"], strict=True):
            assert deviation(mover.motion.rows, np.array(obstacle["keys"])) <= 0.005
            assert mover.motion.repeat
