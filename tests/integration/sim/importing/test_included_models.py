"""Worlds of included models become scenes, wherever the models are, and say what is otherwise than in Gazebo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from sdf_samples import BALL, TASK, ball, collision, link, model, places, sdf

from pirrht.errors import SceneError
from sim.cli import main
from sim.importing.scene_file import Imported, import_world
from sim.mjcf import load

DESK = model("<pose>0 0 9 0 0 0</pose>" + link(collision(BALL)), name="desk")


def file(text: str) -> str:
    return f'<?xml version="1.0"?><sdf version="1.6">{text}</sdf>'


def put(folder: Path, text: str, config: str = '<sdf version="1.6">model.sdf</sdf>', name: str = "model.sdf") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(file(text))
    (folder / "model.config").write_text(f"<model><name>a</name>{config}</model>")
    return folder


def include(uri: str, inner: str = "<pose>4 2 0 0 0 0</pose>") -> str:
    return f"<include><uri>{uri}</uri>{inner}</include>"


@pytest.fixture
def run(tmp_path: Path):
    def run(world: str, **more) -> Imported:
        source = tmp_path / "worlds" / "maze.world"
        source.parent.mkdir(exist_ok=True)
        source.write_text(sdf(world))
        return import_world(source, tmp_path / "maze.xml", **(TASK | more))

    return run


FUEL = "https://fuel.gazebosim.org/1.0/OpenRobotics/models"


@pytest.mark.parametrize("where", ["worlds/models", "worlds", "models", "fuel_models", "elsewhere"])
@pytest.mark.parametrize("uri", ["model://desk", "package://desk", "file://desk", f"{FUEL}/Desk", f"{FUEL}/desk/2"])
def test_models_are_found_around_the_world_and_in_the_folders_given(run, tmp_path, where, uri):
    put(tmp_path / where / "desk", DESK)
    found = places(run(include(uri), models=[tmp_path / "elsewhere"]))
    np.testing.assert_allclose(found["desk"][:3, 3], [4, 2, 0])


def test_the_command_searches_the_folders_of_the_environment_and_of_its_option(tmp_path, monkeypatch, capsys):
    put(tmp_path / "far" / "away" / "desk", DESK)
    world = tmp_path / "here" / "is" / "the" / "maze.world"
    world.parent.mkdir(parents=True)
    world.write_text(sdf(include("model://desk") + model(link(collision(BALL)), name="bin", static="")))
    task = ["--start", "0", "3", "--goal", "8", "3", "0.5", "--workspace", "-1", "9", "-5", "5"]
    command, folder = ["import", str(world), "-o", str(tmp_path / "a.xml"), *task], str(tmp_path / "far" / "away")
    assert main(command) == 2
    assert str(world.parent) in capsys.readouterr().err
    assert main([*command, "--models", folder, "--without", "bin"]) == 0
    assert "bin" not in capsys.readouterr().out
    for variable in ("GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH"):
        with monkeypatch.context() as patch:
            patch.setenv(variable, f"/nowhere:{folder}")
            assert main(command) == 0


def test_the_ground_plane_and_the_sun_need_no_file(run):
    uris = "model://sun", "model://ground_plane", f"{FUEL}/Ground Plane", f"\n  {FUEL}/Ground%20Plane\n"
    assert run("".join(include(uri, "") for uri in uris)).geoms == 0


def test_the_configuration_names_the_file_and_caches_the_newest_version(run, tmp_path):
    versions = '<sdf version="1.10">new.sdf</sdf><sdf version="1.9">old.sdf</sdf>'
    versions += f'<sdf version="0.{"9" * 5000}">old.sdf</sdf>'
    put(tmp_path / "models" / "desk", ball("", name="old"), name="old.sdf")
    put(tmp_path / "models" / "desk", ball("", name="new"), versions, "new.sdf")
    for version in (2, 10, 9):
        put(tmp_path / "models" / "ground desk" / str(version), ball("", name=f"v{version}"))
    fuel = include(f"{FUEL}/Ground Desk", "<pose>4 -2 0 0 0 0</pose>")
    assert list(places(run(include("model://desk") + fuel))) == ["new", "v10"]


def test_an_include_names_poses_and_fixes_its_model(run, tmp_path):
    put(tmp_path / "models" / "desk", model(link(collision(BALL)), name="desk", static=""))
    put(tmp_path / "models" / "pair", model(include("model://desk") * 2, name="pair", static=""))
    turned = "<name>a</name><pose>4 -2 0 0 0 3.141592653589793</pose><static>true</static>"
    imported = run(include("model://desk") + include("model://pair", turned))
    found = places(imported)
    np.testing.assert_allclose(found["desk"][:3, 3], [4, 2, 0])
    np.testing.assert_allclose(found["a::desk"][:3, 3], [0, -4, 0], atol=1e-6)
    assert list(found) == ["desk", "a::desk", "a::desk_0"]
    assert imported.notes[0].endswith(": desk")


def test_a_placement_frame_is_where_the_pose_says(run, tmp_path):
    frames = '<frame name="corner"><pose>1 0 0 0 0 1.5707963267948966</pose></frame>'
    put(tmp_path / "models" / "desk", model(frames + link(collision(BALL)), name="desk"))
    placed = "<placement_frame>corner</placement_frame><pose>4 2 0 0 0 0</pose>"
    np.testing.assert_allclose(places(run(include("model://desk", placed)))["desk"][:3, 3], [4, 3, 0], atol=1e-9)
    here = '<model name="m" placement_frame="l"><static>1</static><pose>4 2 0 0 0 0</pose>'
    shifted = here + '<link name="l"><pose>0 1 0 0 0 0</pose>' + collision(BALL) + "</link></model>"
    np.testing.assert_allclose(places(run(shifted))["m"][:3, 3], [4, 2, 0], atol=1e-9)


@pytest.mark.parametrize("uri", ["model://desk/meshes/box.stl", "meshes/box.stl", "file://desk/meshes/box.stl"])
def test_meshes_are_obstacles_where_the_model_is(run, tmp_path, uri):
    mesh = f"<geometry><mesh><uri>{uri}</uri><scale>1 0.5 2</scale></mesh></geometry>"
    desk = model(link(collision(mesh, pose="<pose>0 0 1 0 0 0</pose>")), name="desk")
    folder = put(tmp_path / "models" / "desk", desk)
    (folder / "meshes").mkdir()
    box = trimesh.creation.box((1, 1, 1), trimesh.transformations.translation_matrix((0.5, 0.5, 0)))
    box.export(folder / "meshes" / "box.stl")
    (obstacle,) = load(run(include("model://desk", "<pose>4 2 0 0 0 1.5707963267948966</pose>")).path).scene.obstacles
    assert obstacle.kind.value == "box"
    np.testing.assert_allclose(obstacle.position, [3.75, 2.5, 1], atol=1e-6)
    np.testing.assert_allclose(np.abs(obstacle.rotation) @ obstacle.size, [0.25, 0.5, 1], atol=1e-6)


def test_models_without_a_world_are_a_world(run, tmp_path):
    source = tmp_path / "model.sdf"
    source.write_text(file(ball("<pose>4 2 0 0 0 0</pose>", name="a") + ball("<pose>4 -2 0 0 0 0</pose>", name="b")))
    assert list(places(import_world(source, tmp_path / "a.xml", **TASK))) == ["a", "b"]


def test_what_differs_from_gazebo_is_reported_by_name(run):
    carpet = collision("<geometry><box><size>2 2 0.01</size></box></geometry>")
    world = (
        model("<pose>4 2 0 0 0 0</pose>" + link(collision(BALL)), name="bin", static="")
        + '<actor name="walker"/>'
        + model(link(carpet), name="carpet")
        + model("<pose>1 1 -7.5e8 0 0 0</pose>" + link(collision(BALL)), name="fallen")
    )
    imported = run(world)
    assert list(places(imported)) == ["bin"]
    assert [note.rpartition(": ")[2] for note in imported.notes] == ["bin", "walker", "carpet", "fallen"]


def test_models_are_left_out_by_name_and_named_where_the_start_touches_them(run, tmp_path):
    robot = model("<pose>0 0 0 0 0 0</pose>" + link(collision(BALL)), name="robot", static="")
    with pytest.raises(SceneError, match=r"robot touches.*leave them out by name.*: robot"):
        run(robot)
    assert run(robot, without=["robot"]).geoms == 0
    with pytest.raises(SceneError, match="no model rover to leave out; models are robot"):
        run(robot, without=["rover"])


def test_models_that_include_each_other_or_too_much_are_refused(run, tmp_path):
    put(tmp_path / "models" / "a", model(include("model://b"), name="a"))
    put(tmp_path / "models" / "b", model(include("model://a"), name="b"))
    with pytest.raises(SceneError, match="includes itself"):
        run(include("model://a"))
    for k in range(40):
        put(tmp_path / "models" / f"d{k}", model(include(f"model://d{k + 1}") * 10, name="d"))
    put(tmp_path / "models" / "d40", DESK)
    with pytest.raises(SceneError, match="nested deeper"):
        run(include("model://d0"))
    with pytest.raises(SceneError, match=r"more than .* elements"):
        run(include("model://d20"))


def meshed(inner: str) -> str:
    return model(link(collision(f"<geometry><mesh>{inner}</mesh></geometry>")), name="desk")


BAD_FILES = [
    (ball("", name="a") + ball("", name="b"), "2 elements <model>"),
    ("<world name='w'/>", "0 elements <model>"),
    ("<model>", "not XML"),
    (model("<x>" * 200_000 + "</x>" * 200_000), "nested deeper than"),
    (model(" " * 33 * 2**20), "MiB"),
    (meshed("<uri>model://desk/a.dae</uri>"), "is in none of"),
    (meshed("<uri>model.sdf</uri>"), ".dae, .obj, .stl"),
    (meshed("<uri>model.sdf</uri><scale>1 0 1</scale>"), "'1 0 1'"),
]


@pytest.mark.parametrize(("text", "words"), BAD_FILES)
def test_bad_models_are_refused_in_one_line(run, tmp_path, text, words):
    put(tmp_path / "models" / "desk", text)
    with pytest.raises(SceneError) as caught:
        run(include("model://desk"))
    assert words in str(caught.value)
    assert "desk" in str(caught.value)
    assert "\n" not in str(caught.value)
