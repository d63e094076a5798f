"""The command line keeps its contract: names in JSON, exit statuses, and one line for whoever gave it wrong input."""

import json
import os
import re
import sys
import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from repository import ROOT

from sim import extras
from sim.cli import main, plan_command
from sim.cli.docs import TYPES
from sim.cli.fields import FILES
from sim.mjcf import load, models_folder, scene_names
from sim.options import OPTIONS
from sim.scenario import prepare

Run = Callable[..., tuple[int, Any]]

SMALL = ["--vertices", "80", "--samples", "20"]
SHORT = [*SMALL, "--max-time", "0.05"]

CLASS = {"id", "winding", "signature", "cost", "length"}
PLAN = {"scene", "robot", "vertices", "nodes", "pruned_classes", "seconds", "fcl_calls", "obstacles", "classes"}
RUN = {
    *("scene", "robot", "method", "seed", "noise", "lambda", "samples", "dt", "period", "outcome", "time", "cost"),
    *("path_length", "steps", "min_clearance", "value_estimate", "obstacles", "classes", "executed_class"),
    *("class_switches", "class_reversals", "fallbacks", "step_ms", "deadline_misses"),
}
ESTIMATE = {"control", "value", "ess", "class_weights", "proposal_weights", "classes", "obstacles",
            "value_stderr", "control_stderr", "tail"}  # fmt: skip


RISKY = "plan slit", "run slit --real-time", "run crossing", "estimate crossing --at 1 2.5", "sweep slit --seeds 0:1"
PYTHON = {"string": str, "number": (int, float), "integer": int, "list": list, "object": dict}


@pytest.fixture
def figures(tmp_path) -> Run:
    """Run a command that succeeds or whose run fails; its exit status and its JSON."""
    file = tmp_path / "figures.json"
    return lambda *words: (main([*words, "--json", str(file)]), json.loads(file.read_text()))


def test_scenes_lists_every_built_in_scene(capsys):
    assert main(["scenes"]) == 0
    rows = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line}
    for name in scene_names():
        loaded = load(name)
        facts = [loaded.robot, f"{loaded.scene.defaults['noise']:g}", str(len(loaded.scene.movers))]
        assert rows[name].split()[1:4] == facts
        assert rows[name].endswith(f"  {loaded.about}")
    assert str(models_folder() / "scenes") in rows["files:"]


def test_plan_writes_the_classes_cheapest_first_and_prints_a_row_for_each(figures, capsys):
    status, plan = figures("plan", "slit", "--vertices", "500")
    assert status == 0
    assert plan.keys() >= PLAN
    assert (plan["scene"], plan["robot"], plan["vertices"]) == ("slit", "puck", 500)
    assert plan["passages"] == {"open": 3, "unused": []}
    assert 0.003 < plan["collision_probability"]["probability"] < 0.012  # 0.76 % of runs of the exact law
    assert [obstacle["geoms"] for obstacle in plan["obstacles"]] == [["upper wall"], ["lower wall"]]
    np.testing.assert_allclose([obstacle["marker"] for obstacle in plan["obstacles"]], [[3.4, 2.8], [3.4, 2.2]])
    ids = [c["id"] for c in plan["classes"]]
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()[2:5]] == ids
    assert (ids[0], sorted(ids)) == ("0,0", ["-1,0", "0,0", "0,1"])
    for one in plan["classes"]:
        assert one.keys() == CLASS
        assert one["id"] == ",".join(str(k) for k in one["winding"])
        assert one["cost"] == pytest.approx(2.0 * one["length"])
        turns = np.array(one["signature"]) - 1.0 - one["winding"]  # of the straight line to the goal, less than half
        assert np.all(np.abs(turns) < 0.5)
    assert [c["cost"] for c in plan["classes"]] == sorted(c["cost"] for c in plan["classes"])


def test_plan_predicts_by_no_more_samples_than_that_takes_however_many_are_asked_for(figures):
    status, plan = figures("plan", "slit", "--vertices", "200", "--samples", "2000000")
    assert status == 0
    assert plan["collision_probability"]["error"] < 0.002


def test_plan_reports_open_passages_that_no_path_leads_through(figures, capsys):
    unused = figures("plan", "slit", "--vertices", "500", "--classes", "1")[1]["passages"]["unused"]
    assert [one.keys() for one in unused] == [{"at", "width", "between"}] * 2
    assert ["lower wall", "upper wall"] not in [sorted(one["between"]) for one in unused]
    assert "no path leads through 2 of 3 open passages; the narrowest" in capsys.readouterr().out


@pytest.mark.parametrize("scene", ["slit", "crossing"])
def test_plan_reports_the_lengths_per_class_while_the_tree_grew(figures, tmp_path, scene: str):
    picture = tmp_path / "lengths.png"
    _, found = figures("plan", scene, "--vertices", "200", "--convergence", str(picture))
    assert picture.read_bytes().startswith(b"\x89PNG")
    watched = found["convergence"]
    assert watched["vertices"][-1] == 200
    for known in found["classes"]:
        lengths = watched["lengths"][known["id"]]
        assert len(lengths) == len(watched["iterations"])
        assert known["length"] <= lengths[-1] + 1e-9 or scene == "crossing"  # there cost is shortened, not length


@pytest.mark.parametrize("plant", ["mujoco", "sde"])
def test_run_reports_a_run_to_the_goal(figures, plant):
    status, run = figures("run", "slit", "--start", "4.9", "2.5", "--plant", plant, *SMALL)
    assert status == 0
    assert run.keys() >= RUN
    assert (run["scene"], run["robot"], run["method"], run["seed"]) == ("slit", "puck", "pi-rrht", 0)
    assert (run["noise"], run["samples"], run["dt"], run["period"]) == (0.1, 20, 0.1, 0.01)
    assert run["lambda"] == pytest.approx(2.0 * 0.1**2)
    assert (run["outcome"], run["executed_class"], run["fallbacks"]) == ("goal", "0,0", 0)
    assert 0.15 < run["time"] < 0.8  # 0.3 m at about 1 m/s
    assert run["steps"] == int(np.ceil(run["time"] / 0.01 - 1e-9))
    assert run["cost"] > run["time"]  # q = 1, and control is not free
    assert 0.25 < run["value_estimate"] < 1.2
    assert 0.3 <= run["path_length"] < 5.0
    assert run["step_ms"].keys() == {"median", "p95", "max"}
    assert 0 < run["step_ms"]["median"] <= run["step_ms"]["p95"] <= run["step_ms"]["max"]
    assert 0 <= run["deadline_misses"] <= run["steps"]


FALLEN = ["--start", "3.4", "2.5", "--noise", "1", "--guide", "open-loop", *SMALL]


@pytest.mark.parametrize(
    ("words", "known"),
    [
        (SHORT, {"outcome": "timeout", "steps": 5, "time": pytest.approx(0.05)}),
        (FALLEN, {"outcome": "collision", "min_clearance": 0.0}),
        (["--method", "passive", *SHORT], {"method": "passive", "steps": 5, "classes": []}),
    ],
)
def test_run_ends_with_1_when_time_is_up_or_in_a_wall(figures, words, known):
    status, run = figures("run", "slit", *words)
    assert status == 1
    assert run.items() >= (known | {"executed_class": None}).items()
    assert words is not SHORT or 0.05 < run["cost"] < 0.5


def test_equal_seeds_run_alike_and_others_do_not(figures):
    one, two, three = (figures("run", "slit", "--seed", seed, *SHORT)[1] for seed in ("1", "1", "2"))
    for run in (one, two):
        del run["step_ms"], run["deadline_misses"]
    assert one == two
    assert one["path_length"] != three["path_length"]


def check_fields(command: str, values: dict[str, Any], within: str = "") -> None:
    """Assert that fields are documented with their types, and fields within others, but for names of classes."""
    known = {one.name: one.kind for one in FILES[command]}
    for name, value in values.items():
        field = within + name
        inside = any(other.startswith(f"{field}.") for other in known)
        items = any(other.startswith(f"{field}[].") for other in known)
        assert field in known or inside
        if value is not None and field in known:
            assert isinstance(value, PYTHON[TYPES.get(known[field], known[field])]), field
        if inside and value is not None:
            check_fields(command, value, f"{field}.")
        for one in value if items else ():
            check_fields(command, one, f"{field}[].")


@pytest.mark.parametrize("words", [*RISKY, "run slit --noise 0.3 --truth"])
def test_every_field_of_a_json_file_is_documented_with_its_type(figures, words):
    command, *_ = words.split()
    limited = [] if command in ("plan", "estimate") else ["--max-time", "0.05"]
    _, found = figures(*words.split(), *SMALL, *limited)
    check_fields(command, found[0] if command == "sweep" else found)


def test_the_paper_preset_sets_the_papers_steps_and_rules_and_the_command_line_wins(figures):
    _, run = figures("run", "slit", "--preset", "paper", "--vertices", "80", "--period", "0.05", "--max-time", "0.15")
    assert (run["dt"], run["period"], run["samples"], run["steps"]) == (0.1, 0.05, 200, 3)
    s = prepare("slit", preset="paper").settings
    assert (s.exit, s.weights, s.guide, s.steps, s.period) == ("endpoint", "average", "open-loop", "uniform", 0.1)
    assert prepare("slit", preset="paper", given={"steps": "fitted", "exit": "bridge"}).sampling.fitted


def test_estimate_repeats_with_independent_samples(figures):
    status, found = figures("estimate", "slit", "--at", "1", "2.5", "--repeat", "3", "--vertices", "500")
    assert status == 0
    assert found.keys() >= ESTIMATE
    assert {len(found[key]) for key in ("control", "value", "ess", "class_weights", "proposal_weights")} == {3}
    assert len(set(found["value"])) == 3
    ids = [one["id"] for one in found["classes"]]
    for weights, drawn in zip(found["class_weights"], found["proposal_weights"], strict=True):
        assert weights.keys() == {*ids, "other"}
        assert len(drawn) == len(ids)
        assert sum(weights.values()) == pytest.approx(1.0)
        assert sum(drawn) == pytest.approx(1.0)
    assert np.shape(found["control"]) == (3, 2)
    assert np.mean(found["value"]) == pytest.approx(8.44, abs=0.1)


@pytest.mark.parametrize(("noise", "asks"), [("0.3", False), ("10", True)])
def test_a_noise_that_leaves_the_workspace_in_a_second_is_questioned(capsys, noise, asks):
    assert main(["plan", "slit", "--noise", noise, *SMALL]) == 0
    assert ("is --noise 10 in m/sqrt(s)?" in capsys.readouterr().out) == asks


def test_estimate_without_survivors_prints_nulls_and_succeeds(figures):
    status, found = figures("estimate", "slit", "--at", "1", "2.5", "--method", "passive", "--samples", "10")
    assert (status, found["value"], found["control"], found["ess"]) == (0, [None], [None], [None])


def test_estimate_reports_what_its_standard_errors_do_not_know(capsys):
    words = "--at 2.2 2.6 --noise 0.3 --repeat 4 --vertices 200 --guide open-loop --target-error 0.001 --budget 400"
    assert main(["estimate", "slit", *words.split()]) == 0
    lines = capsys.readouterr().out
    for line in (
        "(ESS) is below 10 in",
        "try more --samples",
        "not reached in 4 of 4 repeats",
        "with at most 1200 samples",
    ):
        assert line in lines


@pytest.mark.parametrize(("scene", "robot"), [("clutter", "unicycle"), ("crossing", "puck")])
def test_plan_run_and_estimate_report_the_same_classes(figures, scene, robot, tmp_path):
    """Nightly tests have the other robots."""
    record, words = tmp_path / "run.rrd", [scene, "--vertices", "200"]
    _, plan = figures("plan", *words)
    words += ["--samples", "20"]
    _, run = figures("run", *words, "--max-time", "0.2", "--record", str(record))
    assert plan["robot"] == run["robot"] == robot
    assert (run["outcome"], run["fallbacks"]) == ("timeout", 0)
    assert [one["id"] for one in plan["classes"]] == [one["id"] for one in run["classes"]]
    assert figures("estimate", *words, "--at", "1", "2.5")[1]["value"][0] > 0.0
    assert record.stat().st_size > 1000


def test_the_law_of_the_grid_drives_a_run_with_its_exact_value(figures, tmp_path):
    record = tmp_path / "run.rrd"
    status, run = figures("run", "slit", "--method", "optimal", "--noise", "0.3", "--record", str(record))
    assert record.stat().st_size > 0
    assert status == (0 if run["outcome"] == "goal" else 1)
    assert run["value_estimate"] == pytest.approx(9.535, abs=0.002)
    assert (run["method"], run["fallbacks"], run["class_switches"]) == ("optimal", 0, 0)


def test_truth_adds_the_exact_value_control_and_errors(figures, capsys):
    words = "estimate slit --noise 0.3 --at 2.2 2.6 --repeat 2 --vertices 300 --truth"
    _, found = figures(*words.split())
    check_fields("estimate", found)
    assert found["truth"]["value"] == pytest.approx(7.479, abs=0.002)
    assert found["truth"]["control"] == pytest.approx([0.7695, 0.1987], abs=0.002)
    assert found["value_error"] == pytest.approx(np.subtract(found["value"], found["truth"]["value"]))
    shares, errors = found["truth"]["class_weights"], found["truth"]["class_weights_stderr"]
    assert sum(shares.values()) == pytest.approx(1.0, abs=0.01)
    assert shares.keys() == errors.keys() == {one["id"] for one in found["classes"]}
    off = np.linalg.norm(np.subtract(found["control"], found["truth"]["control"]), axis=1)
    assert found["control_error"] == pytest.approx(off)
    (row,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("truth")]
    assert all(f"{shares[name]:.3f} +- {errors[name]:.3f}" in row for name in shares)


def test_warm_compiles_kernels_of_a_robot(capsys):
    assert main(["warm", "puck"]) == 0
    assert "puck: kernels for runs in static scenes are compiled" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "modules", "offer"),
    [
        ("run slit --video a.mp4", "tqdm, av, PIL", "'pirrht[sim,video]'"),
        ("plan slit --png a.png --convergence b.png", "tqdm, matplotlib", "'pirrht[sim,figures]'"),
        ("import map.yaml -o scene.xml", "tqdm, yaml, PIL", "'pirrht[sim,maps]'"),
        ("sweep slit --scheduler tcp://localhost:1", "tqdm, distributed", "'pirrht[sim,cluster]'"),
        ("plan slit", "tqdm", "'pirrht[sim]'"),
        ("scenes", "mujoco", "'pirrht[sim]'"),
    ],
)
def test_everything_that_a_command_lacks_is_offered_at_once_and_before_any_work(
    words, modules, offer, monkeypatch, refused
):
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name in modules.split(", ") else name)
    line = f"pirrht: pirrht {words.split()[0]} needs {modules}; install with: pip install {offer}, or 'pirrht[all]'"
    refused(words.split(), f"{line} for every command\n")


def test_the_extra_all_holds_what_every_command_needs():
    with (ROOT / "pyproject.toml").open("rb") as stream:
        known = tomllib.load(stream)["project"]["optional-dependencies"]
    (everything,) = known["all"]
    assert sorted(everything.removeprefix("pirrht[").removesuffix("]").split(",")) == sorted(extras.EXTRAS)
    assert extras.EXTRAS.keys() <= known.keys()
    assert {option.extra for option in OPTIONS} - {""} <= extras.EXTRAS.keys()


@pytest.mark.parametrize(("columns", "wide"), [("70", 70), (None, 80)])
def test_progress_shows_on_a_terminal_even_if_that_reports_no_width(columns, wide, monkeypatch, capsys):
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns:
        monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(os, "get_terminal_size", lambda _: os.terminal_size((0, 0)))
    with plan_command.Progress("film", 10, " pictures") as bar:
        bar.to(3)
        bar.refresh()
    shown = capsys.readouterr().err.split("\r")
    assert any(re.search(r"film: +30%\|.* 3/10 pictures", line) and len(line) == wide for line in shown)
