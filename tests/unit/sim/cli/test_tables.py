"""Tables and lines of commands: classes, doubts about estimates, predicted motions, noise in its unit."""

from types import SimpleNamespace

import pytest

from sim.cli import plan_command
from sim.cli.plan_command import report_prediction
from sim.cli.tables import class_table, doubts, odds
from sim.result import classes_json, estimate_json, run_json, settings_json
from sim.scenario import prepare

TEMPERATURE, VALUE = 0.1, 9.0


def planned(scene: str):
    scenario = prepare(scene, given={"vertices": 200})
    return scenario, scenario.references(scenario.grown_tree())


def test_classes_among_moving_obstacles_are_reported_by_how_they_pass_each():
    scenario, references = planned("crossing")
    head, _, *rows = class_table(references, scenario.homology, scenario.names).splitlines()
    assert "bodies" in head
    known = {row["id"]: row["bodies"] for row in classes_json(references, scenario.homology, scenario.names)}
    assert known == {"0": ["crosser: before"], "1": ["crosser: behind"]}
    assert all(known[row.split()[0]][0] in row for row in rows)


def test_classes_of_a_static_scene_are_reported_by_h():
    scenario, references = planned("slit")
    assert class_table(references, scenario.homology, scenario.names) == class_table(references)
    assert class_table(references).splitlines()[0].endswith("H")
    assert "bodies" not in classes_json(references, scenario.homology, scenario.names)[0]


@pytest.mark.parametrize("made", [run_json, estimate_json])
def test_json_names_what_each_number_of_a_winding_stands_for(made):
    scenario, references = planned("pincer")
    found = made(scenario, references, {} if made is run_json else [])
    assert all(len(row["winding"]) == len(found["obstacles"]) + len(found["movers"]) for row in found["classes"])
    assert found["movers"] == [mover.name for mover in scenario.loaded.scene.movers]
    assert found["classes"][0]["bodies"] == classes_json(references, scenario.homology, scenario.names)[0]["bodies"]


def estimate(*, ess: float = 100.0, heavy: bool = False, own: float = 100.0, weight: float = 1.0):
    """An estimate of one class that has so many effective samples, and such a weight."""
    weights = {"class_ess": {"0,0": own}, "class_weights": {"0,0": weight}}
    return SimpleNamespace(value=VALUE, ess=ess, doubtful=ess < 10.0, heavy_tailed=heavy, **weights)


GOOD, HEAVY, LOST = estimate(), estimate(heavy=True), estimate(own=1.0, weight=0.0)


@pytest.mark.parametrize(
    ("estimates", "cost", "line"),
    [
        ((GOOD, GOOD, None), 0.0, ""),
        ((estimate(ess=3.0, heavy=True), GOOD), 0.0, "below 10 in 1 of 2 repeats"),
        ((HEAVY, HEAVY, GOOD), 0.0, "heavy tail in 2 of 3 repeats"),
        ((LOST, LOST), 0.0, "class 0,0: hardly a sample arrived in 2 of 2 repeats"),
        ((LOST, LOST), 6.0, ""),  # too costly a class to matter
        ((LOST, estimate(weight=0.001), estimate(weight=0.001)), 0.0, ""),
        ((LOST, estimate(weight=0.2), estimate(weight=0.2)), 0.0, "hardly a sample arrived in 1 of 3"),
    ],
)
def test_doubts_that_standard_errors_hide_are_reported(estimates, cost, line):
    lines = doubts(estimates, [SimpleNamespace(id="0,0", cost=VALUE + cost * TEMPERATURE)], TEMPERATURE, None)
    assert len(lines) == bool(line)
    assert line in "".join(lines)


@pytest.mark.parametrize(("robot", "unit"), [("puck", "m/sqrt(s)"), ("hover", "m/s/sqrt(s)")])
def test_noise_is_reported_in_its_unit_and_lambda_is_r_b_b(robot, unit):
    """R = 2 for both."""
    assert odds(prepare("slit", robot=robot, given={"noise": 0.3})) == f"{robot}: noise 0.3 {unit}, lambda 0.18"


@pytest.mark.parametrize(("scene", "predict", "lines"), [("crossing", "velocity", 1), ("crossing", "known", 0)])
def test_true_motions_that_plans_do_not_know_are_reported(capsys, scene, predict, lines):
    scenario = prepare(scene, given={"predict": predict})
    report_prediction(scenario, "the exact value is that")
    assert capsys.readouterr().out.count("which plans of --predict velocity do not know") == lines
    assert settings_json(scenario)["predict"] == predict
    assert "predict" not in settings_json(prepare("slit"))


@pytest.mark.parametrize(("kept", "often"), [(True, "once"), (False, "every time")])
def test_the_first_kernel_that_is_compiled_is_reported_in_one_line(kept, often, monkeypatch, capsys):
    monkeypatch.setattr(plan_command.cache, "kept", lambda: kept)
    notice, kernel = plan_command.Notice(), SimpleNamespace(__module__="pirrht.planner.expand")
    for _ in range(3):
        notice.on_start(SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=kernel)}))
        notice.on_end(None)
    notice.finish()
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"compiling kernels, {often} for each kind of robot and scene")
    assert "pirrht warm" in line
