"""The long tests of integration/sim/recording/test_export.py."""

from __future__ import annotations

import numpy as np
import pytest
from integration.sim.recording.test_export import drive, table  # noqa: F401
from rerun.chunk import RrdReader

from sim.cli import main
from sim.recording import export


@pytest.mark.thorough
def test_a_hover_is_recorded_without_a_heading_and_told_with_its_velocities(tmp_path, capsys):
    file, out = tmp_path / "a.rrd", tmp_path / "a.npz"
    words = ["--robot", "hover", "--vertices", "40", "--samples", "10", "--max-time", "0.1", "--plant", "sde"]
    assert main(["run", "slit", *words, "--start", "1", "2.5", "--record", str(file)]) == 1
    assert main(["export", str(file), "-o", str(out)]) == 0
    table = np.load(out)
    step = 0.05
    np.testing.assert_allclose(
        table["end_vx"] - table["vx"], table["control_1"] * step + 0.1 * table["noise_1"], atol=0.05
    )
    assert table["vx"][0] == 0.0
    assert not {"heading", "state_3", "state_4"} & set(table.files)
    assert export.read(file).settings["states"] == "x y vx vy"
    turned = [chunk for chunk in RrdReader(str(file)).stream() if chunk.entity_path == "/world/robot"]
    quaternions = [
        q
        for chunk in turned
        for name, column in chunk.to_record_batch().to_pydict().items()
        if name.endswith("quaternion")
        for cell in column
        for q in cell or ()
    ]
    np.testing.assert_array_equal(quaternions, [[0.0, 0.0, 0.0, 1.0]] * 4)  # before, at 2 steps, at the end
