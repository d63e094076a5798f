"""What the table of classes says where bodies move."""

from __future__ import annotations

import pytest

from sim.cli.tables import class_table
from sim.result import classes_json, estimate_json, run_json
from sim.scenario import prepare


def test_classes_among_bodies_are_told_by_how_they_pass_each():
    scenario = prepare("crossing", given={"vertices": 200})
    references = scenario.references(scenario.grown_tree())
    lines = class_table(references, None, scenario.homology).splitlines()
    assert "bodies" in lines[0]
    told = {line.split()[0]: line for line in lines[2:]}
    assert "crosser: before" in told["0"]
    assert "crosser: behind" in told["1"]
    known = {row["id"]: row["bodies"] for row in classes_json(references, homology=scenario.homology)}
    assert known == {"0": ["crosser: before"], "1": ["crosser: behind"]}


def test_where_nothing_moves_classes_are_told_by_h():
    scenario = prepare("slit", given={"vertices": 100})
    references = scenario.references(scenario.grown_tree())
    assert class_table(references, None, scenario.homology) == class_table(references)
    assert "bodies" not in classes_json(references, homology=scenario.homology)[0]


@pytest.mark.parametrize("tell", [run_json, estimate_json])
def test_what_a_program_reads_tells_what_each_number_of_a_winding_stands_for(tell):
    scenario = prepare("pincer", given={"vertices": 200})
    references = scenario.references(scenario.grown_tree())
    found = tell(scenario, references, {} if tell is run_json else [])
    assert all(len(row["winding"]) == len(found["obstacles"]) + len(found["movers"]) for row in found["classes"])
    assert found["movers"] == [mover.name for mover in scenario.loaded.scene.movers]
    assert found["classes"][0]["bodies"] == classes_json(references, homology=scenario.homology)[0]["bodies"]
