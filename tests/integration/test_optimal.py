"""The grid's law as a driver, and `--truth`."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sim.cli import main


def test_run_reports_the_exact_value(tmp_path, capsys):
    out = tmp_path / "run.json"
    status = main(["run", "slit", "--method", "optimal", "--noise", "0.3", "--json", str(out)])
    result = json.loads(out.read_text())
    assert status == (0 if result["outcome"] == "goal" else 1)
    assert result["value_estimate"] == pytest.approx(9.535, abs=0.002)
    assert result["fallbacks"] == result["class_switches"] == 0
    assert result["method"] == "optimal"
    assert capsys.readouterr().out


def test_what_the_grid_cannot_do_ends_with_one_line(capsys):
    assert main(["run", "clutter", "--method", "optimal"]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "0.03" in message


def test_a_sweep_refuses_before_it_drives(capsys):
    assert main(["sweep", "slit", "--methods", "optimal", "--noise", "0.2,0.01", "--seeds", "0:2", "--jobs", "1"]) == 2
    assert "choose more noise" in capsys.readouterr().err


def test_truth_adds_the_exact_value_control_and_errors(tmp_path, capsys):
    out = tmp_path / "estimate.json"
    arguments = ["estimate", "slit", "--noise", "0.3", "--at", "2.2", "2.6", "--repeat", "2", "--vertices", "300"]
    assert main([*arguments, "--truth", "--json", str(out)]) == 0
    result = json.loads(out.read_text())
    assert result["truth"]["value"] == pytest.approx(7.479, abs=0.002)
    assert result["truth"]["control"] == pytest.approx([0.7695, 0.1987], abs=0.002)
    for value, control, off, away in zip(
        result["value"], result["control"], result["value_error"], result["control_error"], strict=True
    ):
        assert off == pytest.approx(value - result["truth"]["value"])
        assert away == pytest.approx(np.linalg.norm(np.subtract(control, result["truth"]["control"])))
    assert "truth" in capsys.readouterr().out


def test_nothing_is_estimated_without_samples(capsys):
    assert main(["estimate", "slit", "--method", "optimal", "--at", "2", "2"]) == 2
    assert "--truth" in capsys.readouterr().err
