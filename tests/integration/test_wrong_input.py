"""Wrong input costs one line that names culprit and remedy, and loses nothing."""

import re

import pytest
from mjcf_samples import FLOOR, SITES, START, mjcf

from sim.cli import main
from sim.mjcf import scene_names

NARROW = "".join(
    f'<geom name="{name}" type="box" pos="5 {y} 0.5" size="0.1 2.4 0.5"/>'
    for name, y in (("south", 2.4), ("north", 7.5))
)
FILES = {
    "empty.xml": "",
    "broken.xml": "<mujoco><worldbody><geom</worldbody>",
    "scene.txt": mjcf(FLOOR + SITES),
    "no_goal.xml": mjcf(FLOOR + START),
    "odd_option.xml": mjcf(FLOOR + SITES, head='<custom><numeric name="pirrht_speeed" data="1"/></custom>'),
    "hostile.xml": mjcf(FLOOR + SITES.replace('size="0.4', 'size="1e308')),
    "motions.txt": '{"0": {"obstacles": []}}',
    "narrow.xml": mjcf(FLOOR + SITES + NARROW),
}
WRONG: list[tuple[str, str, str]] = [  # what is typed, the culprit and the remedy that the answer names
    ("plan missing.xml", "missing.xml", "slit"),
    ("plan empty.xml", "empty.xml", "correct"),
    ("plan broken.xml", "broken.xml", "correct"),
    ("plan scene.txt", "scene.txt", "rename"),
    ("plan .", ".", "give the path"),
    ("plan no_goal.xml", "no_goal.xml", '<site name="goal"'),
    ("plan odd_option.xml", "pirrht_speeed", "pirrht_speed"),
    ("plan slit --start 1 2 3", "--start has a heading", "X Y"),
    ("run slit --record x.txt", "--record x.txt", "x.rrd"),
    ("plan slit --goal 3.4 2.8 0.1", "goal (3.4, 2.8)", "smaller robot radius"),
    ("plan slit --goal 5 2.5", "--goal has 2 numbers", "X Y R, or X Y Z R in space"),
    ("plan slit --workspace 1 2 3", "--workspace has 3 numbers", "X0 X1 Y0 Y1, or X0 X1 Y0 Y1 Z0 Z1 in space"),
    ("plan slit --goal 5 2 1 0.3", "the goal has 4 numbers", "x, y and radius, and no heading"),
    ("plan slit --robot ball", 'site "goal" is no sphere', 'type="sphere"'),
    ("plan window --start 1 2", "the start has 2 numbers", "x, y and z"),
    ("plan window --goal 5 2 0.3", "the goal has 3 numbers", "x, y, z and radius"),
    ("plan window --workspace 0 6 0 4", "[0.0, 6.0, 0.0, 4.0] is no box", "X0 X1 Y0 Y1 Z0 Z1"),
    ("plan window --footprint 0.5x0.3", "a footprint with corners needs a heading", "or a disc (--radius)"),
    ("plan window --robot puck", "no path from (0.8, 2)", "smaller radius"),
    ("run window --record x.rrd --record-lift 1", "--record-lift draws H as a height", "leave it out"),
    ("run window --method mppi", "shortest paths on the ground", "--mppi-terminal straight"),
    ("estimate window --at 1 2", "--at has 2 numbers", "X Y Z, all finite"),
    ("estimate window --at 3 1 1", 'the robot collides with obstacle "wall right" there', "another state"),
    ("estimate window --robot drone --truth --at 1 2 1", "no grid solves the problem of drone", "--robot ball"),
    ("plan narrow.xml --radius 0.3 --vertices 60", "no path from (1, 1)", "smaller radius"),
    ("plan slit --limit 0.01 --vertices 60", "no allowed class", "larger limit"),
    ("plan nosuch", "nosuch", ", ".join(scene_names())),
    ("plan slit --robot tank", "tank", "puck"),
    ("run slit --period 0.003", "period 0.003", "whole multiple of the physics step 0.002"),
    ("run slit --real-time --target-error 0.1", "--target-error", "leave one of them out"),
    ("plan slit --png x.txt", "--png x.txt", ".png, .pdf, .svg"),
    ("run slit --record-lift a,b --record x.rrd", "a,b", "--help"),
    ("plan slit --json nowhere/x.json", "--json nowhere/x.json", "create it"),
    ("estimate slit", "--at", "--help"),
    ("estimate slit --at nan 1", "--at is nan 1", "finite"),
    ("estimate slit --robot hover --at 1 2.5 0.3 0 0", "--at has 5 numbers", "the first few of X Y VX VY"),
    ("estimate slit --at 1", "--at has 1 number;", "X Y or the first few of X Y TH"),
    ("run slit --start 1", "--start has 1 number;", "X Y"),
    ("run slit --robot hover --truth", "no grid solves the problem of hover", "puck or unicycle"),
    ("run slit --robot hover --speed 2", "not for hover", "leave it out"),
    ("run slit --system wind.py:BALLOON", "wind.py is a file", "--system wind:BALLOON"),
    ("import broken.xml -o new.xml --motion", "broken.xml", "leave out --motion"),
    ("import motions.txt -o new.xml", "motions.txt", "add --motion"),
    (
        "estimate slit --at 3.4 2.8",
        '--at 3.4 2.8: the robot collides with obstacle "upper wall" there',
        "another state",
    ),
    ("run slit --start 5.4 2.5", "the start (5.4, 2.5) is already in the goal", "move one"),
    ("run slit --start 5.4 2.5 0 --robot rover", "already in the goal", "move one"),
    ("estimate slit --at 99 2.8", "--at 99 2.8: this state is outside the workspace, x 0 to 6 and y 0 to 5", "another"),
    ("estimate slit --at 3.4 1.9 --margin 0.2", '0.15 m from obstacle "lower wall"', "keep a margin of 0.2 m"),
    ("run clutter --method optimal", "noise b = 0.03", "choose more noise"),
    ("sweep slit --methods optimal --noise 0.2,0.01 --seeds 0:2 --jobs 1", "the grid needs", "choose more noise"),
    ("estimate slit --method optimal --at 2 2", "--method optimal", "--truth"),
    ("warm tank", "tank", "puck"),
    ("fly slit", "'fly'", "plan"),
    ("", "COMMAND", "--help"),
    ("run slit --nose 0.2", "unrecognized arguments: --nose 0.2 (did you mean --noise?); see `pirrht run --help`", ""),
    ("run slit --nois 0.2", "unrecognized arguments: --nois 0.2 (did you mean --noise?); see `pirrht run --help`", ""),
    ("run slit --nois=0.2", "unrecognized arguments: --nois=0.2 (did you mean --noise?)", ""),
    ("plan slit --vert 30", "unrecognized arguments: --vert 30 (did you mean --vertices?)", ""),
    ("run slit --record-s all", "(did you mean --record-samples?)", ""),
    ("run slit --plan-seed 3", "unrecognized arguments: --plan-seed 3; see `pirrht run --help`", ""),
    (
        "sweep slit --seeds -3:2",
        "--seeds: expected one argument; give --seeds A:B (seeds A to B-1)",
        "see `pirrht sweep",
    ),
    ("import broken.xml -o new.xml --goal 7 3 x", "--goal: invalid float value: 'x'", "give --goal X Y ... (X Y R,"),
    ("run slit --start", "--start: expected at least one argument", "give --start X Y ... (X Y [TH], or"),
    ("run slit --method mpi", "--method is 'mpi' (did you mean mppi?)", "one of pi-rrht"),
    ("sweep slit --methods best-clas", "--methods names 'best-clas' (did you mean best-class?)", "known are"),
    ("run slit --preset pape", "--preset is 'pape' (did you mean paper?)", "one of paper"),
    ("run slit --system rovr", "--system is 'rovr' (did you mean rover?)", "MODULE:NAME"),
    ("plan slit --robot pack", "pack: no such robot (did you mean puck?)", "give the path"),
    ("plan slut", "slut: no such scene (did you mean slit?)", "give the path"),
    ("estimat slit", "'estimat' is no command (did you mean estimate?)", "one of demo"),
    ("estimate slit --at 1 2.5 --method pursuit", "--method pursuit draws no samples", "--truth"),
    ("run slit --consistency 0.5", "--consistency is of the method best-class alone", ""),
    ("sweep slit --methods single,passive --exploration 2", "--exploration is of the method mppi alone", ""),
    ("run slit --method mppi --guide feedback", "--guide: the method mppi has no such choice", ""),
    ("sweep slit --methods mppi --draws antithetic", "--draws: the method mppi has no such choice", ""),
    ("run slit --between gain", "--between is 'gain'; it must be one of classes, hold", ""),
    ("run slit --exit endpoint --steps fitted", "--steps fitted goes with --exit bridge", ""),
    ("run slit --dt 0.00001", "--dt 1e-05: a path of 9.8 s has 9.8e+05 steps", "raise --dt"),
    ("run slit --noise 100", "a path of", "lower --noise or raise --dt"),
    ("run slit --max-time 80000 --period 0.002", "--max-time 80000 is 4e+07 periods", "lower the one"),
    ("run slit --grow 9000", "--grow 9000 adds up to", "lower one of them"),
    ("run slit --classes 10000 --limit 100", "GiB of memory", "lower --samples or --classes"),
    ("run slit --method mppi --horizon 9000 --dt 0.01", "a path of", "lower --horizon or raise --dt"),
    ("run slit --method mppi --horizon 0.05", "--horizon is 0.05; it must be at least a step, --dt 0.1", ""),
]
QUICK = "--vertices 30 --samples 4"
HOSTILE = [  # numbers that no check of an option refuses
    f"run slit --seed 1000000000000 --max-time 0.01 {QUICK}",
    f"run slit --phi 1e-308 --max-time 0.01 {QUICK}",
    f"run slit --noise 1000 --max-time 0.01 {QUICK}",
    f"run slit --dt 10 --period 100 --max-time 0.01 {QUICK}",
    f"plan slit --classes 0 {QUICK}",
    f"plan slit --start 1e308 2.5 {QUICK}",
    f"plan slit --goal 5 2.5 1e-3 {QUICK}",
    f"plan hostile.xml {QUICK}",
    f"estimate slit --at 1 2.5 -1e308 {QUICK}",
    f"sweep slit --noise 0.1,1e308 --seeds 0:1 {QUICK}",
]


@pytest.fixture
def folder(tmp_path, monkeypatch: pytest.MonkeyPatch):
    """A working folder with files that are wrong in every way, and a good result of an earlier run."""
    for name, content in FILES.items():
        (tmp_path / name).write_text(content)
    (tmp_path / "good.json").write_text('{"kept": true}\n')
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("typed", "culprit", "remedy"), WRONG, ids=[words[0] or "nothing" for words in WRONG])
def test_wrong_input_costs_one_line_that_names_culprit_and_remedy(folder, refused, typed, culprit, remedy):
    words = typed.split()
    if words and words[0] in ("plan", "run", "estimate", "sweep") and "--json" not in words:
        words += ["--json", "good.json"]
    before = sorted(folder.iterdir())
    refused(words, culprit, remedy, quiet=False)
    assert (folder / "good.json").read_text() == '{"kept": true}\n'
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("typed", HOSTILE)
def test_a_hostile_number_is_refused_in_one_line_or_works(folder, capsys, typed):
    assert main(typed.split()) in (0, 1) or re.fullmatch("pirrht: .{,1000}\n", capsys.readouterr().err)
