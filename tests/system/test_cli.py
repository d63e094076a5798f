"""The command line keeps its contract: names in JSON, exit statuses, and one line for whoever gave it wrong input."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mjcf_samples import FLOOR, GOAL, SITES, START, mjcf

from sim import text
from sim.cli import main, tables
from sim.mjcf import load, models_folder, scene_names
from sim.scenario import prepare
from sim.settings import refuse_idle
from sim.text import say, table

Run = Callable[..., tuple[int, Any]]

SMALL = ["--vertices", "80", "--samples", "20"]
SHORT = [*SMALL, "--max-time", "0.05"]

CLASS = {"id", "winding", "signature", "cost", "length"}
PLAN = {"scene", "robot", "vertices", "nodes", "pruned_classes", "seconds", "fcl_calls", "obstacles", "classes",
        "passages"}  # fmt: skip
RUN = {
    *("scene", "robot", "method", "seed", "noise", "lambda", "samples", "dt", "period", "outcome", "time", "cost"),
    *("path_length", "steps", "min_clearance", "value_estimate", "obstacles", "classes", "executed_class"),
    *("class_switches", "class_reversals", "fallbacks", "step_ms", "deadline_misses"),
}
ESTIMATE = {"control", "value", "ess", "class_weights", "proposal_weights", "classes", "obstacles",
            "value_stderr", "control_stderr", "tail"}  # fmt: skip


@pytest.fixture
def figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run a command that succeeds or whose drive fails; its exit status and what it wrote as JSON."""

    def call(*words: str) -> tuple[int, Any]:
        file = tmp_path / "figures.json"
        status = main([*words, "--json", str(file)])
        captured = capsys.readouterr()
        assert captured.out
        assert "Traceback" not in captured.err
        return status, json.loads(file.read_text())

    return call


# -- what works --------------------------------------------------------------------------------------------------


def test_scenes_lists_every_built_in_scene(capsys):
    assert main(["scenes"]) == 0
    listed = capsys.readouterr().out
    rows = {line.split()[0]: line for line in listed.splitlines() if line}
    for name in scene_names():
        loaded = load(name)
        moving = len(loaded.scene.movers)
        assert rows[name].split()[1:4] == [loaded.robot, f"{loaded.scene.defaults['noise']:g}", str(moving)]
        assert rows[name].endswith(f"  {loaded.about}")
        assert loaded.about
    assert str(models_folder() / "scenes") in rows["files:"]


def test_scenes_breaks_sentences_where_a_terminal_is_narrow():
    rows = [("slit", "puck", 0.1, 0, "word " * 20)]
    wide, narrow = tables.scene_table(rows).splitlines(), tables.scene_table(rows, 60).splitlines()
    assert len(wide) == 3
    assert max(map(len, narrow)) <= 60
    assert " ".join(" ".join(narrow[2:]).split()) == " ".join(wide[2].split())
    assert tables.scene_table(rows, 40).splitlines()[2] == wide[2]


@pytest.mark.slow
def test_plan_writes_the_classes_cheapest_first(figures):
    status, plan = figures("plan", "slit", "--vertices", "500")
    assert status == 0
    assert plan.keys() >= PLAN
    assert (plan["scene"], plan["robot"], plan["vertices"]) == ("slit", "puck", 500)
    assert [obstacle.keys() for obstacle in plan["obstacles"]] == [{"marker", "geoms"}] * 2
    assert [obstacle["geoms"] for obstacle in plan["obstacles"]] == [["upper wall"], ["lower wall"]]
    np.testing.assert_allclose([obstacle["marker"] for obstacle in plan["obstacles"]], [[3.4, 2.8], [3.4, 2.2]])
    ids = [c["id"] for c in plan["classes"]]
    assert ids[0] == "0,0"
    assert sorted(ids) == ["-1,0", "0,0", "0,1"]
    for one in plan["classes"]:
        assert one.keys() >= CLASS
        assert one["id"] == ",".join(str(k) for k in one["winding"])
        assert one["cost"] == pytest.approx(2.0 * one["length"])
        turns = np.array(one["signature"]) - 1.0 - one["winding"]  # of the straight line to the goal, less than half
        assert np.all(np.abs(turns) < 0.5)
    assert [c["cost"] for c in plan["classes"]] == sorted(c["cost"] for c in plan["classes"])


@pytest.mark.slow
def test_plan_tells_open_passages_that_no_path_leads_through(figures, capsys):
    _, plan = figures("plan", "slit", "--vertices", "500")
    assert plan["passages"] == {"open": 3, "unused": []}
    _, plan = figures("plan", "slit", "--vertices", "500", "--classes", "1")
    told = [(sorted(one["between"]), one.keys()) for one in plan["passages"]["unused"]]
    assert len(told) == 2
    assert all(keys == {"at", "width", "between"} for _, keys in told)
    assert not any(names == ["lower wall", "upper wall"] for names, _ in told)
    assert main(["plan", "slit", "--vertices", "500", "--classes", "1"]) == 0
    assert "2 of 3 open passages on no path" in capsys.readouterr().out


def test_plan_prints_one_row_per_class(capsys):
    assert main(["plan", "slit", "--vertices", "500"]) == 0
    rows = [line.split()[0] for line in capsys.readouterr().out.splitlines()[2:5]]
    assert rows[0] == "0,0"
    assert sorted(rows) == ["-1,0", "0,0", "0,1"]


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["mujoco", "sde"])
def test_run_reports_a_drive_to_the_goal(figures, plant):
    status, run = figures("run", "slit", "--start", "4.9", "2.5", "--plant", plant, *SMALL)
    assert status == 0
    assert run.keys() >= RUN
    assert (run["scene"], run["robot"], run["method"], run["seed"]) == ("slit", "puck", "pi-rrht", 0)
    assert (run["noise"], run["samples"], run["dt"], run["period"]) == (0.1, 20, 0.1, 0.01)
    assert run["lambda"] == pytest.approx(2.0 * 0.1**2)
    assert run["outcome"] == "goal"
    assert 0.15 < run["time"] < 0.8  # 0.3 m at about 1 m/s
    assert run["steps"] == int(np.ceil(run["time"] / 0.01 - 1e-9))
    assert run["cost"] > run["time"]  # q = 1, and control is not free
    assert 0.25 < run["value_estimate"] < 1.2
    assert 0.3 <= run["path_length"] < 5.0
    assert run["executed_class"] == "0,0"
    assert run["step_ms"].keys() == {"median", "p95", "max"}
    assert 0 < run["step_ms"]["median"] <= run["step_ms"]["p95"] <= run["step_ms"]["max"]
    assert 0 <= run["deadline_misses"] <= run["steps"]
    assert all(one.keys() >= CLASS for one in run["classes"])
    assert run["fallbacks"] == 0


def test_run_ends_with_1_when_time_is_up(figures):
    status, run = figures("run", "slit", *SHORT)
    assert status == 1
    assert run["outcome"] == "timeout"
    assert (run["time"], run["steps"]) == (pytest.approx(0.05), 5)
    assert 0.05 < run["cost"] < 0.5
    assert run["executed_class"] is None


def test_run_ends_with_1_in_a_wall(figures):
    status, run = figures("run", "slit", "--start", "3.4", "2.5", "--noise", "1", "--guide", "open-loop", *SMALL)
    assert status == 1
    assert run["outcome"] == "collision"
    assert run["executed_class"] is None
    assert run["min_clearance"] == 0.0


def test_equal_seeds_drive_alike_and_others_do_not(figures):
    one, two, three = (figures("run", "slit", "--seed", seed, *SHORT)[1] for seed in ("1", "1", "2"))
    measured = {"step_ms", "deadline_misses"}
    assert {k: v for k, v in one.items() if k not in measured} == {k: v for k, v in two.items() if k not in measured}
    assert one["path_length"] != three["path_length"]


def test_the_paper_preset_sets_the_papers_steps_and_rules(figures):
    status, run = figures("run", "slit", "--preset", "paper", "--vertices", "80", "--max-time", "0.3")
    assert status == 1
    assert (run["dt"], run["period"], run["samples"], run["steps"]) == (0.1, 0.1, 200, 3)
    settings = prepare("slit", preset="paper").settings
    assert (settings.exit, settings.weights, settings.guide) == ("endpoint", "average", "open-loop")
    assert (settings.steps, prepare("slit").settings.steps) == ("uniform", "fitted")
    assert prepare("slit", preset="paper").sampling.steps == "uniform"
    given = {"steps": "fitted", "exit": "bridge"}
    assert prepare("slit", preset="paper", given=given).sampling.fitted


def test_the_command_line_wins_over_the_preset(figures):
    words = ["--preset", "paper", "--dt", "0.05", "--period", "0.02"]
    _, run = figures("run", "slit", *words, *SHORT)
    assert (run["dt"], run["period"], run["samples"]) == (0.05, 0.02, 20)


@pytest.mark.parametrize("method", ["pi-rrht", "single", "passive"])
def test_every_method_drives(figures, method):
    status, run = figures("run", "slit", "--method", method, *SHORT)
    assert status == 1
    assert run["method"] == method
    assert run["steps"] == 5
    assert (run["classes"] == []) == (method == "passive")


def test_estimate_repeats_with_independent_samples(figures):
    status, found = figures("estimate", "slit", "--at", "1", "2.5", "--repeat", "3", "--vertices", "500")
    assert status == 0
    assert found.keys() >= ESTIMATE
    for key in ("control", "value", "ess", "class_weights", "proposal_weights"):
        assert len(found[key]) == 3
    assert len(set(found["value"])) == 3
    ids = [one["id"] for one in found["classes"]]
    for weights, drawn in zip(found["class_weights"], found["proposal_weights"], strict=True):
        assert weights.keys() == {*ids, "other"}
        assert sum(weights.values()) == pytest.approx(1.0)
        assert len(drawn) == len(ids)
        assert sum(drawn) == pytest.approx(1.0)
    assert all(len(control) == 2 for control in found["control"])
    assert np.mean(found["value"]) == pytest.approx(8.44, abs=0.1)


def test_estimate_without_survivors_prints_nulls_and_succeeds(figures):
    words = ["--at", "1", "2.5", "--method", "passive", "--samples", "10"]
    status, found = figures("estimate", "slit", *words)
    assert status == 0
    assert found["value"] == found["control"] == found["ess"] == [None]


def test_sweep_records_every_combination(figures, capsys):
    grid = ["--methods", "pi-rrht,passive", "--noise", "0.1,0.3", "--seeds", "0:2", "--jobs", "1"]
    status, rows = figures("sweep", "slit", *grid, *SHORT)
    assert status == 0
    assert len(rows) == 8
    assert {(row["method"], row["noise"], row["seed"]) for row in rows} == {
        (method, noise, seed) for method in ("pi-rrht", "passive") for noise in (0.1, 0.3) for seed in (0, 1)
    }
    assert all(row["outcome"] == "timeout" for row in rows)


def test_a_scene_file_is_as_good_as_a_built_in_name(figures, tmp_path):
    scene = tmp_path / "own.xml"
    scene.write_text(mjcf(FLOOR + SITES + '<geom name="post" type="cylinder" size="0.5 0.5" pos="5 5 0.5"/>'))
    status, plan = figures("plan", str(scene), *SMALL)
    assert status == 0
    assert (plan["scene"], plan["robot"]) == ("own", "puck")
    assert sorted(one["winding"] for one in plan["classes"]) in ([[-1], [0]], [[0], [1]])


# -- what does not -----------------------------------------------------------------------------------------------

NARROW = "".join(
    f'<geom name="{name}" type="box" pos="5 {y} 0.5" size="0.1 2.4 0.5"/>'
    for name, y in (("south", 2.4), ("north", 7.5))
)
FILES: dict[str, str | bytes] = {
    "empty.xml": "",
    "binary.xml": bytes(range(256)) * 4,
    "broken.xml": "<mujoco><worldbody><geom</worldbody>",
    "scene.txt": mjcf(FLOOR + SITES),
    "no_goal.xml": mjcf(FLOOR + START),
    "no_start.xml": mjcf(FLOOR + GOAL),
    "odd_option.xml": mjcf(FLOOR + SITES, head='<custom><numeric name="pirrht_speeed" data="1"/></custom>'),
    "bad_noise.xml": mjcf(FLOOR + SITES, head='<custom><numeric name="pirrht_noise" data="-1"/></custom>'),
    "motions.txt": '{"0": {"obstacles": []}}',
    "narrow.xml": mjcf(FLOOR + SITES + NARROW),
}

WRONG: list[tuple[str, str, str]] = [  # what is typed, the culprit and the remedy that the answer names
    ("plan missing.xml", "missing.xml", "slit"),
    ("plan empty.xml", "empty.xml", "write"),
    ("plan binary.xml", "binary.xml", "mend"),
    ("plan broken.xml", "broken.xml", "mend"),
    ("plan scene.txt", "scene.txt", "rename"),
    ("plan .", ".", "give the path"),
    ("plan no_goal.xml", "no_goal.xml", '<site name="goal"'),
    ("plan no_start.xml", "no_start.xml", '<site name="start"'),
    ("plan odd_option.xml", "pirrht_speeed", "pirrht_speed"),
    ("plan bad_noise.xml", "noise", "positive"),
    ("plan slit --start 3.4 2.8", "upper wall", "--start"),
    ("plan slit --start 9 9", "start (9, 9)", "[0, 6] x [0, 5]"),
    ("plan slit --start nan 1", "start (nan, 1)", "[0, 6] x [0, 5]"),
    ("plan slit --start 1", "--start", "X Y"),
    ("plan slit --start 1 2 3", "--start has a heading", "X Y"),
    ("run slit --record x.txt", "--record x.txt", "x.rrd"),
    ("plan slit --goal 3.4 2.8 0.1", "goal (3.4, 2.8)", "--radius"),
    ("plan slit --goal 5 2.5 -1", "goal radius is -1", "positive"),
    ("plan slit --goal 5 2.5", "--goal", "3 arguments"),
    ("plan slit --radius -0.1", "--radius is -0.1", "positive"),
    ("plan slit --radius nan", "--radius is nan", "positive"),
    ("plan narrow.xml --radius 0.3 --vertices 60", "no allowed class", "smaller --radius"),
    ("run narrow.xml --radius 0.3 --vertices 60", "no allowed class", "smaller --radius"),
    ("plan slit --limit 0", "--limit is 0", "positive"),
    ("plan slit --limit -1", "--limit is -1", "positive"),
    ("plan slit --limit 0.01 --vertices 60", "no allowed class", "larger --limit"),
    ("plan slit --noise 0", "--noise is 0", "positive"),
    ("plan slit --noise nan", "--noise is nan", "positive"),
    ("plan slit --noise abc", "'abc'", "--help"),
    ("plan nosuch", "nosuch", ", ".join(scene_names())),
    ("plan slit --robot tank", "tank", "puck"),
    ("plan slit --method magic", "'magic'", "pi-rrht"),
    ("plan slit --preset best", "'best'", "paper"),
    ("plan slit --exit soon", "'soon'", "bridge"),
    ("plan slit --weights heavy", "'heavy'", "balance"),
    ("plan slit --plant tree", "'tree'", "mujoco"),
    ("plan slit --vertices 0", "--vertices is 0", "at least 1"),
    ("plan slit --vertices 1.5", "'1.5'", "--help"),
    ("plan slit --classes -1", "--classes is -1", "at least 0"),
    ("plan slit --samples 0", "--samples is 0", "at least 1"),
    ("plan slit --seed -1", "--seed is -1", "at least 0"),
    ("run slit --threads 0", "--threads is 0", "at least 1"),
    ("run slit --dt 0", "--dt is 0", "positive"),
    ("run slit --max-time 0", "--max-time is 0", "positive"),
    ("run slit --phi -1", "--phi is -1", "0 or more"),
    ("run slit --period 0.003", "period 0.003", "whole multiple of the physics step 0.002"),
    ("run slit --record-hz 0", "--record-hz is 0", "positive"),
    ("run slit --record nowhere/x.rrd", "--record nowhere/x.rrd", "create it"),
    ("plan slit --png nowhere/x.png", "--png nowhere/x.png", "create it"),
    ("plan slit --png x.txt", "--png x.txt", ".png, .pdf, .svg"),
    ("plan slit --convergence x", "--convergence x", ".png, .pdf, .svg"),
    ("run slit --record-lift a,b --record x.rrd", "a,b", "5,12"),
    ("run slit --vertices 50 --record-lift 7 --record x.rrd", "--record-lift 7", "1 to 2"),
    ("plan slit --json nowhere/x.json", "--json nowhere/x.json", "create it"),
    ("plan slit --json .", "--json . is a folder", "path of a file"),
    ("run slit --json empty.xml/x.json", "--json empty.xml/x.json", "create it"),
    ("estimate slit", "--at", "--help"),
    ("estimate slit --at 1", "--at has 1 number", "X Y"),
    ("estimate slit --at 1 2 3 4", "--at has 4 numbers", "X Y"),
    ("estimate slit --at nan 1", "--at is nan 1", "finite"),
    ("estimate slit --robot hover --at 1 2.5 0.3 0 0", "--at has 5 numbers", "the first few of X Y VX VY"),
    ("estimate slit --at 1", "--at has 1 number;", "X Y or the first few of X Y TH"),
    ("run slit --start 1", "--start has 1 number;", "X Y"),
    ("run slit --robot hover --truth", "no grid solves the problem of a hover", "puck or unicycle"),
    ("run slit --robot hover --method optimal", "no grid solves the problem of a hover", "puck or unicycle"),
    ("run slit --robot hover --speed 2", "this robot is a hover", "leave it out"),
    ("run slit --system wind.py:BALLOON", "wind.py is a file", "--system wind:BALLOON"),
    ("run slit --system some/where.py:BALLOON", "where.py is a file", "--system some.where:BALLOON"),
    ("import broken.xml -o new.xml --motion", "broken.xml", "leave out --motion"),
    ("import motions.txt -o new.xml", "motions.txt", "add --motion"),
    ("estimate slit --at 3.4 2.8", "--at 3.4 2.8", "choose another"),
    ("estimate slit --at 5.5 2.5", "--at 5.5 2.5", "choose another"),
    ("estimate slit --at 1 2 --repeat 0", "--repeat is 0", "at least 1"),
    ("sweep slit --seeds 3:3", "'3:3'", "0:100"),
    ("sweep slit --seeds some", "'some'", "0:100"),
    ("sweep slit --methods magic", "'magic'", "pi-rrht"),
    ("sweep slit --noise 0.1,x", "'x'", "0.1,0.3"),
    ("sweep slit --jobs 0", "--jobs is 0", "at least 1"),
    ("sweep slit nosuch", "nosuch", "slit"),
    ("fly slit", "'fly'", "plan"),
    ("plan", "SCENE", "--help"),
    ("", "COMMAND", "--help"),
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with files that are wrong in every way, and a good result of an earlier run."""
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    (tmp_path / "good.json").write_text('{"kept": true}\n')
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("typed", "culprit", "remedy"), WRONG, ids=[words[0] or "nothing" for words in WRONG])
def test_wrong_input_costs_one_line_that_names_culprit_and_remedy(folder, capsys, typed, culprit, remedy):
    words = typed.split()
    if words and words[0] in ("plan", "run", "estimate", "sweep") and "--json" not in words:
        words += ["--json", "good.json"]
    before = sorted(folder.iterdir())
    assert main(words) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("pirrht: ")
    assert captured.err.endswith("\n")
    assert captured.err.count("\n") == 1
    assert "Traceback" not in captured.err
    assert culprit in captured.err
    assert remedy in captured.err
    assert (folder / "good.json").read_text() == '{"kept": true}\n'
    assert sorted(folder.iterdir()) == before


def test_a_narrow_gap_lets_a_small_robot_through(folder, capsys):
    """The scene that is refused for a larger robot above is a good one."""
    assert main(["plan", "narrow.xml", "--radius", "0.05", "--vertices", "400"]) == 0
    assert " vertices, " in capsys.readouterr().out


def test_a_good_result_replaces_the_old_one(folder, capsys):
    assert main(["plan", "slit", *SMALL, "--json", "good.json"]) == 0
    assert json.loads((folder / "good.json").read_text()).keys() >= PLAN


@pytest.mark.parametrize("command", ["", "demo", "plan", "run", "estimate", "sweep", "scenes", "export", "import"])
def test_help_ends_well(capsys, command):
    with pytest.raises(SystemExit) as caught:
        main([*command.split(), "--help"])
    assert caught.value.code == 0
    assert "usage: pirrht" in capsys.readouterr().out


def test_plan_tells_the_lengths_per_class_while_the_tree_grew(tmp_path: Path):
    picture, numbers = tmp_path / "lengths.png", tmp_path / "plan.json"
    words = ["plan", "slit", "--vertices", "200", "--convergence", str(picture), "--json", str(numbers)]
    assert main(words) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    told = json.loads(numbers.read_text())
    watched = told["convergence"]
    assert watched["vertices"][-1] == 200
    for known in told["classes"]:
        lengths = watched["lengths"][known["id"]]
        assert len(lengths) == len(watched["iterations"])
        assert known["length"] <= lengths[-1] + 1e-9


def test_estimate_says_what_its_standard_errors_do_not_know(capsys):
    words = ["estimate", "slit", "--at", "2.2", "2.6", "--noise", "0.3", "--repeat", "4", "--vertices", "200"]
    assert main([*words, "--guide", "open-loop", "--target-error", "0.001", "--budget", "400"]) == 0
    told = capsys.readouterr().out
    assert "(ESS) below 10 in" in told
    assert "try more --samples" in told
    assert "not reached in 4 of 4 repeats" in told
    assert "1200 samples drawn" in told


def test_a_table_wider_than_the_terminal_becomes_several_that_fit():
    header, rows = ["scene", "b", "success", "cost", "time"], [["slit", "0.1", "99", "8.4401", "4.2"]]
    whole = table(header, rows)
    assert table(header, rows, len(whole.splitlines()[1])) == whole
    parts = table(header, rows, 24, keep=2).split("\n\n")
    assert [part.splitlines()[0].split() for part in parts] == [
        ["scene", "b", "success"],
        ["scene", "b", "cost", "time"],
    ]
    assert all(len(line) <= 24 for part in parts for line in part.splitlines())
    assert [part.splitlines()[2].split() for part in parts] == [["slit", "0.1", "99"], ["slit", "0.1", "8.4401", "4.2"]]
    assert table(header, rows, 3).count("slit") == 4  # one column beside the first, however narrow


def test_text_is_broken_between_words_on_a_terminal_only(monkeypatch, capsys):
    line = "class -1,0, 1 class switches, 0 fallbacks, least clearance 0.115 m"
    say(line)
    assert capsys.readouterr().out == line + "\n"
    monkeypatch.setattr(text, "width", lambda: 40)
    say(line)
    shown = capsys.readouterr().out.splitlines()
    assert " ".join(part.strip() for part in shown) == line
    assert max(map(len, shown)) <= 40


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ("run slit --plan-seed 3", "unrecognized arguments: --plan-seed 3; see `pirrht run --help`"),
        ("sweep slit --seeds -3:2", "seeds are not negative; see `pirrht sweep --help`"),
        ("run slit --consistency 0.5", "--consistency is of the method best-class alone"),
        ("run slit --method mppi --consistency 0.5", "--consistency is of the method best-class alone"),
        ("estimate slit --at 1 2 --horizon 2", "--horizon is of the method mppi alone"),
        ("sweep slit --methods single,passive --exploration 2", "--exploration is of the method mppi alone"),
        ("run slit --method mppi --guide feedback", "--guide: the method mppi has no such choice"),
        ("sweep slit --methods mppi --draws antithetic", "--draws: the method mppi has no such choice"),
        ("run slit --rounds 2", "--rounds is gone: refitting guides within a plan never paid; leave it out"),
        ("run slit --memory", "--memory is gone: sampling around the last plan's tape never paid; leave it out"),
        ("run slit --between gain", "--between is 'gain'; it must be one of classes, hold"),
        ("estimate slit --at 1 2 --steps split", "--steps is 'split'; it must be one of fitted, uniform"),
        ("run slit --exit endpoint --steps fitted", "--steps fitted goes with --exit bridge"),
        ("sweep slit --preset paper --steps fitted", "--steps fitted goes with --exit bridge"),
        ("run slit --method mppi --horizon 0.05", "--horizon is 0.05; it must be at least a step, --dt 0.1"),
    ],
)
def test_what_would_be_ignored_is_refused(capsys, arguments: str, what: str):
    assert main(arguments.split()) == 2
    error = capsys.readouterr().err.strip()
    assert what in error
    assert len(error.splitlines()) == 1


def test_what_one_of_several_methods_heeds_is_not_refused():
    refuse_idle({"guide": "feedback", "horizon": 2.0, "consistency": None}, ["pi-rrht", "mppi"])
    refuse_idle({"guide": "open-loop", "draws": "independent"}, ["mppi"])


@pytest.mark.slow
def test_steps_of_one_length_are_asked_for_by_name_and_kept_by_a_sweep(figures, tmp_path):
    words = ["estimate", "slit", "--at", "2.3", "2.63", "--noise", "0.3", *SMALL]
    values = {rule: figures(*words, *rule)[1]["value"] for rule in ((), ("--steps", "fitted"), ("--steps", "uniform"))}
    assert values[()] == values["--steps", "fitted"] != values["--steps", "uniform"]
    sweep = ["sweep", "slit", "--seeds", "0:1", "--jobs", "1", "-o", str(tmp_path / "runs"), *SHORT]
    assert main([*sweep, "--steps", "uniform"]) == 0
    manifest = json.loads((tmp_path / "runs" / "manifest.json").read_text())
    assert manifest["settings"]["steps"] == "uniform"


def test_few_effective_samples_are_said(capsys):
    words = ["estimate", "slit", "--at", "1", "2.5", "--method", "mppi", "--classes", "1", "--repeat", "2"]
    assert main([*words, "--samples", "2"]) == 0
    assert "effective sample size (ESS) below 10 in 2 of 2 repeats" in capsys.readouterr().out
