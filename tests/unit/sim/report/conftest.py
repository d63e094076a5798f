"""A sweep whose shares and means one counts by hand."""

from pathlib import Path

import pytest
from report_samples import record, stored

from sim.sweeps.dataset import Dataset


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    """40 seeds: passive fails where the seed is no multiple of 4; pi-rrht costs a tenth more than the optimum."""
    records = []
    for seed in range(40):
        records.append(record("pi-rrht", seed, cost=1.1 * (8.0 + 0.1 * seed)))
        records.append(record("optimal", seed, cost=8.0 + 0.1 * seed))
        records.append(record("passive", seed, "goal" if seed % 4 == 0 else ("collision", "timeout")[seed % 2]))
    records[0] |= {"outcome": None, "error": "ValueError: a | b"}
    return stored(tmp_path / "sweep", records)
