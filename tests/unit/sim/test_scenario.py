"""Margins, limits and lengths of a scenario follow from its scene and noise."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pirrht import HomologyTree, NoReference, OptionError
from pirrht.planner.tuning import LIMITS
from sim import tree_file
from sim.drive import episode
from sim.mjcf import load
from sim.result import convergence_json
from sim.scenario import Scenario, prepare
from sim.scenario.prepared import DEVIATIONS, LEAST, REACTION
from sim.scenario.risk import RESERVE, ROUNDS, StartPlan, predicted
from sim.sweeps.runs import settled
from sim.sweeps.sweep import Grid

# -- a margin ----------------------------------------------------------------------------------------------------


def gap(tmp_path, width: float) -> str:
    """A wall with a gap in its middle [m]."""
    half = 0.25 * (3.0 - width)
    (tmp_path / "gap.xml").write_text(
        f"""<mujoco><worldbody><site name="workspace" type="box" size="2 1.5 1" pos="2 1.5 .5"/>
        <geom name="low" type="box" size=".1 {half} .5" pos="2 {half} .5"/>
        <geom name="high" type="box" size=".1 {half} .5" pos="2 {3.0 - half} .5"/>
        <site name="start" pos=".6 1.5 0"/>
        <site name="goal" type="cylinder" size=".3 .01" pos="3.4 1.5 0"/></worldbody></mujoco>"""
    )
    return str(tmp_path / "gap.xml")


def test_a_margin_is_three_deviations_of_the_place_before_a_reaction_and_leaves_passages_open(tmp_path):
    for noise in (0.05, 0.2):
        scenario = prepare(gap(tmp_path, 1.0), given={"noise": noise})
        assert scenario.margin == pytest.approx(DEVIATIONS * noise * np.sqrt(REACTION), abs=1e-4)
        assert scenario.loaded.scene.robot_radius == pytest.approx(0.1 + scenario.margin)
    assert prepare(gap(tmp_path, 1.0), robot="hover").margin == LEAST  # noise does not move its place at once
    for margin in (0.02, 0.0):
        assert prepare(gap(tmp_path, 1.0), margin=margin).margin == margin
    for name in ("slit", "clutter"):  # the scenes of the paper
        assert prepare(name).margin == 0.0
        assert prepare(name).loaded.scene.robot_radius == load(name).scene.robot_radius


@pytest.mark.parametrize(("width", "kept"), [(0.24, 0.005), (0.21, 0.00125), (0.2004, 5e-5)])
def test_a_narrow_gap_has_a_quarter_of_its_clearance_as_margin_and_the_rest_of_the_scene_the_whole(
    tmp_path, width, kept
):
    scenario = prepare(gap(tmp_path, width), vertices=200)
    middle, wall = np.array([[2.0, 1.5]]), np.array([[2.0 - 0.1 - 0.2, 0.3]])
    assert scenario.margin == pytest.approx(0.03)
    assert scenario.space.collision.clearance(middle)[0] == pytest.approx(0.5 * width - 0.1 - kept, abs=5e-4)
    assert scenario.space.collision.clearance(wall)[0] == pytest.approx(0.2 - 0.1 - 0.03)
    (_,) = scenario.references(scenario.grown_tree())  # the walls reach the border: all paths lead through the gap


FAR = """<mujoco><worldbody><site name="workspace" type="box" size="3 2.5 .5" pos="3 2.5 .5"/>
<geom name="wall 1" type="box" pos="2.1 2.25 .25" size=".1 2.25 .25"/>
<geom name="wall 2" type="box" pos="2.8 2.75 .25" size=".1 2.25 .25"/>
<geom name="crate 1" type="box" pos="5 1 .25" size=".2 .2 .25"/>
<geom name="crate 2" type="box" pos="{} 1 .25" size=".2 .2 .25"/>
<site name="start" pos=".6 1 0"/><site name="goal" type="cylinder" pos="5.4 4.4 0" size=".3 .01"/>
</worldbody></mujoco>"""


def far_crates(tmp_path, gap: float, **given) -> Scenario:
    """Two crates in a far corner, so far apart [m]."""
    (tmp_path / "far.xml").write_text(FAR.format(5.4 + gap))
    return prepare(tmp_path / "far.xml", vertices=300, **given)


def test_a_narrow_gap_in_a_far_corner_changes_neither_the_margin_nor_the_classes(tmp_path):
    narrow = far_crates(tmp_path, 0.2004)
    assert narrow.margin == far_crates(tmp_path, 0.3).margin == pytest.approx(0.03)
    assert len(narrow.space.obstacles) == len(far_crates(tmp_path, 0.2004, margin=0.0).space.obstacles) == 2
    assert predicted(narrow).most < 1e-3 * predicted(far_crates(tmp_path, 0.2004, margin=0.0)).most


def test_the_prediction_counts_the_margin_of_the_passages_that_a_class_leads_through(tmp_path):
    local = prepare(gap(tmp_path, 0.24), noise=0.2)
    found, expected = predicted(local), predicted(prepare(gap(tmp_path, 0.24), noise=0.2, margin=0.005))
    assert local.margin > 0.05
    assert found.probability == pytest.approx(expected.probability, rel=0.3)
    assert found.probability > 1e-3


def test_a_passage_that_does_not_open_and_one_among_moving_obstacles_count_everywhere(tmp_path):
    text = Path(gap(tmp_path, 0.3)).read_text()
    (tmp_path / "long.xml").write_text(
        text.replace('size=".1 ', 'size="4 ').replace('pos="2 ', 'pos="6 ').replace('size="2 1.5 1"', 'size="6 1.5 1"')
        .replace('pos="3.4 ', 'pos="11.4 ')
    )  # fmt: skip
    corridor = prepare(tmp_path / "long.xml", vertices=100)
    assert corridor.margin == pytest.approx(0.25 * 0.05, abs=5e-4)
    assert not corridor.loaded.scene.narrow
    moving = """<custom><numeric name="pirrht_motion_one" data="0 .5 .5 0  4 1 .5 0"/></custom><worldbody>
    <body name="one" mocap="true" pos=".5 .5 .3"><geom type="cylinder" size=".1 .3"/></body>"""
    (tmp_path / "moving.xml").write_text(text.replace("<worldbody>", moving))
    assert prepare(tmp_path / "moving.xml", vertices=100).margin == pytest.approx(0.25 * 0.05, abs=5e-4)


@pytest.mark.parametrize(("scene", "left"), [("house", 0.264), ("barn", 0.192)])
def test_a_margin_without_a_path_is_named_with_one_that_leaves_a_path(scene: str, left: float):
    wide = prepare(scene, margin=0.5, vertices=60)
    with pytest.raises(NoReference, match=rf"keeps the margin of 0.5 m\. A margin of {left:g} m leaves one"):
        wide.references(wide.empty_tree())
    assert prepare(scene, margin=left, vertices=60).space.margin_left(wide.start) is None


def test_a_robot_that_fits_nowhere_is_told_from_a_margin_that_does_not():
    house = prepare("house", radius=0.5, vertices=60)
    with pytest.raises(
        NoReference, match=r"is wide enough for the robot, even without a margin\. Try a smaller radius"
    ):
        house.references(house.empty_tree())
    small = prepare("house", vertices=60)
    with pytest.raises(NoReference, match=r"Try more vertices, a larger limit"):
        small.references(small.empty_tree())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"given": {"sample": 100}}, "'sample' is no option (did you mean samples?)"),
        ({"robto": "puck"}, "'robto' is no option (did you mean robot?)"),
        ({"wind": 1.0}, "'wind' is no option; those are allocation, between,"),
    ],
)
def test_settings_that_are_none_are_refused_by_name(options, message):
    with pytest.raises(OptionError, match=re.escape(message)):
        prepare("slit", **options)


# -- a limit of |1 - H_i| ----------------------------------------------------------------------------------------

NARROW = 1e-3  # less than any path past a wall winds
LOW = 0.5  # less than the shortest path past a hook winds


def test_the_tree_is_grown_within_the_next_limit_that_lets_a_class_reach_the_goal_unless_one_was_given(tmp_path):
    """`slit` for a robot of which no class is within its own limit."""
    scenario = prepare("slit", given={"vertices": 300})
    scenario = replace(scenario, settings=replace(scenario.settings, limit=NARROW))
    tree, asked = scenario.grown_tree(), scenario.with_settings(limit=LIMITS.wider[0]).grown_tree()
    assert tree.limit == LIMITS.wider[0]
    assert [one.cost for one in scenario.references(tree)] == [one.cost for one in scenario.references(asked)]
    tree_file.save(tree, file := str(tmp_path / "tree.npz"))
    assert tree_file.load(file, scenario.space, scenario.steering()).limit == LIMITS.wider[0]
    asked = scenario.with_settings(limit=2.0 * NARROW)
    with pytest.raises(NoReference, match=r"<= 0\.002"):
        asked.references(asked.grown_tree())


def test_a_limit_that_leaves_out_the_short_path_out_of_a_pocket_is_widened(tmp_path):
    """A wall 2 m high right of a pocket, with an arm to the left at its lower end."""
    boxes = {"wall": "2 1.5", "arm": "1.5 .6", "post": "3.2 2.6"}
    sizes = {"wall": ".1 1 .5", "arm": ".6 .1 .5", "post": ".1 .1 .5"}
    geoms = "".join(f'<geom name="{n}" type="box" pos="{at} .5" size="{sizes[n]}"/>' for n, at in boxes.items())
    (tmp_path / "hook.xml").write_text(
        f"""<mujoco><worldbody><site name="workspace" type="box" size="2 1.5 1" pos="2 1.5 .5"/>{geoms}
        <site name="start" pos="1.3 1.2 0"/>
        <site name="goal" type="cylinder" size=".2 .01" pos="3.4 1.5 0"/></worldbody></mujoco>"""
    )
    hook = prepare(tmp_path / "hook.xml", margin=0.0, given={"vertices": 400})
    hook = replace(hook, settings=replace(hook.settings, limit=LOW))
    wide, low = hook.grown_tree(), hook.with_settings(limit=LOW).grown_tree()
    assert (wide.limit, low.limit) == (LIMITS.wider[1], LOW)
    assert min(low.lengths(hook.start).values()) > 1.1 * min(wide.lengths(hook.start).values())


# -- lengths of the best path per class while the tree grows (the paper's Fig. 3a) -------------------------------


def test_lengths_never_rise_and_approach_the_exact_ones_and_watching_does_not_change_the_tree():
    slit = prepare("slit")
    tree, unwatched = slit.empty_tree(), slit.empty_tree()
    convergence = convergence_json(tree, slit.start, 600, every=25)
    with np.errstate(invalid="ignore"):  # inf - inf before a class is found
        assert not np.any(np.diff([*convergence["lengths"].values()]) > 0)
    last = {name: lengths[-1] for name, lengths in convergence["lengths"].items()}
    for name, length in {"0,0": 4.2, "-1,0": 4.33873, "0,1": 4.33873}.items():
        assert length <= last[name] < 1.05 * length  # not shortened
    raw = {r.id: r.length for r in tree.references(slit.start, shortened=False)}
    for name, length in raw.items():
        assert last[name] <= length * (1 + 1e-12)
    assert min(last.values()) == pytest.approx(min(raw.values()), rel=0.02)
    unwatched.grow(600)
    assert np.array_equal(unwatched.states[:600], tree.states[:600])
    assert (convergence["vertices"][-1], convergence["iterations"][-1]) == (600, tree.draws)


def test_a_tree_stops_growing_when_it_fills_the_memory(slit, monkeypatch):
    monkeypatch.setattr(episode, "MOST_VERTICES", 100)
    scenario = slit.with_settings(vertices=50, samples=20, grow=40, max_time=0.03)
    frames = list(scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())))
    assert [frame.vertices for frame in frames] == [50, 90, 100]


FEW = {"noise": 0.2, "vertices": 300, "samples": 100}

# -- a risk -------------------------------------------------------------------------------------------------------


def test_a_smaller_risk_takes_a_wider_margin_and_the_prediction_keeps_it(tmp_path):
    margins = []
    for risk in (0.05, 0.01, 0.001):
        scenario = prepare(gap(tmp_path, 0.3), given={**FEW, "risk": risk})
        assert RESERVE * predicted(scenario).most <= risk
        margins.append(scenario.margin)
    assert margins == sorted(margins)
    assert margins[0] < margins[-1] < 0.03


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"given": {**FEW, "risk": 1e-6}}, "no margin that leaves a way keeps it"),
        ({"given": {"risk": 0.01, "method": "mppi"}}, "a method of pi-rrht, optimal; others take --margin"),
        ({"given": {"risk": 0.01, "exit": "endpoint"}}, "--risk takes --exit bridge"),
        ({"given": {"risk": 0.01}, "margin": 0.01}, "--risk chooses the margin; leave out --margin"),
        ({"given": {"risk": 0.7}}, "--risk is 0.7"),
    ],
)
def test_a_risk_that_cannot_be_kept_is_refused_with_what_would_work(tmp_path, options, message):
    with pytest.raises(OptionError, match=re.escape(message)):
        prepare(gap(tmp_path, 0.24), **options)


def test_the_nearest_margin_is_taken_if_that_was_asked_for(tmp_path):
    nearest = prepare(gap(tmp_path, 0.26), **FEW, risk=1e-5, risk_infeasible="best")
    assert 0.0 < nearest.margin < 0.03
    assert nearest.risk_note.startswith("not kept: ")


def test_the_last_tree_and_prediction_of_a_search_for_a_margin_are_those_of_the_plan(tmp_path, monkeypatch):
    scenario = prepare(gap(tmp_path, 0.3), noise=0.2, risk=0.01, vertices=300)
    anew = replace(scenario, spare=[], collision=None)
    trees, plans = counted(monkeypatch, HomologyTree, "grow"), counted(monkeypatch, StartPlan, "of")
    tree = scenario.grown_tree()
    found = predicted(scenario, tree)
    assert not trees
    assert not plans
    again = anew.grown_tree()
    assert predicted(anew, again) == found
    for one in (tree, again):
        one.grow(350)
    np.testing.assert_array_equal(tree.states[: tree.size], again.states[: again.size])
    assert not scenario.with_settings(seed=1).spare
    assert scenario.grown_tree() is not tree


def test_a_search_for_a_margin_weighs_few_margins_whatever_the_noise(monkeypatch):
    """One of 5 400 margins that are multiples of 0.1 mm."""
    weighed = counted(monkeypatch, StartPlan, "collision")
    prepare("slit", noise=3.0, risk=0.05, risk_infeasible="best", vertices=100, samples=20)
    assert 0 < len(weighed) <= ROUNDS * (2 + math.log2(5400))


def counted(monkeypatch, kind: type, name: str) -> list:
    """List the calls of a method from now on."""
    calls, original = [], getattr(kind, name)

    def called(*arguments, **more):
        calls.append(name)
        return original(*arguments, **more)

    monkeypatch.setattr(kind, name, called)
    return calls


def test_each_noise_of_a_sweep_has_the_margin_that_keeps_the_risk(tmp_path):
    noises, given = (0.1, 0.2), (("risk", 0.01), ("vertices", 300), ("samples", 100))
    grid = Grid(scenes=(gap(tmp_path, 0.3),), methods=("pi-rrht",), noises=noises, seeds=range(1), given=given)
    margins = [settled(job).margin for job in grid.jobs()]
    alone = [prepare(gap(tmp_path, 0.3), given={**dict(given), "noise": noise}) for noise in noises]
    assert margins == [scenario.margin for scenario in alone]
    assert margins[0] < margins[1]
    for change in ({"noise": 0.2}, {"risk": 0.001}, {"phi": 3.0}):
        with pytest.raises(OptionError, match=f"{next(iter(change))} decides on the margin that keeps --risk"):
            alone[0].with_settings(**change)
