"""A sweep on disk: whole files only, nothing lost, twice or mixed; what is damaged is refused or mended."""

import errno
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from repository import environment
from sweep_samples import failed, record

from pirrht.errors import OptionError
from sim.sweeps import dataset as module
from sim.sweeps.dataset import Dataset, wished
from sim.sweeps.parts import COLUMNS

SETTINGS = {"samples": 50, "robot": None, "start": (1.0, 2.0)}
SCENES = {"slit": "0123"}
ASKED = {"methods": ["pi-rrht"], "noise": {"slit": [0.1]}, "seeds": [0, 9]}


class Clock:
    """One that stands still."""

    time = 1000.0

    def __call__(self) -> float:
        return self.time


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def dataset(tmp_path, clock: Clock) -> Dataset:
    known = Dataset(tmp_path / "sweep", clock)
    known.begin(SETTINGS, SCENES, ASKED)
    return known


def seeds(dataset: Dataset) -> list[int]:
    return [r["seed"] for r in dataset.records()]


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
    assert dataset.files() == []
    clock.time += module.CHUNK_SECONDS
    dataset.add(record(1))
    assert seeds(dataset) == [0, 1]
    for seed in range(2, 2 + module.CHUNK_RUNS):
        dataset.add(record(seed))
    assert (len(dataset.files()), len(dataset.records())) == (2, module.CHUNK_RUNS + 2)


def test_a_run_that_is_in_two_files_counts_once_as_in_the_last_until_one_file_holds_all(dataset):
    for part in ([record(0), failed(1)], [failed(2), record(3)], [record(0, cost=99.0), record(1)]):
        for one in part:
            dataset.add(one)
        dataset.flush()
    found = dataset.records()
    assert sorted(found, key=lambda r: r["seed"]) == [record(0, cost=99.0), record(1), failed(2), record(3)]
    dataset.compact()
    assert (len(dataset.files()), dataset.records()) == (1, found)


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
    assert sorted(seeds(dataset)) == [0, 1, 2, 10, 11, 12]
    dataset.files()[0].unlink()
    writers[0].add(record(30))
    writers[0].flush()
    assert seeds(dataset) == [1, 2, 10, 11, 12, 30]


def test_a_sweep_writes_through_no_link_of_a_folder_that_somebody_sent(dataset, tmp_path):
    victim, manifest = tmp_path / "victim", dataset.file.read_bytes()
    victim.write_bytes(manifest)
    dataset.file.unlink()
    dataset.file.symlink_to(victim)
    dataset.begin(SETTINGS, SCENES, {**ASKED, "seeds": [0, 20]})
    assert victim.read_bytes() == manifest
    assert not dataset.file.is_symlink()
    (dataset.folder / ".lock").symlink_to(tmp_path / "made")
    with pytest.raises(OptionError, match="--output"), dataset.locked():
        pass
    assert not (tmp_path / "made").exists()
    dataset.runs.rename(tmp_path / "elsewhere")
    dataset.runs.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OptionError, match="writes through none"):
        dataset.begin(SETTINGS, SCENES, ASKED)


def test_a_later_sweep_takes_away_what_a_killed_one_left_half_written_and_nothing_else(dataset, monkeypatch):
    monkeypatch.setattr(module, "LIBRARIES", ("numpy", "no-such-library"))
    dataset.add(record(0))
    dataset.flush()
    (dataset.runs / ".part-000000.parquet").write_bytes(b"PAR1 half")
    (dataset.folder / ".manifest.json").write_text("{")
    (dataset.folder / ".trees-x").mkdir()
    (dataset.folder / ".trees-x" / "0.tree").write_bytes(b"half")
    assert seeds(dataset) == [0]
    later = Dataset(dataset.folder)
    later.begin(SETTINGS, SCENES, {**ASKED, "seeds": [5, 20]})
    assert list(dataset.runs.iterdir()) == dataset.files()
    assert sorted(file.name for file in dataset.folder.iterdir()) == ["manifest.json", "runs"]
    assert seeds(later) == [0]
    assert wished(later.manifest()["asked"]) == 20
    assert later.manifest()["libraries"] == {"numpy": np.__version__, "no-such-library": "unknown"}


@pytest.mark.parametrize(
    ("settings", "scenes", "difference"),
    [
        ({**SETTINGS, "samples": 60}, SCENES, "with --samples 50 and this sweep is with --samples 60"),
        ({**SETTINGS, "samples": None}, SCENES, "with --samples 50 and this sweep is without --samples"),
        ({**SETTINGS, "max_time": 3.0}, SCENES, "without --max-time and this sweep is with --max-time 3.0"),
        ({**SETTINGS, "start": (1.0, 3.0)}, SCENES, "--start 1.0 2.0"),
        (SETTINGS, {"slit": "4567"}, "another slit"),
    ],
)
def test_a_sweep_under_other_settings_is_refused_with_the_difference(dataset, settings, scenes, difference):
    with pytest.raises(OptionError, match="choose another folder") as caught:
        dataset.check(settings, scenes)
    assert difference in str(caught.value)
    dataset.check(SETTINGS, {**SCENES, "new": "89"})


def test_another_version_of_the_program_opens_a_dataset_of_its_format_and_refuses_others(dataset, monkeypatch):
    monkeypatch.setattr(module.pirrht, "__version__", "9.9")
    dataset.check(SETTINGS, SCENES)
    monkeypatch.setattr(module.parts, "DATASET_FORMAT", 99)
    with pytest.raises(OptionError, match=r"pirrht 9\.9 reads format 99"):
        dataset.check(SETTINGS, SCENES)


def test_a_folder_of_something_else_and_a_file_are_refused(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    for folder, why in ((tmp_path, r"letter\.txt"), (tmp_path / "letter.txt", "is a file")):
        with pytest.raises(OptionError, match=why):
            Dataset(folder).check({}, {})


ODD = [
    *({name: None} for name in ("version", "libraries", "settings", "scenes", "asked")),
    *({"settings": []}, {"scenes": {"slit": 3}}, {"libraries": {"numpy": {}}}, {"asked": ["all"]}),
    *({"asked": [{**ASKED, "seeds": odd}]} for odd in ([0], [0, 10**15], [0.5, 3])),
    *({"asked": [{**ASKED, "noise": odd}]} for odd in (None, {"slit": 0.1}, {"slit": ["loud"]})),
    {"asked": [{**ASKED, "methods": "single"}]},
]


@pytest.mark.parametrize("change", ODD, ids=str)
@pytest.mark.parametrize("command", ["report", "sweep slit --seeds 0:1 --vertices 60 --max-time 0.02 -o"])
def test_an_odd_manifest_costs_one_line_and_status_2(dataset, refused, change, command):
    known = {**json.loads(dataset.file.read_text()), **change}
    dataset.file.write_text(json.dumps({name: value for name, value in known.items() if value is not None}))
    refused([*command.split(), str(dataset.folder)], "manifest.json is damaged: ", next(iter(change)))


def test_a_folder_has_one_writer_at_a_time_and_a_dead_one_keeps_nobody_out(tmp_path):
    script = "from pathlib import Path\nfrom sim.sweeps.dataset import Dataset\nimport os\n"
    script += f"d = Dataset(Path({str(tmp_path)!r}))\nwith d.locked():\n    print('in', flush=True)\n    os.read(0, 1)"
    holder = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment()
    )
    assert holder.stdout.readline() == b"in\n"
    with pytest.raises(OptionError, match="another sweep is writing"), Dataset(tmp_path).locked():
        pass
    holder.kill()
    holder.communicate()
    with Dataset(tmp_path).locked():
        pass


def test_a_full_disk_loses_no_finished_run_if_it_is_mended_and_says_how_many_wait(dataset, clock, monkeypatch):
    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for seed in range(2):
        with monkeypatch.context() as disk:
            disk.setattr(os, "fsync", full)
            clock.time += module.CHUNK_SECONDS
            assert dataset.add(record(seed))  # it says so once
            assert not dataset.add()
            assert len(list(dataset.runs.iterdir())) == seed
            with pytest.raises(OptionError, match="No space left on device; 1 finished runs could not be written"):
                dataset.flush()
        clock.time += module.CHUNK_SECONDS
        dataset.add()
        assert seeds(dataset) == list(range(seed + 1))
