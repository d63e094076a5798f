"""Robots in space: they fly in MuJoCo through the window, and recordings and pictures of them are read back."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drives import columns, logged, static
from rerun.chunk import RrdReader

from sim import plotting
from sim.cli import main
from sim.drawing.ways import ways_in
from sim.mjcf import load
from sim.recording.recorder import Look, Recorder, Sinks
from sim.scenario import prepare

NEAR = {"start": (2.3, 2.0, 1.0), "goal": (3.9, 2.0, 1.0, 0.3), "samples": 100, "vertices": 200, "seed": 1}


def flown(robot, **more):
    """A short flight through the window."""
    scenario = prepare("window", robot=robot, given={**NEAR, **more})
    tree = scenario.grown_tree()
    driver = scenario.driver(tree)
    return scenario, tree, driver, scenario.drive(scenario.plant(), driver)


def test_the_window_is_read_at_all_heights_for_a_ball_and_at_its_height_for_a_puck():
    solid = ["wall below", "wall above", "wall right", "wall left"]
    ball, drone, puck = (load("window", robot=robot) for robot in ("ball", "drone", "puck"))
    for loaded in (ball, drone):
        scene = loaded.scene
        assert [one.name for one in scene.obstacles] == solid
        np.testing.assert_allclose([*scene.lower, *scene.upper], [0.2, 0.2, 0.2, 5.8, 3.8, 2.8])
        np.testing.assert_allclose([*scene.start, *scene.goal.center, scene.goal.radius], [0.8, 2, 1, 5.2, 2, 1, 0.3])
        assert loaded.command.shape == ((4, 3) if loaded is drone else (3, 3))
        eye, target = loaded.overview
        assert np.all((target > scene.lower) & (target < scene.upper))
        assert eye[2] > scene.upper[2]
    assert [one.name for one in puck.scene.obstacles] == ["wall below"]
    assert (puck.scene.dimension, len(puck.scene.goal.center)) == (2, 2)


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "noise"), [("ball", 0.2), ("drone", 0.3)])
def test_a_robot_in_space_flies_through_the_window_without_contact(robot, noise):
    scenario, tree, _, drive = flown(robot, noise=noise)
    references = scenario.references(tree)
    words = dict(zip([one.id for one in references], ways_in(scenario.space, references, scenario.names), strict=True))
    assert {*words.values()} == {"through the opening in wall", "over wall"}
    frames = list(drive)
    run = frames[-1].metrics
    assert (run.outcome, words[run.executed_class]) == ("goal", "through the opening in wall")
    assert run.min_clearance > 0.0
    heights = np.concatenate([frame.advance.states for frame in frames])[:, 2]
    assert 0.65 + 0.2 < heights.min() < heights.max() < 1.35 - 0.2 + 0.3
    assert np.ptp(heights) > 0.005  # noise acts along all axes
    assert (run.plant_mismatch is None) is (robot == "ball")
    if robot == "drone":  # a quadrotor, which lags behind the plan by its tilt
        off = run.json()["plant_mismatch"]
        assert 0.0 < off["x"] < 0.005
        assert 0.001 < off["vx"] < 0.1
        assert np.ptp(np.concatenate([frame.advance.attitudes for frame in frames])[:, 2]) > 0.05


@pytest.mark.slow
def test_a_recording_shows_how_a_drone_tilts(tmp_path):
    scenario, tree, driver, drive = flown("drone", noise=0.3, max_time=0.3)
    file = tmp_path / "drone.rrd"
    subject = scenario.loaded, tree, driver.path_integral
    frames = logged(Recorder(*subject, Sinks(file=file), Look(), settings={"scene": "window"}), drive)
    turns = np.array(columns(file)["/world/robot"]["Transform3D:quaternion"]).reshape(-1, 4)
    np.testing.assert_allclose(np.roll(turns[-1], 1), frames[-1].advance.attitudes[-1], atol=1e-6)
    assert np.ptp(turns[:, 1]) > 0.01


@pytest.mark.slow
def test_a_recording_of_a_ball_has_an_orbiting_eye_paths_at_their_height_and_ways_in_words(tmp_path):
    scenario, tree, driver, drive = flown("ball", noise=0.4, max_time=0.3)
    file = tmp_path / "ball.rrd"
    settings = {"scene": "window", "seed": 1, "method": "pi-rrht"}
    frames = logged(
        Recorder(scenario.loaded, tree, driver.path_integral, Sinks(file=file), Look(), settings=settings), drive
    )
    table = columns(file)
    at = np.array(table["/world/robot"]["Transform3D:translation"]).reshape(-1, 3)
    np.testing.assert_allclose(at[-1], frames[-1].state, atol=1e-6)
    eyes = np.array(table["/world/eyes/following"]["Transform3D:translation"]).reshape(-1, 3)
    assert np.all((eyes[:, 2] > 1.5) & (eyes[:, 0] < at[0, 0]))
    strips = np.concatenate([np.concatenate(row) for row in table["/world/references"]["LineStrips3D:strips"]])
    assert np.ptp(strips[:, 2]) > 1.0  # over the wall
    entities = {chunk.entity_path for chunk in RrdReader(str(file)).stream()}
    assert {"/world/scene/goal", "/world/scene/border", "/world/samples/0"} <= entities
    assert not {"/world/eyes/above", "/tree/1/edges"} & entities
    assert static(file, "/world/scene/names", "Points3D:labels") == ["goal", "1 wall"]
    for (text,) in table["/why/page"]["TextDocument:text"]:
        assert all(way in text.lower() for way in ("through the opening in wall", "over wall"))
    labels = {text for row in table["/world/names"]["Points3D:labels"] for text in row}
    assert all(text.startswith(("through the opening in wall   ", "over wall   ")) for text in labels)


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "predict"), [("ball", "known"), ("ball", "velocity"), ("drone", "known")])
def test_a_robot_in_space_passes_two_balls_and_the_recording_shows_where_they_are_and_will_be(tmp_path, robot, predict):
    given = {"seed": 1, "predict": predict, "vertices": 300, "samples": 100}
    scenario = prepare("sentries", robot=robot, given=given)
    tree = scenario.grown_tree()
    driver = scenario.driver(tree)
    file = tmp_path / "balls.rrd"
    sinks = Sinks(file=file)
    settings = {"scene": "sentries", "seed": 1, "method": "pi-rrht"}
    recorder = Recorder(scenario.loaded, tree, driver.path_integral, sinks, Look(), settings=settings)
    frames = logged(recorder, scenario.drive(scenario.plant(), driver))
    run = frames[-1].metrics
    assert (run.outcome, run.executed_class) == ("goal", "0")
    assert run.min_clearance > 0.0
    table = columns(file)
    for mover in scenario.loaded.scene.movers:
        at = np.array(table[f"/world/scene/movers/{mover.name}"]["Transform3D:translation"]).reshape(-1, 3)
        np.testing.assert_allclose(at[-1], mover.motion.pose(frames[-1].end_time)[:3], atol=1e-6)
    rings = np.concatenate([np.concatenate(row) for row in table["/world/foreseen"]["LineStrips3D:strips"]])
    assert np.ptp(rings[:, 2]) > 1.0
    assert not any("spacetime" in entity for entity in table)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["ball", "drone"])
def test_a_robot_before_a_closed_window_hovers_gives_way_and_goes_on_when_it_opens(tmp_path, robot):
    """A lid leaves the window after 2 s, which is not foreseen; a ball flies through where the robot starts."""
    text = Path(load("sentries").path).read_text()
    text = re.sub(r"<(text|numeric) name=.pirrht_poses_.*?/>", "", text)
    text = re.sub(r"<body name=.(across|down).*?</body>", "", text, flags=re.DOTALL)
    lid = "0 3.3 2 1 1 0 0 0  2 3.3 2 1 1 0 0 0  3 3.3 2 2.6 1 0 0 0"
    bowled = "0 0.8 -2 1 1 0 0 0  4 0.8 6 1 1 0 0 0"
    custom = f'<numeric name="pirrht_poses_lid" data="{lid}"/><numeric name="pirrht_poses_bowl" data="{bowled}"/>'
    bodies = (
        '<body name="lid" mocap="true" pos="3.3 2 1"><geom type="box" size=".2 .45 .45"/></body>'
        '<body name="bowl" mocap="true" pos="0.8 -2 1"><geom type="sphere" size=".25"/></body>'
    )
    text = text.replace('size="2.8 1.8 1.3"', 'size="2.8 1.8 0.65"')  # nothing leads over the wall
    (tmp_path / "lid.xml").write_text(
        text.replace("</custom>", f"{custom}</custom>").replace("</worldbody>", f"{bodies}</worldbody>")
    )
    given = {"seed": 0, "predict": "velocity", "vertices": 300, "samples": 100}
    scenario = prepare(tmp_path / "lid.xml", robot=robot, given=given)
    frames = list(scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())))
    run = frames[-1].metrics
    assert run.outcome == "goal"
    assert 2.0 <= run.blocked_time <= 4.0
    waiting = np.array([frame.state for frame in frames if 1.4 < frame.end_time <= 2.0])  # the ball is coming
    assert np.all(np.linalg.norm(waiting[:, :3] - scenario.start[:3], axis=1) > 0.45)
    assert np.ptp(waiting[:, :3], axis=0).max() < 0.3
    assert run.min_clearance > 0.0


@pytest.mark.slow
def test_a_plan_in_space_is_told_drawn_and_written(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    picture, file = tmp_path / "plan.png", tmp_path / "plan.json"
    assert main(["plan", "window", "--vertices", "200", "--png", str(picture), "--json", str(file)]) == 0
    head, _, *rows = capsys.readouterr().out.splitlines()
    assert head.split() == ["class", "cost", "length", "[m]", "H", "way"]
    known = json.loads(file.read_text())
    ways = [row["way"] for row in known["classes"]]
    assert ways == ["through the opening in wall", "over wall"]
    assert all(row.endswith(way) for row, way in zip(rows, ways, strict=False))
    assert known["passages"] == {"open": 0, "unused": []}
    assert [one["name"] for one in known["obstacles"]] == ["wall"]
    assert len(known["obstacles"][0]["marker"]) == 3
    assert picture.stat().st_size > 20_000


@pytest.mark.slow
def test_the_legend_of_a_plan_in_space_names_the_cheapest_classes_and_counts_the_others(tmp_path, monkeypatch):
    figures = list[Any]()
    monkeypatch.setattr(plotting, "_save", lambda axes, *_: figures.append(axes.figure))
    scenario = prepare("pillars", vertices=300)
    tree = scenario.grown_tree()
    references = 3 * tree.references(scenario.start)
    plotting.draw_plan(tmp_path / "plan.png", scenario, tree, references)
    figure = figures[0]
    figure.canvas.draw()
    *named, last = (text.get_text() for text in figure.legends[0].get_texts())
    assert [text.split(":")[0] for text in named] == [reference.id for reference in references[: len(named)]]
    assert last == f"and {len(references) - len(named)} more"
    assert figure.legends[0].get_window_extent().height < figure.bbox.height
    assert min(axes.get_window_extent().width for axes in figure.axes) > 0.5 * figure.bbox.width
