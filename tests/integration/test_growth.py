"""A tree that grows between two plans does not grow without end."""

from sim.drive import episode
from sim.scenario import Scenario


def test_a_tree_stops_growing_when_it_fills_the_memory(slit: Scenario, monkeypatch):
    monkeypatch.setattr(episode, "MOST_VERTICES", 100)
    scenario = slit.with_settings(vertices=50, samples=20, grow=40, max_time=0.03)
    frames = list(scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())))
    assert [frame.vertices for frame in frames] == [50, 90, 100]
