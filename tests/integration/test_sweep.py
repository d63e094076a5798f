"""Sweeps that are killed, stopped and taken up again come out as if nothing had happened."""

import json
from collections import Counter

import pytest
from mjcf_samples import WALL

from sim.cli import main
from sim.mjcf import load
from sim.sweeps import runs
from sim.sweeps.dataset import Dataset
from sim.sweeps.parts import RESULTS, key_of

QUICK = ["--plant", "sde", "--period", "0.1", "--max-time", "1", "--samples", "20", "--vertices", "100"]


def rows(folder) -> list[dict]:
    """Everything but timings, in the order of the keys."""
    found = [{name: record.get(name) for name in RESULTS} for record in Dataset(folder).records()]
    return sorted(found, key=lambda row: repr(key_of(row)))


def test_equal_seeds_meet_equal_noise_in_the_dataset_as_in_memory(tmp_path):
    """Processes of their own, trees that travel and files change nothing."""
    other = tmp_path / "other.xml"  # a second tree, which grows while the first is driven through
    other.write_text(load("slit").path.read_text())
    words = ["sweep", "slit", str(other), "--methods", "pi-rrht,passive", "--noise", "0.1,0.3", "--seeds", "0:2"]
    words += QUICK
    stored, direct = tmp_path / "stored.json", tmp_path / "direct.json"
    assert main([*words, "-o", str(tmp_path / "sweep"), "--json", str(stored), "--jobs", "2"]) == 0
    assert main([*words, "--json", str(direct), "--jobs", "1"]) == 0
    kept, found = ([{n: r.get(n) for n in RESULTS} for r in json.loads(f.read_text())] for f in (stored, direct))
    assert kept == found
    assert len(found) == 16
    labels = [row["scene"] for row in found]
    assert labels == sorted(labels, key=["slit", "other"].index)


def test_a_larger_grid_adds_runs_and_repeats_none(tmp_path, capsys):
    words = ["sweep", "slit", "--methods", "passive", "--jobs", "1", *QUICK, "-o", str(tmp_path / "sweep")]
    assert main([*words, "--noise", "0.1", "--seeds", "0:2"]) == 0
    before = {file: file.stat().st_mtime_ns for file in Dataset(tmp_path / "sweep").files()}
    capsys.readouterr()
    assert main([*words, "--noise", "0.1,0.2", "--seeds", "0:3"]) == 0
    assert capsys.readouterr().err == "2 of 6 runs are there already\n"
    assert all(file.stat().st_mtime_ns == time for file, time in before.items())
    found = Counter((row["noise"], row["seed"]) for row in rows(tmp_path / "sweep"))
    assert found == Counter({(noise, seed): 1 for noise in (0.1, 0.2) for seed in range(3)})


def test_a_run_that_crashes_is_a_row_and_the_others_go_on(tmp_path, capsys, monkeypatch):
    def drive(job, planned=None, *, real=runs.drive):
        if job.seed == 1:
            raise ZeroDivisionError("a wheel\ncame off")
        return real(job, planned)

    monkeypatch.setattr(runs, "drive", drive)
    words = ["sweep", "slit", "--methods", "passive", "--seeds", "0:3", "--jobs", "1", *QUICK]
    assert main([*words, "--json", str(tmp_path / "rows.json")]) == 1
    told = json.loads((tmp_path / "rows.json").read_text())
    assert [row["error"] for row in told] == [None, "ZeroDivisionError: a wheel came off", None]
    assert told[1]["outcome"] is None
    shown = capsys.readouterr()
    assert "error" in shown.out
    assert shown.err.splitlines() == ["1 run ended with an error:", "  1 x ZeroDivisionError: a wheel came off"]


def test_a_scene_without_a_way_gives_rows_with_the_reason_and_can_be_tried_again(tmp_path, capsys):
    wall = tmp_path / "wall.xml"
    wall.write_text(WALL)
    words = ["sweep", "slit", str(wall), "--methods", "pi-rrht,passive", "--seeds", "0:2", *QUICK]
    words += ["-o", str(tmp_path / "sweep")]
    assert main(words) == 1
    found = rows(tmp_path / "sweep")
    assert len(found) == 8
    for row in found:
        blocked = (row["scene"], row["method"]) == ("wall", "pi-rrht")
        assert (row["outcome"] is None) == blocked
        assert ("no path from (0.4, 2) to the goal is wide enough" in (row["error"] or "")) == blocked
    shown = capsys.readouterr()
    assert "8 runs, 2 of them ended with an error" in shown.out
    assert "  2 x no path from (0.4, 2) to the goal is wide enough" in shown.err
    assert "--again repeats them" in shown.err
    files = Dataset(tmp_path / "sweep").files()
    assert main([*words, "--again", "--jobs", "1"]) == 1
    assert rows(tmp_path / "sweep") == found
    assert Dataset(tmp_path / "sweep").files() != files


@pytest.mark.parametrize(
    ("words", "culprit"),
    [
        ("slit --again", "-o DIR"),
        ("slit slit", "slit twice"),
        ("slit --methods single,passive,single", "single twice"),
        ("slit --noise 0.1,0.2,0.10", "0.1 twice"),
        ("slit nosuch -o sweep", "nosuch"),
        ("slit --noise -1 -o sweep", "--noise is -1"),
        ("slit --noise a,b", "'a' is no number"),
        ("slit --noise nan", "--noise is nan"),
        ("slit --methods x", "--methods names 'x'"),
        ("crossing --methods pi-rrht,optimal --predict velocity -o sweep", "the optimal law knows how bodies move"),
        ("slit --seeds 5:1", "'5:1' holds no seed"),
        ("slit --seeds 0:1000000000000", "a sweep has 1000000 at most"),
        (f"slit --seeds 0:1{'0' * 30}", "the largest seed"),
        ("slit --jobs 0", "--jobs is 0"),
        ("slit --jobs 1000000000", "at most"),
        ("slit --scheduler foo", "foo: no scheduler answers there (missing port"),
        ("slit --scheduler tcp://127.0.0.1:x", "no scheduler answers there"),
    ],
)
def test_a_bad_sweep_is_refused_before_anything_is_written(words, culprit, tmp_path, monkeypatch, refused):
    if "--scheduler" in words:
        pytest.importorskip("distributed", reason="without it the command offers the extra")
    monkeypatch.chdir(tmp_path)
    refused(["sweep", *words.split()], culprit)
    assert not list(tmp_path.iterdir())
