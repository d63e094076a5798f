"""Files of bad intent load or are refused with one line, in bounded time and memory."""

import shutil
import sys
from collections import Counter
from pathlib import Path
from random import Random
from time import monotonic

import numpy as np
import pytest
from hostile_mjcf import hostile

from pirrht.errors import SceneError
from sim.mjcf import load

FILES, SECONDS = 600, 180  # the trial of `sim.mjcf.library` has 120 s, and machines are busy


def outcome(path: Path) -> str:
    try:
        scene = load(path).scene
    except SceneError as error:
        return "refused" if "\n" not in str(error) else str(error)
    for solid in scene.obstacles:
        assert np.all(np.isfinite(solid.position))
        np.testing.assert_allclose(solid.rotation @ solid.rotation.T, np.eye(3), atol=1e-6)
    return "loaded"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such limits")
def test_hostile_files_load_or_are_refused_with_one_line(tmp_path, capfd):
    rng, found = Random(46), Counter[str]()
    for number in range(FILES):
        folder, begun = tmp_path / f"case{number}", monotonic()
        folder.mkdir()
        path = hostile(folder, rng)
        found[outcome(path)] += 1
        assert monotonic() - begun < SECONDS
        assert capfd.readouterr().err == "", path.read_bytes()[:600]
        shutil.rmtree(folder)
    assert set(found) == {"loaded", "refused"}
    assert found["loaded"] >= FILES // 12
    assert found["refused"] >= FILES // 2
