"""A sweep on disk: whole files only, nothing lost, nothing twice, nothing mixed."""

import numpy as np
from sweep_samples import ASKED, SCENES, SETTINGS, failed, record

from sim.sweeps import dataset as module
from sim.sweeps.dataset import Dataset, wished
from sim.sweeps.parts import COLUMNS, record_of, row_of


def test_a_record_comes_back_as_it_was():
    assert record_of(row_of(record(3))) == record(3)
    assert record_of(row_of(failed(3))) == failed(3)


def test_a_row_is_read_back_with_unit_and_description_of_every_column(dataset):
    import pyarrow.parquet as pq

    dataset.add(record(1, value_estimate=float("inf")))
    dataset.flush()
    table = pq.read_table(dataset.runs)
    assert table.schema.names == [column.name for column in COLUMNS]
    for column in COLUMNS:
        assert column.text
        about = table.schema.field(column.name).metadata
        assert about == {b"unit": column.unit.encode(), b"description": column.text.encode()}
    assert dataset.records() == [record(1, value_estimate=float("inf"))]


def test_rows_are_written_when_their_time_has_come_and_in_files_of_their_own(dataset, clock):
    dataset.add(record(0))
    dataset.add()
    assert dataset.files() == []
    clock.time += module.CHUNK_SECONDS
    dataset.add(record(1))
    dataset.add()
    assert [r["seed"] for r in dataset.records()] == [0, 1]
    for seed in range(2, 2 + module.CHUNK_RUNS):
        dataset.add(record(seed))
    dataset.add()
    assert len(dataset.files()) == 2
    assert len(dataset.records()) == module.CHUNK_RUNS + 2


def test_a_run_that_is_in_two_files_counts_once_as_in_the_last_until_one_file_holds_all(dataset):
    for part in ([record(0), failed(1)], [failed(2), record(3)], [record(0, cost=99.0), record(1)]):
        for one in part:
            dataset.add(one)
        dataset.flush()
    found = dataset.records()
    assert sorted(found, key=lambda r: r["seed"]) == [record(0, cost=99.0), record(1), failed(2), record(3)]
    dataset.compact()
    assert len(dataset.files()) == 1
    assert dataset.records() == found


def test_a_later_sweep_adds_files_and_takes_none_away(dataset, clock):
    dataset.add(record(0))
    dataset.flush()
    later = Dataset(dataset.folder, clock)
    later.begin(SETTINGS, SCENES, {**ASKED, "seeds": [5, 20]})
    later.add(record(1))
    later.flush()
    assert [r["seed"] for r in later.records()] == [0, 1]
    assert wished(later.manifest()["asked"]) == 20


def test_a_library_without_metadata_is_of_an_unknown_version(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "LIBRARIES", ("numpy", "no-such-library"))
    sweep = Dataset(tmp_path / "sweep")
    sweep.begin(SETTINGS, SCENES, ASKED)
    assert sweep.manifest()["libraries"] == {"numpy": np.__version__, "no-such-library": "unknown"}


def test_files_of_others_are_never_overwritten(dataset, clock):
    """Neither by one who has not begun a sweep there, nor by two at once, nor because of a number that is missing."""
    (dataset.runs / "part-copy.parquet").write_bytes(b"")
    writers = [Dataset(dataset.folder, clock) for _ in range(3)]
    for round_ in range(2):
        for i, writer in enumerate(writers):
            writer.add(record(10 * round_ + i))
        for writer in writers:
            writer.flush()
    (dataset.runs / "part-copy.parquet").unlink()
    assert sorted(r["seed"] for r in dataset.records()) == [0, 1, 2, 10, 11, 12]
    dataset.files()[0].unlink()
    writers[0].add(record(30))
    writers[0].flush()
    assert [r["seed"] for r in dataset.records()] == [1, 2, 10, 11, 12, 30]


def test_what_a_killed_sweep_left_half_written_is_cleared_away(dataset, clock):
    (dataset.runs / ".part-000000.parquet").write_bytes(b"PAR1 half")
    (dataset.folder / ".manifest.json").write_text("{")
    (dataset.folder / ".trees-x").mkdir()
    (dataset.folder / ".trees-x" / "0.tree").write_bytes(b"half")
    assert Dataset(dataset.folder, clock).records() == []
    Dataset(dataset.folder, clock).begin(SETTINGS, SCENES, ASKED)
    assert not list(dataset.runs.iterdir())
    assert sorted(file.name for file in dataset.folder.iterdir()) == ["manifest.json", "runs"]
