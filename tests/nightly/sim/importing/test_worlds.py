"""The long tests of integration/sim/importing/test_worlds.py."""

from __future__ import annotations

import re

import numpy as np
import pytest
from repository import ROOT

from sim.importing.scene_file import import_world
from sim.mjcf import load

BARN = ROOT.parent / "shared" / "data" / "barn"


@pytest.mark.skipif(not BARN.is_dir(), reason="the BARN worlds are not beside the repository")
def test_all_barn_worlds_become_scenes(tmp_path):
    worlds = sorted(BARN.glob("*.world"))
    assert worlds
    for world in worlds:
        target = tmp_path / f"{world.stem}.xml"
        task = {"start": (-2.25, 3, np.pi / 2), "goal": (-2.25, 13, 1), "workspace": (-4.5, 0, 2, 14)}
        imported = import_world(world, target, **task)
        written = re.findall(r"<collision\b", world.read_text())
        scene = load(target).scene
        assert imported.geoms == len(scene.obstacles) == len(written) - 1  # all but the ground
        np.testing.assert_allclose(scene.start, [-2.25, 3, np.pi / 2])
