"""Somebody stands in the only door: the robot waits, is reported to be blocked, and goes on; nobody is hit."""

import json

import pytest
from doors import door

from sim.cli import main

RUN = ("--noise", "0.05", "--period", "0.05", "--samples", "100", "--vertices", "600")


@pytest.mark.parametrize("stays", [False, True])
def test_the_robot_waits_for_who_stands_in_the_door_as_far_as_it_can_see(tmp_path, capsys, stays):
    file, result = door(tmp_path, stays=stays), tmp_path / "run.json"
    status = main(["run", file, *RUN, "--predict", "velocity", "--json", str(result)])
    drive, shown = json.loads(result.read_text()), capsys.readouterr()
    assert (status, drive["outcome"]) == ((1, "timeout") if stays else (0, "goal"))
    assert drive["min_clearance"] > 0.0
    begin, end = drive["blocked"][0][0], drive["blocked"][-1][1]
    assert 0.0 < begin < 2.5
    assert end == pytest.approx(7.0, abs=0.1) if stays else 5.5 < end < 8.0
    assert drive["blocked_time"] == pytest.approx(sum(b - a for a, b in drive["blocked"]))
    assert drive["fallbacks"] == pytest.approx(drive["blocked_time"] / 0.05)
    said = shown.out + shown.err
    assert f"blocked at {begin:.2f} s: no " in said
    assert "; braking" in said
    assert ("going on" in said) is not stays or drive["fallbacks"] > 0
