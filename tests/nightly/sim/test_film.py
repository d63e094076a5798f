"""Films of drives: pictures of the scene with references and path, and one line where none can be made."""

import io
import sys

import numpy as np
import pytest

from pirrht.errors import OptionError
from sim import film
from sim.cli import main
from sim.files import replaced
from sim.mjcf import load
from sim.scenario import prepare

SHORT = ["run", "slit", "--noise", "0.3", "--vertices", "80", "--samples", "20", "--max-time", "0.4"]


@pytest.fixture
def graphics(monkeypatch):
    """Small pictures, where anything can draw them."""
    monkeypatch.setattr(film, "WIDTH", 320)
    monkeypatch.setattr(film, "HEIGHT", 180)
    try:
        film.Film(load("slit"), size=(8, 8)).close()
    except OptionError as error:
        pytest.skip(str(error))


def yellow(picture) -> int:
    """Pixels in the colour of the driven path."""
    red, green, blue = (picture[..., k].astype(int) for k in range(3))
    return int(np.sum((red > 180) & (green > 140) & (blue < 110) & (red - green < 90)))


@pytest.mark.parametrize("more", [[], ["--plant", "sde"], ["--method", "passive"], ["--sense", "lidar"]])
def test_a_film_shows_the_drive_and_a_still_its_end(graphics, tmp_path, capsys, more):
    av, image = pytest.importorskip("av"), pytest.importorskip("PIL.Image")
    video, still = tmp_path / "a.mp4", tmp_path / "a.png"
    assert main([*SHORT, *more, "--video", str(video), "--png", str(still)]) == 1
    assert str(video) in capsys.readouterr().out
    with av.open(str(video)) as container:
        track = container.streams.video[0]
        assert (track.codec_context.name, track.average_rate) == ("h264", film.RATE)
        pictures = [picture.to_ndarray(format="rgb24") for picture in container.decode(track)]
    assert len(pictures) == 1 + int(0.4 * film.RATE) + round(film.HOLD * film.RATE)
    last = np.asarray(image.open(still))
    assert last.shape == pictures[0].shape == (180, 320, 3)
    assert np.abs(pictures[-1].astype(int) - last).mean() < 6.0
    assert yellow(last) > yellow(pictures[0]) + 10  # who has no samples brakes, and leaves a short trace
    assert sorted(tmp_path.iterdir()) == [video, still]


def shot(scene, size, time=0.0, drawn=False, **given):
    """A picture of a short drive at a time of it [s]."""
    scenario = prepare(scene, given=given)
    driver = scenario.driver(scenario.grown_tree())
    one = film.Film(scenario.loaded, size=size)
    for frame in scenario.drive(scenario.plant(), driver):
        one.add(frame, driver.path_integral if drawn else None)
    (picture,) = one.shots([time])
    one.close()
    return picture


@pytest.mark.parametrize(("scene", "noise"), [("slit", 0.3), ("window", 0.5)])
def test_a_film_shows_samples_in_the_colours_of_their_classes(graphics, scene, noise):
    given = {"noise": noise, "vertices": 200, "samples": 40, "max_time": 0.05}
    pictures = [shot(scene, (1280, 720), drawn=drawn, **given) for drawn in (True, False)]
    changed = np.abs(pictures[0].astype(int) - pictures[1]).max(axis=2) > 20
    assert changed.sum() > 1000
    assert ((np.ptp(pictures[0].astype(int), axis=2) > 80) & changed).sum() > 100


BARE = """<mujoco model="bare">
  <worldbody>
    <geom name="floor" type="plane" pos="2 1 0" size="2 1 0.1"/>
    <geom name="post" type="cylinder" pos="2 1 0.25" size="0.3 0.25"/>
    <site name="start" pos="0.4 1 0"/>
    <site name="goal" type="cylinder" pos="3.5 1 0" size="0.3 0.01"/>
    <site name="workspace" type="box" pos="2 1 0.5" size="2 1 0.5"/>
  </worldbody>
</mujoco>"""


def test_what_a_scene_says_nothing_of_has_light_colours_and_a_sky(graphics, tmp_path):
    """The goal is green, the floor bright, the post darker than it, nothing black, and no workspace hides them."""
    (tmp_path / "bare.xml").write_text(BARE)
    picture = shot(tmp_path / "bare.xml", (320, 180), vertices=50, samples=10, max_time=0.02)
    red, green, blue = (picture[..., k].astype(int) for k in range(3))
    assert np.sum((green > red + 40) & (green > blue + 30)) > 200
    assert tuple(picture[0, -1]) == film.SKY
    floor, post = picture[150, 160].astype(int), picture[85, 160].astype(int)
    assert floor.min() > 140
    assert post.max() < floor.min() - 30
    assert np.mean(picture.max(axis=-1) < 20) < 0.01


@pytest.mark.parametrize("robot", ["puck", "unicycle", "diffdrive", "hover", "rover", "car", "ball", "drone"])
def test_every_robot_is_drawn_where_it_is(graphics, robot):
    scene, ends = ("window", (0.8, 5.6)) if robot in ("ball", "drone") else ("slit", (1.5, 4.0))
    one, seen = film.Film(load(scene, robot=robot), size=(320, 180)), []
    for x in ends:
        one._pose(np.array([x, 1.0, *6 * [0.0]]), 0.0)
        seen.append(one._draw([("0.0 s", film.INK)]).astype(int))
    one.close()
    columns = np.flatnonzero(np.abs(seen[0] - seen[1]).sum(axis=2).max(axis=0) > 60)
    assert columns.min() < 130 < 190 < columns.max()


def test_a_film_shows_how_a_drone_tilts(graphics):
    scenario = prepare("window", robot="drone", given={"vertices": 80, "samples": 20, "max_time": 0.3})
    one = film.Film(scenario.loaded, size=(64, 36))
    for frame in scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())):
        one.add(frame)
    one.shots([np.inf])
    one.close()
    np.testing.assert_array_equal(one._data.qpos[3:7], frame.advance.attitudes[-1])
    assert np.abs(frame.advance.attitudes[:, 1:]).max() > 0.001


def test_pictures_name_moving_obstacles_and_show_the_time_and_the_classes(graphics, monkeypatch):
    told, noted, draw = list[str](), list[str](), film.Film._draw

    def noting(self, rows):
        shapes = self._shapes.geoms[: self._shapes.ngeom]
        told.extend(shape.label for shape in shapes if shape.type == film.mujoco.mjtGeom.mjGEOM_LABEL)
        noted.extend(text for text, _ in rows)
        return draw(self, rows)

    monkeypatch.setattr(film.Film, "_draw", noting)
    for scene in ("crossing", "slit"):
        shot(scene, (64, 36), 0.1, vertices=60, samples=20, period=0.1, max_time=0.2)
    assert told == ["crosser"]
    assert noted.count("0.1 s") == 2
    assert all(row.endswith(" %") for row in noted if row != "0.1 s")


def test_the_last_picture_says_how_a_drive_ended_and_others_call_classes_as_asked(graphics, monkeypatch):
    noted, draw = list[list[str]](), film.Film._draw
    monkeypatch.setattr(
        film.Film, "_draw", lambda self, rows: noted.append([text for text, _ in rows]) or draw(self, rows)
    )
    for scene, ways in (("slit", {"0,0": "the slit"}), ("window", {"0": "the window"})):
        scenario = prepare(scene, given={"noise": 0.1, "vertices": 100, "samples": 20, "period": 0.1, "max_time": 0.2})
        one, driver = film.Film(scenario.loaded, size=(64, 36), ways=ways), scenario.driver(scenario.grown_tree())
        for frame in scenario.drive(scenario.plant(), driver):
            one.add(frame)
        one.shots([0.1, np.inf])
        one.close()
        (_, *rows), end = noted[-2:]
        assert rows[0].startswith(f"{next(iter(ways.values()))}  ")
        assert end == ["timeout after 0.2 s"]


@pytest.mark.parametrize("size", [(320, 180), (960, 540), (1280, 720), (1920, 1080)])
def test_texts_stay_within_their_panel_in_pictures_of_any_size(graphics, size):
    loaded = load("slit")
    one = film.Film(loaded, size=size)
    one._pose(loaded.scene.start[:2], 0.0)
    picture = one._draw([("-10,0,0  100 %", (255, 0, 255)), ("-10,0,1  100 %", (255, 0, 255))]).astype(int)
    one.close()
    rows, columns = np.nonzero(np.minimum(picture[..., 0], picture[..., 2]) - picture[..., 1] > 100)
    panel = picture.max(axis=2) < 70
    assert 0 < rows.min() < rows.max() < np.argmin(panel[:, 0])
    assert 0 < columns.min() < columns.max() < np.argmin(panel[0])


class Full(io.BytesIO):
    """A disk on which there is room for the beginning of a film."""

    def write(self, content) -> int:
        if self.tell() + len(content) > 100_000:
            raise OSError(28, "No space left on device")
        return super().write(content)


def test_a_film_on_a_full_disk_costs_one_line_and_leaves_nothing(tmp_path):
    pytest.importorskip("av")
    rng = np.random.default_rng(0)
    noise = (rng.integers(0, 255, (film.HEIGHT, film.WIDTH, 3), dtype=np.uint8) for _ in range(8))
    with pytest.raises(OptionError, match="No space left on device"), replaced(tmp_path / "a.mp4", "--video"):
        film._encode(Full(), noise)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("typed", "reason"), [("--video a.avi", ".mp4"), ("--png a.jpg", ".png"), ("--video no/a.mp4", "does not exist")]
)
def test_a_file_that_cannot_be_made_is_refused_before_the_drive(tmp_path, monkeypatch, refused, typed, reason):
    pytest.importorskip("av")
    monkeypatch.chdir(tmp_path)
    refused([*SHORT, *typed.split()], reason)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere there is one way of drawing")
def test_without_graphics_one_line_says_what_to_install(tmp_path, monkeypatch, refused):
    pytest.importorskip("PIL")
    monkeypatch.setattr(film, "CHOSEN", None)
    monkeypatch.setattr(film, "BACKEND", "nowhere")
    refused([*SHORT, "--png", str(tmp_path / "a.png")], "nowhere", "libosmesa6")
