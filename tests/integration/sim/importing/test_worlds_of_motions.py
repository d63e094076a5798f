"""Motions of DynaBARN become scenes: rows stay within 5 mm of Gazebo's way, and what cannot be one is named."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sdf_samples import refused

from pirrht.geometry.scene import Kind
from sim.cli import main
from sim.importing import dynabarn
from sim.importing.scene_file import Imported, import_world
from sim.mjcf import load

KEYS = [[0.0, -5.0, 0.0], [1.5, -4.0, 2.0], [1.75, -2.0, 3.0], [6.0, 4.0, -4.0]]
LOOP = [[0.0, 0.0, 6.0], [2.0, 3.0, 5.0], [5.0, 4.0, 2.0], [6.0, 0.0, 6.0]]
DYNABARN = {
    "7": {"level": "easy", "obstacles": [{"name": "a", "radius": 0.5, "keys": KEYS}]},
    "9": {"obstacles": [{"name": "b", "radius": r, "keys": keys} for r, keys in ((0.4, LOOP), (0.3, KEYS))]},
}


def gazebo(keys: np.ndarray, time: float) -> np.ndarray:
    """SimpleSpline by its matrix of Hermite coefficients, one moment at a time."""
    points = keys[:, 1:]
    closed, last = np.array_equal(points[0], points[-1]), len(keys) - 1

    def tangent(i: int) -> np.ndarray:
        if i in (0, last) and closed:
            return 0.5 * (points[1] - points[last - 1])
        return 0.5 * (points[min(i + 1, last)] - points[max(i - 1, 0)])

    i = max(k for k in range(last) if keys[k, 0] <= time)
    t = (time - keys[i, 0]) / (keys[i + 1, 0] - keys[i, 0])
    hermite = np.array([[2, -2, 1, 1], [-3, 3, -2, -1], [0, 0, 1, 0], [1, 0, 0, 0]])
    return np.array([t**3, t**2, t, 1]) @ hermite @ np.array([points[i], points[i + 1], tangent(i), tangent(i + 1)])


@pytest.mark.parametrize("keys", [KEYS, LOOP, [[0, 1, 1], [2, 3, 4]]])
def test_the_way_between_keys_is_gazebos_spline(keys):
    known = np.array(keys, dtype=float)
    times = np.linspace(0.0, known[-1, 0], 301)
    np.testing.assert_allclose(dynabarn.place(known, times), [gazebo(known, t) for t in times], atol=1e-12)
    np.testing.assert_allclose(dynabarn.place(known, known[:, 0]), known[:, 1:], atol=1e-12)


places = st.floats(-10, 10)
ways = st.lists(st.tuples(st.floats(0.05, 20), places, places), min_size=1, max_size=6)


def deviation(rows: np.ndarray, keys: np.ndarray) -> float:
    times = np.linspace(0.0, keys[-1, 0], 20011)
    straight = np.column_stack([np.interp(times, rows[:, 0], rows[:, k]) for k in (1, 2)])
    return float(np.hypot(*(straight - dynabarn.place(keys, times)).T).max())


@settings(max_examples=40)
@given(places, places, ways)
def test_rows_stay_within_five_millimetres_of_the_way_and_hold_its_ends(x, y, way):
    keys = np.cumsum([(0.0, 0.0, 0.0), *((t, 0.0, 0.0) for t, _, _ in way)], axis=0)
    keys[:, 1:] = [(x, y), *((a, b) for _, a, b in way)]
    rows = dynabarn.rows(keys)
    assert deviation(rows, keys) <= 0.005
    np.testing.assert_array_equal(rows[[0, -1]], keys[[0, -1]])


def test_no_row_is_there_for_nothing():
    """Between every other row a straight line would be too far off, but for the last."""
    rows = dynabarn.rows(np.array(KEYS))
    for k in range(1, len(rows) - 2):
        assert deviation(np.delete(rows, k, axis=0), np.array(KEYS)) > 0.0045


@pytest.fixture
def run(tmp_path):
    def run(worlds: object = DYNABARN, number: str | None = "7", name: str = "worlds.json", **task) -> Imported:
        source = tmp_path / name
        text = worlds if isinstance(worlds, str | bytes) else json.dumps(worlds)
        source.write_bytes(text if isinstance(text, bytes) else text.encode())
        return import_world(source, tmp_path / "maze.xml", number=number, **task)

    return run


def test_a_world_becomes_a_scene_with_the_benchmarks_task(run):
    imported = run()
    assert (imported.geoms, imported.obstacles, imported.movers) == (4, 3, 1)
    loaded = load(imported.path)
    scene = loaded.scene
    assert loaded.robot == "puck"
    np.testing.assert_allclose([*scene.start[:2], np.cos(scene.start[2])], [11, 0, -1])
    np.testing.assert_allclose([*scene.goal.center, scene.goal.radius], [-9, 0, 1])
    np.testing.assert_allclose([*scene.lower, *scene.upper], [-10, -10, 12, 10])
    assert scene.robot_radius == pytest.approx(0.33 + 0.1)  # with the room that plans keep
    assert scene.defaults["noise"] == 0.05
    assert {o.name: (*o.position[:2], *o.size[:2]) for o in scene.obstacles} == {
        "west wall": (-10, 0, 0.25, 10.25), "south wall": (0, -10, 10, 0.25), "north wall": (0, 10, 10, 0.25)
    }  # fmt: skip
    [mover] = scene.movers
    [solid] = mover.solids
    assert (mover.name, solid.kind, mover.motion.repeat) == ("a", Kind.CYLINDER, True)
    np.testing.assert_allclose(solid.size[:2], [0.5, 0.5])
    np.testing.assert_allclose(solid.position, [0, 0, 0.5], atol=1e-9)
    assert deviation(mover.motion.rows, np.array(KEYS)) <= 0.005
    assert not mover.motion.rows[:, 3].any()
    assert mover.motion.rows[-1, 0] == 6.0


def test_names_that_are_taken_get_a_number_and_a_task_given_takes_precedence(run):
    task = {"start": (9, 9, 1), "goal": (0, -5, 0.5), "workspace": (-9, 10, -9, 9.5)}
    scene = load(run(number="9", **task).path).scene
    assert [m.name for m in scene.movers] == ["b", "b 2"]
    np.testing.assert_allclose([*scene.start, *scene.goal.center, scene.goal.radius], [9, 9, 1, 0, -5, 0.5])
    np.testing.assert_allclose([*scene.lower, *scene.upper], [-9, -9, 10, 9.5])
    only = {"7": DYNABARN["7"]}  # needs no number
    assert run(only, number=None, name="motions.txt", motion=True).movers == 1


def changed(**parts) -> dict:
    return {"7": {"obstacles": [{k: v for k, v in (DYNABARN["7"]["obstacles"][0] | parts).items() if v is not None}]}}


REFUSED = [  # worlds, number, words of the message
    ("once upon a time", "7", ("no JSON", "line 1")),
    ('{"7": ', "7", ("no JSON",)),
    (b"\xff\xfe\x00", "7", ("no JSON",)),
    ("", "7", ("no JSON",)),
    ("[" * 100_000, "7", ("no JSON",)),
    ([1, 2], "7", ("no worlds by number",)),
    ({}, "7", ("no worlds by number",)),
    (DYNABARN, "8", ("no world 8", "--world", "7, 9")),
    (DYNABARN, None, ("several worlds", "--world", "7, 9")),
    ({"7": {"level": "easy"}}, "7", ("world 7", '"obstacles"')),
    ({"7": {"obstacles": []}}, "7", ("world 7", '"obstacles"')),
    ({"7": 3}, "7", ("world 7", '"obstacles"')),
    ({"7": {"obstacles": [7]}}, "7", ("obstacle 1", "no object")),
    *((changed(**{part: None}), "7", ("obstacle 1", f'"{part}"')) for part in ("name", "radius", "keys")),
    *((changed(radius=radius), "7", ('("a")', '"radius" of 1e-06 to 1e+06 m')) for radius in (0, "wide", True)),
    *((changed(keys=keys), "7", ('("a")', 'two or more "keys"')) for keys in ([[0, 1, 1]], "many")),
    (changed(name=" "), "7", ("obstacle 1", '"name"')),
    (changed(keys=[[0, 1, 1], [1, 2]]), "7", ('("a")', "key 2", "three finite")),
    (changed(keys=[[0, 1, 1], [1, float("nan"), 2]]), "7", ('("a")', "key 2", "finite")),
    (changed(keys=[[0, 1, 1], [1e999, 2, 2]]), "7", ('("a")', "key 2", "finite")),
    (changed(keys=[[0, 1, 1], [1, 10**400, 2]]), "7", ('("a")', "key 2", "finite")),
    (changed(keys=[[1, 1, 1], [2, 2, 2]]), "7", ('("a")', "key 1", "begin at 0")),
    (changed(keys=[[0, 1, 1], [2, 2, 2], [1, 3, 3]]), "7", ('("a")', "key 3", "increase")),
    (changed(keys=[[0, 11, 0.5], [1, 5, -3]]), "7", ('body "a"', "the start (11, 0)")),
]


@pytest.mark.parametrize(("worlds", "number", "words"), REFUSED)
def test_what_is_no_world_of_motions_is_refused_and_the_old_scene_stays(run, tmp_path, worlds, number, words):
    target = tmp_path / "maze.xml"
    target.write_text("as it was")
    refused(lambda: run(worlds, number), str(tmp_path / "worlds.json"), *words)
    assert target.read_text() == "as it was"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["maze.xml", "worlds.json"]


def test_the_command_line_imports_a_world(tmp_path, capsys):
    source, target = tmp_path / "worlds.json", tmp_path / "scene.xml"
    source.write_text(json.dumps(DYNABARN))
    assert main(["import", "--motion", str(source), "--world", "9", "-o", str(target)]) == 0
    assert "3 of them obstacles, and 2 moving obstacles" in capsys.readouterr().out
    assert main(["import", "--motion", str(tmp_path / "none.json"), "-o", str(target)]) == 2
    assert "give the JSON file of a set of motions" in capsys.readouterr().err
