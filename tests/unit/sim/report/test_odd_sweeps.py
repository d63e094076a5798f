"""Reports of sweeps that are unfinished, empty, damaged or too small."""

import pytest
from report_samples import record, stored

from sim.cli import main
from sim.report import wording
from sim.report.summary import report


def test_a_sweep_of_errors_alone_tells_how_many_there_were_of_each(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    failed = [record(method, seed, None) for method in ("pi-rrht", "single") for seed in range(3)]
    for number, one in enumerate(failed):
        one["error"] = "no way" if number else "a lost wheel"
    dataset = stored(tmp_path / "sweep", failed)
    assert main(["report", str(dataset.folder)]) == 0
    told = capsys.readouterr().out
    for shown in (told, (dataset.folder / "report.md").read_text(), (dataset.folder / "report.html").read_text()):
        assert "6 runs ended with an error" in shown
        assert "5 x no way" in shown
        assert "1 x a lost wheel" in shown
        assert "No comparison" in shown
        assert "<img" not in shown


@pytest.mark.parametrize(("seeds", "hopeless"), [(5, True), (6, True), (7, False)])
def test_too_few_seeds_for_any_finding_are_said_to_be_too_few(seeds, hopeless, tmp_path):
    """Two questions: twice McNemar's 2 / 2^n falls below 0.05 from n = 7 on."""
    same = [record(method, seed) for method in ("pi-rrht", "single") for seed in range(seeds)]
    known = report(stored(tmp_path / "sweep", same))
    assert known["least_p"] == pytest.approx(4 * 0.5**seeds)
    told = " ".join(wording.findings(known))
    assert "None of 2 comparisons" in told
    assert ("It takes at least 7 pairs" in told) == hopeless


def test_an_unfinished_sweep_is_reported_as_such(tmp_path, capsys):
    dataset = stored(tmp_path / "sweep", [record("pi-rrht", 0)])
    assert main(["report", str(dataset.folder), "-o", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "1 of 120 runs" in told
    assert "unfinished" in told
    assert "No comparison" in told
    assert (tmp_path / "report.md").exists()
    assert not (dataset.folder / "report.md").exists()


def test_a_sweep_without_a_single_run_has_a_report(tmp_path, capsys):
    dataset = stored(tmp_path / "sweep", [])
    assert main(["report", str(dataset.folder)]) == 0
    told = capsys.readouterr().out
    assert "0 of 120 runs" in told
    assert "No comparison" in told


@pytest.mark.parametrize("damage", ["cut off", "empty", "other bytes"])
def test_a_part_that_cannot_be_read_is_named_in_one_line(damage, dataset, capsys):
    part = dataset.files()[0]
    content = part.read_bytes()
    part.write_bytes({"cut off": content[:300], "empty": b"", "other bytes": bytes(b ^ 85 for b in content)}[damage])
    assert main(["report", str(dataset.folder)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert f"{part} cannot be read" in told
    assert not (dataset.folder / "report.md").exists()


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"scene": None}, "rows without scene"),
        ({"noise": None}, "rows without noise"),
        ({"outcome": "flew"}, "no usable outcome"),
        ({"cost": None}, "seed 1 has no usable cost"),
        ({"path_length": float("inf")}, "no usable path_length"),
    ],
)
def test_rows_that_no_sweep_wrote_are_refused_by_run_and_column(changes, what, tmp_path, capsys):
    dataset = stored(tmp_path / "sweep", [record("pi-rrht", 0), record("pi-rrht", 1, **changes)])
    assert main(["report", str(dataset.folder)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert what in told
