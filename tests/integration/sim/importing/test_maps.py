"""ROS maps become scenes: the walls are the occupied cells, exactly, and what cannot be read is named."""

import os
import re

import numpy as np
import pytest

pytest.importorskip("yaml")
Image = pytest.importorskip("PIL.Image")

from sdf_samples import refused  # noqa: E402

from pirrht.errors import SceneError  # noqa: E402
from pirrht.geometry.scene import Kind  # noqa: E402
from sim import cli  # noqa: E402
from sim.importing.ros_map import read_map  # noqa: E402
from sim.importing.scene_file import import_world  # noqa: E402
from sim.mjcf import load  # noqa: E402

BLACK, GREY, WHITE = 0, 205, 254
BASE = {"resolution": 0.1, "origin": "[0.0, 0.0, 0.0]", "occupied_thresh": 0.65, "free_thresh": 0.196, "negate": 0}
BASE["image"] = "map.pgm"


def written(folder, picture: np.ndarray, name: str = "map.pgm", **keys):
    """A map of a picture whose first row is the top."""
    Image.fromarray(picture).save(folder / name)
    path = folder / "map.yaml"
    values = BASE | {"image": name} | keys
    path.write_text("".join(f"{key}: {value}\n" for key, value in values.items() if value is not None))
    return path


def drawn(*rows: str) -> np.ndarray:
    return np.array([[{"#": BLACK, "?": GREY, ".": WHITE}[c] for c in row] for row in rows], np.uint8)


def rooms(size: int = 80) -> np.ndarray:
    """A house of four rooms with doors, seen from above, in a surrounding that nobody knows."""
    picture = np.full((size, size), GREY, np.uint8)
    picture[4:-4, 4:-4] = BLACK
    inner, middle = slice(6, size - 6), size // 2
    picture[inner, inner] = WHITE
    walls = slice(middle - 1, middle + 1)
    picture[walls, inner] = picture[inner, walls] = BLACK
    for door in (16, 51):
        picture[walls, door : door + 12] = picture[door + 3 : door + 15, walls] = WHITE
    return picture


def blocked(world, picture, side: float = 0.1, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    """Which pixels lie in walls, (rows, columns) from the top."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    rows, columns = np.indices(picture.shape[:2])
    places = side * np.dstack([columns + 0.5, len(rows) - rows - 0.5]) @ turn.T + [x, y]
    inside = [np.abs((places - s.pose[:2, 3]) @ s.pose[:2, :2]) <= s.size[:2] + 1e-9 for s in world.solids]
    return np.any(np.all([np.zeros_like(places, bool), *inside], axis=-1), axis=0)


@pytest.mark.parametrize("yaw", [0.0, 0.3, np.pi / 2, -2.0])
def test_a_turned_map_turns_about_its_lower_left_corner(tmp_path, yaw: float):
    picture = np.where(np.random.default_rng(0).random((7, 9)) < 0.4, BLACK, WHITE).astype(np.uint8)
    world = read_map(written(tmp_path, picture, resolution=0.2, origin=f"[1.0, -3.0, {yaw}]"))
    np.testing.assert_array_equal(blocked(world, picture, 0.2, 1.0, -3.0, yaw), picture == BLACK)
    assert (world.ground is None) == (yaw != 0.0)


DARK = np.array([[0, 128, 204, 255]], np.uint8)  # chances of 1, 0.5, 0.2 and 0; raw 0 per cent and three beyond 100
GREYS = np.array([[0, 19, 50, 66, 100, 101, 255]], np.uint8)
COLOURS = np.array([[[0, 0, 0, 255], [255, 255, 240, 255], [0, 0, 0, 0]]], np.uint8)
FINE = np.array([[0, 30000, 65535]], np.uint16)
MEANT = [  # pictures, keys, which cells are occupied and which free
    *((DARK, {"mode": mode}, [1, 0, 0, 0], [0, 0, 0, 1]) for mode in ("trinary", "scale", None)),
    (DARK, {"negate": 1}, [0, 0, 1, 1], [1, 0, 0, 0]),
    (DARK, {"occupied_thresh": 0.2, "free_thresh": 0.1}, [1, 1, 0, 0], [0, 0, 0, 1]),
    (DARK, {"trinary": "false"}, [1, 0, 0, 0], [0, 0, 0, 1]),
    (DARK, {"occupied_thresh": 1, "free_thresh": 0}, [1, 0, 0, 0], [0, 0, 0, 1]),
    (DARK, {"mode": "raw"}, [0, 0, 0, 0], [1, 0, 0, 0]),
    (DARK, {"occupied_thresh": None, "free_thresh": None, "negate": None}, [1, 0, 0, 0], [0, 0, 0, 1]),
    (GREYS, {"mode": "raw"}, [0, 0, 0, 1, 1, 0, 0], [1, 1, 0, 0, 0, 0, 0]),
    *((COLOURS, {"mode": mode}, [1, 0, 0], [0, 1, 0]) for mode in ("trinary", "scale")),
    (FINE, {}, [1, 0, 0], [0, 0, 1]),
]


@pytest.mark.parametrize(("picture", "keys", "occupied", "free"), MEANT)
def test_pixels_mean_what_they_mean_to_map_server(tmp_path, picture, keys, occupied, free):
    """What is neither occupied nor free is unknown: a wall unless it is said to be free."""
    path = written(tmp_path, picture, "map.png", **keys)
    assert blocked(read_map(path, "free"), picture).tolist() == [occupied]
    assert (~blocked(read_map(path), picture)).tolist() == [free]


NOTED = [
    ({"free_thresh": 0.25}, "2 cells are 205, .* count as free by free_thresh 0.25; write free_thresh: 0.196"),
    ({"trinary": "false"}, "trinary: false is the old key for mode: scale"),
    ({"mode": "scale"}, "2 cells of a chance between free_thresh and occupied_thresh count as unknown"),
    ({"origin": "[0.0, 0.0, .nan]"}, "the yaw of origin is nan and is read as 0"),
    ({"image": "/home/somebody/maps/map.pgm"}, "map.pgm does not exist; map.pgm next to the YAML file is read"),
]


@pytest.mark.parametrize(("keys", "note"), NOTED)
def test_what_is_read_otherwise_than_expected_is_reported(tmp_path, keys, note: str):
    plain = read_map(written(tmp_path, picture := drawn("#?.", "#?.")), "free")
    assert plain.notes == ()
    world = read_map(path := written(tmp_path, picture, **keys), "free")
    assert re.search(f"^{re.escape(str(path))}: .*{note}", world.notes[0])
    np.testing.assert_array_equal(blocked(world, picture), blocked(plain, picture))
    np.testing.assert_array_equal(world.ground, plain.ground)


def test_rooms_become_a_scene_that_can_be_planned_in(tmp_path, capsys):
    """Four rooms and an unknown surrounding take few boxes."""
    scene = tmp_path / "house.xml"
    task = ["--start", "2.0", "2.0", "--goal", "6.0", "6.0", "0.3"]
    assert cli.main(["import", str(written(tmp_path, rooms())), "-o", str(scene), *task]) == 0
    loaded = load(scene)
    said = capsys.readouterr().out
    assert f"{len(loaded.scene.obstacles)} of them obstacles" in said
    assert "the scene is for the rover" in said
    assert len(loaded.scene.obstacles) <= 12
    assert {obstacle.kind for obstacle in loaded.scene.obstacles} == {Kind.BOX}
    np.testing.assert_allclose([*loaded.scene.lower, *loaded.scene.upper], [0, 0, 8, 8])
    assert loaded.robot == "rover"


BOTH = {"start": [2, 2], "goal": [6, 6, 0.3]}
ASKED = [
    (BOTH, "a turned map needs --workspace X0 X1 Y0 Y1, for example "),
    ({}, "this map does not name the start and the goal: give --start X Y [TH] and --goal X Y R"),
    ({"goal": [6, 6, 0.3]}, "this map does not name the start: give --start"),
    ({"start": [2, 2], "goal": [7, 3, -0.3]}, "--goal: its radius is -0.3; it must be positive"),
]


@pytest.mark.parametrize(("task", "what"), ASKED)
def test_what_a_map_does_not_tell_is_asked_for(tmp_path, task, what: str):
    path = written(tmp_path, rooms(), origin="[0, 0, 0.2]")
    refused(lambda: import_world(path, tmp_path / "a.xml", **task), what)


def test_a_start_in_a_wall_of_a_map_is_refused_by_the_option_that_an_import_has(tmp_path):
    path = written(tmp_path, rooms())
    with pytest.raises(SceneError, match=r"the robot touches .*; choose another --start$") as caught:
        import_world(path, tmp_path / "a.xml", start=[4.0, 0.7], goal=[6, 6, 0.3])
    assert "site" not in str(caught.value)
    assert "--radius" not in str(caught.value)


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(  # gigabytes, if unfolded
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
REFUSED = [
    *(({key: "*i"}, f"{key} is ") for key in ("image", "resolution", "origin", "mode", "negate")),
    ({"image": None}, "the key image is missing"),
    ({"image": "gone.pgm"}, "gone.pgm does not exist"),
    *(({"resolution": wrong}, "the side of a cell in metres, 0.0001 to 100") for wrong in ("fine", 0, "1" + "0" * 400)),
    ({"image": "[1, 2]"}, "image is [1, 2]; it must be the name of a file"),
    ({"image": "x" * 300}, "does not exist"),
    ({"origin": "[1.0e+308, 0, 0]"}, "none beyond 1e+06"),
    ({"origin": "{a: 1}"}, "origin is {'a': 1}"),
    ({"mode": "[1]"}, "mode is [1]"),
    ({"image": "2020-99-99"}, "month must be in 1..12"),
    ({"resolution": "true"}, "resolution is True"),
    ({"origin": "[.nan, 0, 0]"}, "origin is"),
    ({"free_thresh": 0.9}, "free_thresh is 0.9 and occupied_thresh 0.65"),
    ({"negate": 2}, "negate is 2; it must be 0 or 1"),
    ({"mode": "colour"}, "mode is 'colour'; it must be one of trinary, scale, raw"),
]


@pytest.mark.parametrize(("keys", "what"), REFUSED)
def test_a_map_that_cannot_be_read_is_refused_by_file_and_key(tmp_path, keys, what: str):
    path = written(tmp_path, drawn("#."), **keys)
    path.write_text(BOMB + path.read_text())
    refused(lambda: import_world(path, tmp_path / "a.xml", **BOTH), str(path), what)
    assert not (tmp_path / "a.xml").exists()


@pytest.mark.parametrize("text", ["", "just words", "[1, 2", "image: \xff\n\tx: 1", "image: " + 1000 * "["])
def test_a_file_that_is_no_map_is_refused(tmp_path, text: str):
    (tmp_path / "map.yaml").write_bytes(text.encode("latin-1"))
    refused(lambda: read_map(tmp_path / "map.yaml"), "map.yaml: no")


@pytest.mark.parametrize("size", ["100000 100000", "12000 12000"])
def test_a_picture_that_declares_more_pixels_than_memory_holds_is_refused_unread(tmp_path, size: str, capfd):
    path = written(tmp_path, drawn("#."), image="big.pgm")
    (tmp_path / "big.pgm").write_bytes(f"P5\n{size}\n255\n".encode())
    refused(lambda: read_map(path), "big.pgm is too large", "25000000 pixels at most")
    assert capfd.readouterr().err == ""


def test_what_could_be_waited_for_without_end_is_not_opened(tmp_path):
    """In place of the map, of its picture, of a world."""
    for name in ("pipe", "pipe.yaml", "pipe.world"):
        os.mkfifo(tmp_path / name)
    refused(lambda: read_map(written(tmp_path, drawn("#."), image="pipe")), "pipe cannot be read (it is a pipe)")
    for name in ("pipe.yaml", "pipe.world"):
        source = tmp_path / name
        refused(lambda source=source: import_world(source, tmp_path / "a.xml", **BOTH), f"{name}: cannot be read (it")
