"""What a robot with a lidar knows: in recordings, pictures, words and JSON, whatever the scene is really like."""

import json
from dataclasses import replace

import numpy as np
import pytest
from drives import columns, logged

from pirrht.mapping.scan import Scan
from sim.cli import main
from sim.cli.fields import RUN
from sim.drawing.known import FREE as WHITE
from sim.drawing.known import OCCUPIED, SCAN, UNKNOWN, seen_area, shades
from sim.drawing.map_panel import GROUND, Panel
from sim.mjcf.names import names_of, names_of_solids
from sim.recording.recorder import Look, Recorder, Sinks
from sim.result import run_json
from sim.scenario import prepare
from sim.scenario.first_seen import first_seen

FEW = {"sense": "lidar", "vertices": 60, "samples": 20, "max_time": 0.25, "cell": 0.1}


@pytest.fixture(scope="module")
def seen():
    return first_seen(prepare("slit", given=FEW))


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A short drive, of a robot that believes to be elsewhere, and its recording."""
    scenario = prepare("slit", given=FEW | {"sense_pose": 0.02})
    driver = scenario.driver(scenario.grown_tree())
    file = tmp_path_factory.mktemp("known") / "a.rrd"
    recorder = Recorder(
        scenario.loaded, driver.tree, driver.path_integral, Sinks(file=file), Look(hz=100.0), settings={"seed": 0}
    )
    return scenario, logged(recorder, scenario.drive(scenario.plant(), driver)), columns(file)


def test_the_first_scan_shows_walls_as_obstacles_that_bear_numbers_for_names(seen):
    scenario, known = seen
    assert scenario.names == ("obstacle 1", "obstacle 2")
    names = names_of_solids(scenario.loaded, scenario.space)
    assert len(names) == len(scenario.space.scene.obstacles) > len(scenario.loaded.scene.obstacles)
    assert set(names) <= {"obstacle 1", "obstacle 2", "a wall"}
    assert known.unknown.any()
    assert not (known.unknown & known.occupied).any()
    assert scenario.space.clearance(scenario.start) > 0.0


def test_obstacles_that_are_gone_from_a_map_keep_their_numbers(seen):
    scenario, _ = seen
    gone = scenario.space.updated(replace(scenario.space.scene, obstacles=()))
    assert gone.obstacles
    assert names_of(scenario.loaded, gone) == scenario.names


def test_a_scene_that_is_known_stays_as_it_is():
    scenario = prepare("slit")
    assert first_seen(scenario) == (scenario, None)


def test_the_area_of_a_scan_ends_at_hits_and_at_the_border():
    scan = Scan(
        pose=np.array([1.0, 1.0, 0.0]), angles=np.array([0.0, np.pi / 2]), ranges=np.array([2.0, np.inf]), most=9.0
    )
    np.testing.assert_allclose(
        seen_area(scan, 9, np.zeros(2), np.array([5.0, 4.0])), [[1, 1], [3, 1], [1, 4]], atol=1e-9
    )


def test_a_panel_shows_cells_in_place_and_the_scan_on_them(seen):
    pytest.importorskip("PIL")
    scenario, known = seen
    scene = scenario.loaded.scene
    wide, high = 800, 500
    panel = Panel(scene, (wide, high))
    picture = panel.draw(known, (), np.array([[*scene.start[:2], 0.0]]))
    assert picture.shape == (high, panel.width, 3)
    scale = min(panel.width / (scene.upper - scene.lower)[0], high / (scene.upper - scene.lower)[1])
    left, top = 0.5 * (np.array([panel.width, high]) - scale * (scene.upper - scene.lower))
    colors = shades(known)[::-1]
    rows, columns = np.nonzero(known.unknown | ~known.occupied)
    right = 0
    for row, column in zip(rows[::7], columns[::7], strict=True):
        x, y = scale * (known.lower + known.cell * (np.array([column, row]) + 0.5) - scene.lower)
        right += np.array_equal(picture[int(high - top - y), int(left + x)], colors[row, column])
    assert right > 0.9 * len(rows[::7])  # but for path, robot, scan and goal
    assert np.all(picture == SCAN, axis=2).any()
    assert (top < 2) or np.array_equal(picture[0, 0], GROUND)


@pytest.mark.slow
def test_a_recording_has_each_scan_the_map_then_and_obstacles_of_the_plan(driven):
    _, frames, table = driven
    known = [frame.believed for frame in frames]
    scans = list({id(one.scan): one for one in known}.values())
    assert len(scans) == 3  # at 0, 0.1 and 0.2 s
    pictures = table["/map/cells"]["Image:buffer"]
    assert len(pictures) == len(table["/world/map/scan"]["Points3D:positions"]) == len(scans)
    for (picture,), one in zip(pictures, scans, strict=True):
        rows, width = one.unknown.shape
        found = np.array(picture, np.uint8).reshape(rows, width, 3)
        np.testing.assert_array_equal(found, shades(one))
        assert {tuple(color) for color in found.reshape(-1, 3)} == {WHITE, UNKNOWN, OCCUPIED}
    boxes = table["/world/map/obstacles"]["Boxes3D:half_sizes"]
    spaces = list({id(frame.plan.space): frame.plan.space for frame in frames}.values())
    assert [len(row) for row in boxes] == [len(space.scene.obstacles) for space in spaces]
    points = np.array(table["/world/map/scan"]["Points3D:positions"][-1])[:, :2]
    np.testing.assert_allclose(points, scans[-1].scan.points, atol=1 / 256)


@pytest.mark.slow
def test_a_recording_has_where_the_robot_believes_to_be(driven):
    _, frames, table = driven
    ring = np.array(table["/world/map/robot"]["LineStrips3D:strips"][0][0])[:, :2]
    middle = frames[0].plan.space.scene.start[:2] + frames[0].believed.error[:2]
    np.testing.assert_allclose(frames[0].plan.state, frames[0].plan.space.scene.start[:2])
    np.testing.assert_allclose(ring[:-1].mean(axis=0), middle, atol=5e-3)
    assert frames[0].believed.error.any()
    assert all("obstacle" in text[0] or "wall" in text[0] for text in table["/why/page"]["TextDocument:text"])


@pytest.mark.slow
def test_the_json_of_a_run_has_the_lidar_and_how_long_maps_took(driven):
    scenario, frames, _ = driven
    metrics = frames[-1].metrics
    found = json.loads(json.dumps(run_json(scenario, [], metrics.json())))
    assert {name: found[name] for name in ("sense", "lidar", "sense_pose", "cell", "unknown")} == {
        "sense": "lidar", "lidar": None, "sense_pose": 0.02, "cell": 0.1, "unknown": 0.0,
    }  # fmt: skip
    assert 0.0 < found["map_ms"]["median"] <= found["map_ms"]["p99"] <= found["map_ms"]["max"]
    assert len(metrics.map_seconds) == 3
    assert {name.partition(".")[0] for name in found} <= {
        field.name.partition(".")[0].removesuffix("[]") for field in RUN
    }


@pytest.mark.slow
def test_the_command_plan_draws_and_counts_what_is_known(tmp_path, capsys):
    picture, file = tmp_path / "a.png", tmp_path / "a.json"
    given = ["--sense", "lidar", "--vertices", "60", "--cell", "0.1"]
    assert main(["plan", "slit", *given, "--png", str(picture), "--json", str(file)]) == 0
    found = json.loads(file.read_text())
    assert len(found["classes"]) > 1
    assert [one["name"] for one in found["obstacles"]] == ["obstacle 1", "obstacle 2"]
    assert picture.stat().st_size > 10_000
    said = capsys.readouterr().out
    assert "ms" not in said
    assert "predicted at the start, among what the first scan shows: probability of a collision" in said
    assert "--risk" not in said  # which needs a map
