"""A folder of a sweep that is damaged, another's, or on a full disk is refused or mended, and no run is lost."""

import errno
import json
import os
import subprocess
import sys

import pytest
from repository import environment
from sweep_samples import ASKED, SCENES, SETTINGS, record

from pirrht.errors import OptionError
from sim.cli import main
from sim.sweeps import dataset as module
from sim.sweeps.dataset import Dataset


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


def test_another_version_of_the_program_opens_a_dataset_of_its_format_and_refuses_others(dataset, monkeypatch):
    monkeypatch.setattr(module.pirrht, "__version__", "9.9")
    Dataset(dataset.folder).check(SETTINGS, SCENES)
    monkeypatch.setattr(module.parts, "DATASET_FORMAT", 99)
    with pytest.raises(OptionError, match=r"pirrht 9\.9 reads format 99"):
        Dataset(dataset.folder).check(SETTINGS, SCENES)


def test_a_folder_of_something_else_and_a_file_are_refused(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(OptionError, match=r"letter\.txt"):
        Dataset(tmp_path).check({}, {})
    with pytest.raises(OptionError, match="is a file"):
        Dataset(tmp_path / "letter.txt").check({}, {})


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


def test_a_damaged_file_of_rows_is_named_with_the_remedy(dataset):
    (dataset.runs / "part-000000.parquet").write_bytes(b"PAR1 half")
    with pytest.raises(OptionError, match=r"part-000000\.parquet cannot be read .* remove it"):
        dataset.records()


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


def test_a_full_disk_loses_no_finished_run_if_it_is_mended_and_says_how_many_wait(dataset, clock, monkeypatch):
    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for seed in range(2):
        with monkeypatch.context() as disk:
            disk.setattr(os, "fsync", full)
            dataset.add(record(seed))
            clock.time += module.CHUNK_SECONDS
            dataset.add()
            assert dataset.failing
            assert len(list(dataset.runs.iterdir())) == seed
            with pytest.raises(OptionError, match="No space left on device; 1 finished runs could not be written"):
                dataset.flush()
        clock.time += module.CHUNK_SECONDS
        dataset.add()
        assert not dataset.failing
        assert [r["seed"] for r in dataset.records()] == list(range(seed + 1))
