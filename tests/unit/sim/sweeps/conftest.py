"""A sweep's folder with a clock that stands still."""

from pathlib import Path

import pytest
from sweep_samples import ASKED, SCENES, SETTINGS, Clock

from sim.sweeps.dataset import Dataset


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def dataset(tmp_path: Path, clock: Clock) -> Dataset:
    known = Dataset(tmp_path / "sweep", clock)
    known.begin(SETTINGS, SCENES, ASKED)
    return known
