"""A tree that grows between two plans shows how far it is, and does not grow without end."""

from __future__ import annotations

import io

import pytest

from sim.cli import main, shared
from sim.drive import episode
from sim.scenario import Scenario

SHORT = ["run", "slit", "--vertices", "50", "--samples", "20", "--max-time", "0.02", "--grow", "200"]


class Terminal(io.StringIO):
    """What progress bars are shown on."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("terminal", [True, False])
def test_a_drive_that_waits_for_its_tree_reports_so(terminal, monkeypatch, capsys):
    stream = Terminal() if terminal else io.StringIO()
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setattr(shared, "PAUSE", 0.0)
    assert main(SHORT) == 1
    assert "the drive waits while the tree of 50 vertices grows" in capsys.readouterr().out
    assert ("the tree grows: " in stream.getvalue()) == terminal


def test_a_tree_stops_growing_when_it_fills_the_memory(slit: Scenario, monkeypatch):
    monkeypatch.setattr(episode, "MOST_VERTICES", 100)
    scenario = slit.with_settings(vertices=50, samples=20, grow=40, max_time=0.03)
    frames = list(scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())))
    assert [frame.vertices for frame in frames] == [50, 90, 100]
