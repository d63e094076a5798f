"""A sweep on disk: whole files only, nothing lost, nothing twice, nothing mixed."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from repository import environment

from pirrht.errors import OptionError
from sim.cli import main
from sim.sweeps import dataset as module
from sim.sweeps.columns import COLUMNS, KEY, RESULTS, key_of, record_of, row_of
from sim.sweeps.dataset import Dataset, Unwritable, wished
from sim.sweeps.manifests import wishes

SETTINGS = {"samples": 50, "robot": None, "start": (1.0, 2.0)}
SCENES = {"slit": "0123"}
ASKED = {"methods": ["pi-rrht"], "noise": {"slit": [0.1]}, "seeds": [0, 9]}


class Clock:
    def __init__(self) -> None:
        self.time = 1000.0

    def __call__(self) -> float:
        return self.time


def record(seed: int, **changes) -> dict:
    known = dict.fromkeys(RESULTS)
    known |= {"scene": "slit", "scene_digest": "0123", "method": "pi-rrht", "noise": 0.1, "plan_seed": 0}
    known |= {"seed": seed, "outcome": "goal", "cost": 8.0 + seed, "executed_class": "0,0", "steps": 3}
    known |= {"step_ms": {"median": 1.0, "p95": 2.0, "max": 3.0}, "deadline_misses": 1, "plan_seconds": None}
    return {**known, "drive_seconds": 0.5, **changes}


def failed(seed: int) -> dict:
    return {**{name: record(seed)[name] for name in KEY}, "outcome": None, "error": "ValueError: no"}


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def dataset(tmp_path: Path, clock: Clock) -> Dataset:
    known = Dataset(tmp_path / "sweep", clock)
    known.begin(SETTINGS, SCENES, ASKED)
    return known


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
    dataset.tend()
    assert dataset.files() == []
    clock.time += module.CHUNK_SECONDS
    dataset.add(record(1))
    dataset.tend()
    assert [r["seed"] for r in dataset.records()] == [0, 1]
    for seed in range(2, 2 + module.CHUNK_RUNS):
        dataset.add(record(seed))
    dataset.tend()
    assert len(dataset.files()) == 2
    assert len(dataset.records()) == module.CHUNK_RUNS + 2


def test_a_run_that_is_in_two_files_counts_once(dataset):
    for _ in range(2):
        dataset.add(record(0))
        dataset.flush()
    assert len(dataset.files()) == 2
    assert dataset.records() == [record(0)]


def test_a_later_sweep_adds_files_and_takes_none_away(dataset, clock):
    dataset.add(record(0))
    dataset.flush()
    later = Dataset(dataset.folder, clock)
    later.begin(SETTINGS, SCENES, {**ASKED, "seeds": [5, 20]})
    later.add(record(1))
    later.flush()
    assert [r["seed"] for r in later.records()] == [0, 1]
    assert wished(later.manifest()["asked"]) == 20


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


@pytest.mark.slow
def test_processes_that_write_at_once_lose_nothing(dataset):
    script = "import sys\nfrom pathlib import Path\nfrom sim.sweeps.dataset import Dataset\n"
    script += f"d, known = Dataset(Path({str(dataset.folder)!r})), {record(0)!r}\n"
    script += "for seed in range(int(sys.argv[1]), int(sys.argv[1]) + 20):\n"
    script += "    d.add({**known, 'seed': seed})\n    d.flush()\n"
    command = [sys.executable, "-c", script]
    writers = [subprocess.Popen([*command, str(first)], env=environment()) for first in (0, 100)]
    assert [writer.wait() for writer in writers] == [0, 0]
    assert sorted(r["seed"] for r in dataset.records()) == [*range(20), *range(100, 120)]
    assert len(dataset.files()) == 40


def test_without_hard_links_and_locks_files_are_still_not_overwritten(dataset, monkeypatch):
    def refused(*_: object) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "link", refused)
    for seed in range(2):
        later = Dataset(dataset.folder)
        later.add(record(seed))
        later.flush()
    assert [r["seed"] for r in dataset.records()] == [0, 1]


def test_runs_are_replaced_by_what_was_added(dataset):
    for seed in range(4):
        dataset.add(record(seed))
        if seed % 2:
            dataset.flush()
    for seed in (1, 2):
        dataset.add(record(seed, cost=99.0))
    dataset.replace({key_of(record(seed)) for seed in (1, 2)})
    assert {r["seed"]: r["cost"] for r in dataset.records()} == {0: 8.0, 1: 99.0, 2: 99.0, 3: 11.0}


def test_another_may_ask_while_a_sweep_is_under_way(dataset):
    (dataset.folder / ".trees-x").mkdir()
    (dataset.runs / ".part-1").write_bytes(b"PAR1 half")
    Dataset(dataset.folder).ask(SETTINGS, SCENES, wishes("mine", "slit", 0.1, [3, 4, 7]))
    assert (dataset.folder / ".trees-x").exists()
    assert (dataset.runs / ".part-1").exists()
    assert wished(dataset.manifest()["asked"]) == 9 + 3
    assert [wish["seeds"] for wish in dataset.manifest()["asked"][1:]] == [[3, 5], [7, 8]]


def test_what_a_killed_sweep_left_half_written_is_cleared_away(dataset, clock):
    (dataset.runs / ".part-000000.parquet").write_bytes(b"PAR1 half")
    (dataset.folder / ".manifest.json").write_text("{")
    (dataset.folder / ".trees-x").mkdir()
    (dataset.folder / ".trees-x" / "0.tree").write_bytes(b"half")
    assert Dataset(dataset.folder, clock).records() == []
    Dataset(dataset.folder, clock).begin(SETTINGS, SCENES, ASKED)
    assert not list(dataset.runs.iterdir())
    assert sorted(file.name for file in dataset.folder.iterdir()) == ["manifest.json", "runs"]


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
        Dataset(dataset.folder).check(settings, scenes)
    assert difference in str(caught.value)
    Dataset(dataset.folder).check(SETTINGS, {**SCENES, "new": "89"})


def test_another_version_of_the_program_is_refused(dataset, monkeypatch):
    monkeypatch.setattr(module.pirrht, "__version__", "9.9")
    with pytest.raises(OptionError, match=r"pirrht 0.* and this is 9\.9"):
        Dataset(dataset.folder).check(SETTINGS, SCENES)


def test_a_folder_of_something_else_and_a_file_are_refused(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(OptionError, match=r"letter\.txt"):
        Dataset(tmp_path).check({}, {})
    with pytest.raises(OptionError, match="is a file"):
        Dataset(tmp_path / "letter.txt").check({}, {})


@pytest.mark.parametrize("content", ["", "{", "[]", '{"format": 99}', "[" * 100_000, "\udcff", '{"format": 1}'])
def test_a_damaged_manifest_costs_one_line(dataset, content):
    (dataset.folder / "manifest.json").write_text(content, errors="surrogateescape")
    with pytest.raises(OptionError, match=r"manifest\.json"):
        Dataset(dataset.folder).check(SETTINGS, SCENES)


ODD = [
    *({name: None} for name in ("version", "libraries", "settings", "scenes", "asked")),
    {"settings": []},
    {"scenes": {"slit": 3}},
    {"libraries": {"numpy": {}}},
    {"asked": ["all"]},
    {"asked": [{"methods": ["single"], "seeds": [0, 3]}]},
    {"asked": [{**ASKED, "methods": "single"}]},
    {"asked": [{**ASKED, "noise": {"slit": 0.1}}]},
    {"asked": [{**ASKED, "noise": {"slit": ["loud"]}}]},
    {"asked": [{**ASKED, "seeds": [0]}]},
    {"asked": [{**ASKED, "seeds": [0, 10**15]}]},
    {"asked": [{**ASKED, "seeds": [0.5, 3]}]},
]


@pytest.mark.parametrize("change", ODD, ids=str)
@pytest.mark.parametrize("command", ["report", "sweep slit --seeds 0:1 --vertices 60 --max-time 0.02 -o"])
def test_an_odd_manifest_costs_one_line_and_status_2(dataset, capsys, change, command):
    file = dataset.folder / "manifest.json"
    known = {**json.loads(file.read_text()), **change}
    file.write_text(json.dumps({name: value for name, value in known.items() if value is not None}))
    assert main([*command.split(), str(dataset.folder)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "manifest.json is damaged: " in error
    assert next(iter(change)) in error


def test_rows_without_a_key_are_a_damaged_file(dataset, capsys):
    dataset.add({**record(0), "method": None})
    dataset.flush()
    assert main(["report", str(dataset.folder)]) == 2
    assert "part-000000.parquet cannot be read (it has rows without method)" in capsys.readouterr().err


def test_a_damaged_file_of_rows_is_named_with_the_remedy(dataset):
    (dataset.runs / "part-000000.parquet").write_bytes(b"PAR1 half")
    with pytest.raises(OptionError, match=r"part-000000\.parquet cannot be read .* remove it"):
        dataset.records()


def test_runs_that_ended_with_an_error_can_be_forgotten(dataset):
    for part in ([record(0), failed(1)], [failed(2)], [record(3)]):
        for one in part:
            dataset.add(one)
        dataset.flush()
    dataset.forget_errors()
    assert dataset.records() == [record(0), record(3)]
    assert len(dataset.files()) == 2


def test_a_folder_has_one_writer_at_a_time_and_a_dead_one_keeps_nobody_out(tmp_path):
    pytest.importorskip("fcntl")
    script = "from pathlib import Path\nfrom sim.sweeps.dataset import Dataset\nimport os\n"
    script += f"d = Dataset(Path({str(tmp_path)!r}))\nwith d.locked():\n    print('in', flush=True)\n    os.read(0, 1)"
    holder = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment()
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == b"in\n"
    with pytest.raises(OptionError, match="another sweep is writing"), Dataset(tmp_path).locked():
        pass
    holder.kill()
    holder.communicate()
    with Dataset(tmp_path).locked():
        pass


class FullDisk:
    """Every write fails until there is room again."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full, self._fsync = True, os.fsync
        monkeypatch.setattr(module.os, "fsync", self)

    def __call__(self, handle: int) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._fsync(handle)


def test_a_full_disk_loses_no_finished_run_if_it_is_mended(dataset, clock, monkeypatch):
    disk = FullDisk(monkeypatch)
    dataset.add(record(0))
    clock.time += module.CHUNK_SECONDS
    dataset.tend()
    assert dataset.failing
    assert list(dataset.runs.iterdir()) == []
    disk.full = False
    dataset.add(record(1))
    clock.time += module.CHUNK_SECONDS
    dataset.tend()
    assert not dataset.failing
    assert [r["seed"] for r in dataset.records()] == [0, 1]


def test_a_disk_that_stays_full_ends_the_sweep_and_says_how_many_runs_wait(dataset, clock, monkeypatch):
    FullDisk(monkeypatch)
    dataset.add(record(0))

    def wait_for_ever():
        for _ in range(1000):
            clock.time += 1.0
            dataset.tend()

    with pytest.raises(Unwritable, match="No space left on device; 1 finished runs could not be written"):
        wait_for_ever()
    assert clock.time <= 1000.0 + module.PATIENCE + 2 * module.CHUNK_SECONDS + 2.0


@pytest.mark.root
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root mounts file systems")
def test_a_file_system_that_is_full_keeps_its_whole_files(tmp_path, clock):
    small = tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(small)]
    if subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("mounting is not allowed here")
    try:
        dataset = Dataset(small / "sweep", clock)
        dataset.begin(SETTINGS, SCENES, ASKED)
        dataset.add(record(0))
        dataset.flush()
        (small / "ballast").write_bytes(b"x" * (os.statvfs(small).f_bavail * 4096 - 4096))
        dataset.add(record(1))
        with pytest.raises(Unwritable, match="No space left"):
            dataset.flush()
        assert dataset.records() == [record(0)]
        (small / "ballast").unlink()
        dataset.flush()
        assert dataset.records() == [record(0), record(1)]
    finally:
        subprocess.run(["umount", "--lazy", str(small)], check=True)  # a helper may still be at its end there


def test_the_key_is_part_of_the_results_and_timings_are_not():
    assert set(KEY) < set(RESULTS)
    assert key_of(record(4))[4] == 4
    assert not [name for name in RESULTS if "second" in name or "_ms" in name]
    json.dumps(record(4))
