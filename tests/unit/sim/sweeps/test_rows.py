"""A run's record is the same after it has been a row of a Parquet file."""

from __future__ import annotations

import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from sim.sweeps.dataset import Dataset
from sim.sweeps.parts import COLUMNS, KEY, record_of, row_of

CELLS = {
    "string": st.text(st.characters(exclude_categories=["Cs"]), max_size=8),
    "int64": st.integers(-(2**63), 2**63 - 1),
    "float64": st.floats(allow_nan=False),
}
NEEDED = ("scene", "method", "noise", "seed")  # by which a run is known
ROWS = st.fixed_dictionaries(
    {c.name: CELLS[c.kind] if c.name in NEEDED else st.one_of(st.none(), CELLS[c.kind]) for c in COLUMNS}
)


@settings(max_examples=12)
@given(st.lists(ROWS, max_size=5, unique_by=lambda row: tuple(row[name] for name in KEY)))
def test_records_survive_the_file(rows):
    records = [record_of(row) for row in rows]
    with tempfile.TemporaryDirectory() as folder:
        dataset = Dataset(Path(folder))
        dataset.begin({}, {}, {})
        for record in records:
            dataset.add(record)
        dataset.flush()
        assert Dataset(Path(folder)).records() == records


@settings(max_examples=50)
@given(ROWS)
def test_a_row_survives_the_record_unless_its_run_has_failed(row):
    again = row_of(record_of(row))
    known = {name for name in row if row["outcome"] is not None or name in (*KEY, "error")}
    assert {name: again[name] for name in known} == {name: row[name] for name in known}
