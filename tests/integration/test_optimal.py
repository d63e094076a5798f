"""The grid's law as a driver, and `--truth`."""

import json

import numpy as np
import pytest

from sim.cli import main


def test_run_reports_the_exact_value_and_is_recorded(tmp_path):
    out, record = tmp_path / "run.json", tmp_path / "run.rrd"
    words = ["run", "slit", "--method", "optimal", "--noise", "0.3", "--json"]
    status = main([*words, str(out), "--record", str(record)])
    assert record.stat().st_size > 0
    result = json.loads(out.read_text())
    assert status == (0 if result["outcome"] == "goal" else 1)
    assert result["value_estimate"] == pytest.approx(9.535, abs=0.002)
    assert (result["method"], result["fallbacks"], result["class_switches"]) == ("optimal", 0, 0)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("run clutter --method optimal", "0.03"),
        ("sweep slit --methods optimal --noise 0.2,0.01 --seeds 0:2 --jobs 1", "choose more noise"),
        ("estimate slit --method optimal --at 2 2", "--truth"),
    ],
)
def test_what_the_grid_cannot_do_ends_with_one_line(words, what, capsys):
    assert main(words.split()) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert what in message


def test_truth_adds_the_exact_value_control_and_errors(tmp_path, capsys):
    out = tmp_path / "estimate.json"
    words = "estimate slit --noise 0.3 --at 2.2 2.6 --repeat 2 --vertices 300 --truth --json"
    assert main([*words.split(), str(out)]) == 0
    found = json.loads(out.read_text())
    assert found["truth"]["value"] == pytest.approx(7.479, abs=0.002)
    assert found["truth"]["control"] == pytest.approx([0.7695, 0.1987], abs=0.002)
    assert found["value_error"] == pytest.approx(np.subtract(found["value"], found["truth"]["value"]))
    off = np.linalg.norm(np.subtract(found["control"], found["truth"]["control"]), axis=1)
    assert found["control_error"] == pytest.approx(off)
    assert "truth" in capsys.readouterr().out
