"""The table of speeds: peers take turns with ours, are asked the same question, and may be missing."""

from __future__ import annotations

import argparse

import pytest
from benchmarks import peers, rollouts, speed

OPTIONS = argparse.Namespace(scene=None, drive=0.1, part=None)


@pytest.fixture(scope="module")
def setting() -> rollouts.Setting:
    return rollouts.Setting("slit")


def test_missing_peers_are_told_and_ours_is_timed_all_the_same(monkeypatch):
    monkeypatch.setattr(peers, "missing", lambda module: True)
    monkeypatch.setattr(rollouts, "NUMBERS", (600,))
    monkeypatch.setattr(rollouts, "REPEATS", (1,))
    table, values = rollouts.rows(OPTIONS)
    assert [row[-1] for row in table].count(peers.HINT) == len(rollouts.PEERS)
    assert values["600"][rollouts.OURS]["steps_per_second"] > 0
    assert values["600"][rollouts.DEFAULT]["ess"] > 3.0 * values["600"][rollouts.OURS]["ess"]
    assert {len(row) for row in table} == {len(speed.HEADER)}
    assert values["same_on_1_and_2_threads"]


@pytest.mark.parametrize("name", rollouts.PEERS)
def test_a_peer_finds_the_answer_that_we_find(name, setting):
    module, build = rollouts.PEERS[name]
    pytest.importorskip(module)
    work = build(setting.task(), 6000)
    found = rollouts._peer(setting, work, 6000)
    assert found["off"] < 4.0
    assert 1.0 <= work(0).ess < 0.05 * 6000
    assert found.get("log_psi_off", 0.0) < 4.0
