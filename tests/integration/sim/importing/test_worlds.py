"""Gazebo worlds and the models that they include become scenes: all stands where Gazebo has it, wherever the files are.

What cannot be taken over is named.
"""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from sdf_samples import BALL, PLANE, TASK, ball, collision, imported, link, model, places, refused, sdf

from pirrht.errors import SceneError
from sim.cli import main
from sim.importing import sdf_files
from sim.importing.scene_file import import_world
from sim.importing.solids import distinct
from sim.mjcf import load


@pytest.fixture
def run(tmp_path: Path):
    (tmp_path / "worlds").mkdir()
    return lambda world, **task: imported(tmp_path / "worlds", sdf(world), **task)


def test_shapes_have_their_sizes_and_the_scene_its_defaults(run):
    shapes = {
        "box": ("<box><size>1 2 3</size></box>", ("box", 0.5, 1, 1.5)),
        "drum": ("<cylinder><radius>0.3</radius><length>1</length></cylinder>", ("cylinder", 0.3, 0.5, 0)),
        "ball": ("<sphere><radius>0.4</radius></sphere>", ("sphere", 0.4, 0, 0)),
        "log": ("<capsule><radius>0.2</radius><length>1</length></capsule>", ("capsule", 0.2, 0.5, 0)),
        "egg": ("<ellipsoid><radii>0.3 0.4 0.5</radii></ellipsoid>", ("ellipsoid", 0.3, 0.4, 0.5)),
    }
    world = "".join(
        model(f"<pose>{k + 2} 3 0 0 0 0</pose>" + link(collision(f"<geometry>{g}</geometry>")), name=name)
        for k, (name, (g, _)) in enumerate(shapes.items())
    )
    found = run(world, start=(0, 0, 1.5))
    loaded = load(found.path)
    solids = {o.name: (o.kind.value, *o.size.tolist()) for o in loaded.scene.obstacles}
    assert solids == {name: solid for name, (_, solid) in shapes.items()}
    assert (found.geoms, found.obstacles, loaded.robot) == (5, 5, "unicycle")
    assert {**loaded.scene.defaults, "margin": 0.0} == load("clutter").scene.defaults
    np.testing.assert_allclose(loaded.scene.start, [0, 0, 1.5])
    np.testing.assert_allclose([*loaded.scene.lower, *loaded.scene.upper], [-1, -5, 9, 5])


def test_nested_poses_follow_one_another(run):
    crate = collision("<geometry><box><size>1 1 1</size></box></geometry>", pose="<pose>1 0 0 0 0 0</pose>")
    inner = model("<pose>0 2 0 0 0 1.5707963267948966</pose>" + link(crate), name="inner", static="")
    link_inside = '<link name="arm"><pose>0 0 0.5 0 0 0</pose></link>'
    world = model(f"<pose>4 -3 0 0 0 1.5707963267948966</pose>{link_inside}{inner}", name="outer")
    # outer turns (0, 2) into (-2, 0): inner is at (2, -3), half round, and its box 1 m further along -x
    (pose,) = places(run(world)).values()
    np.testing.assert_allclose(pose[:3], [[-1, 0, 0, 1], [0, -1, 0, -3], [0, 0, 1, 0]], atol=1e-9)


BASE = model("<pose>2 3 0 0 0 1.5707963267948966</pose>" + link(""), name="base")
BASE += '<frame name="mark" attached_to="base"/>'
FAR = link(collision(BALL, pose='<pose relative_to="far">0 1 0 0 0 0</pose>'), name="near")
FAR += '<link name="far"><pose>3 0 0 0 0 0</pose></link>'
BODY = '<pose>5 3 0 0 0 0</pose><link name="l"><pose>1 0 0 0 0 0</pose>' + collision(BALL) + "</link>"
STATES = [  # of which the poses of models and links are the world's, and have the last word
    ('<model name="m"><pose>3 2 0 0 0 0</pose><scale>1 1 1</scale></model>', [4, 2, 0]),
    ('<model name="m"><pose>3 2 0 0 0 0</pose><link name="l"><pose>6 1 0 0 0 0</pose></link></model>', [6, 1, 0]),
    ('<model name="someone"><pose>3 2 0 0 0 0</pose></model>', [6, 3, 0]),
    ('<model name="m"/>', [6, 3, 0]),
]
POSES = [
    *(
        (ball(f'<pose relative_to="{base}">1 0 0 0 0 0</pose>') + BASE, [2, 4, 0])
        for base in ("base", "mark", "base::l", "base::__model__")
    ),
    (model("<pose>1 2 0 0 0 0</pose>" + FAR), [4, 3, 0]),
    *((f'<state world_name="w"><sim_time>1 0</sim_time>{state}</state>' + model(BODY), at) for state, at in STATES),
]


@pytest.mark.parametrize(("world", "expected"), POSES)
def test_poses_are_relative_to_what_they_name_and_the_state_block_has_the_last_word(run, world, expected):
    (pose,) = places(run(world)).values()
    np.testing.assert_allclose(pose[:3, 3], expected, atol=1e-9)


def test_shapes_of_one_model_get_names_of_their_own(run):
    two = link(collision(BALL) + collision(BALL, name="d"), name="l")
    odd = model("<pose>4 2 0 0 0 0</pose>" + two, name="a &quot;&lt;b>")
    found = places(run(ball("<pose>6 3 0 0 0 0</pose>", name="floor") + odd))
    assert list(found) == ["floor 2", 'a "<b>::l::c', 'a "<b>::l::d']


def test_a_modest_ground_is_the_workspace_and_lights_and_what_does_not_collide_are_left_out(run):
    ground = model("<pose>4 1 0 0 0 0</pose>" + link(collision(PLANE.format(size="12 8"))), name="ground")
    ghost = model(link('<visual name="v">' + BALL + "</visual>"), name="ghost", static="")
    light = '<light name="sun" type="directional"><pose>0 0 10 0 0 0</pose></light>'
    found = run(ground + ghost + light + ball("<pose>4 2 0 0 0 0</pose>"), workspace=None)
    assert (found.geoms, found.obstacles) == (1, 1)
    assert list(places(found)) == ["m"]
    scene = load(found.path).scene
    np.testing.assert_allclose([*scene.lower, *scene.upper], [-2, -3, 10, 5])


DESK = model("<pose>0 0 9 0 0 0</pose>" + link(collision(BALL)), name="desk")


def put(folder: Path, text: str, config: str = '<sdf version="1.6">model.sdf</sdf>', name: str = "model.sdf") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(f'<sdf version="1.6">{text}</sdf>')
    (folder / "model.config").write_text(f"<model><name>a</name>{config}</model>")
    return folder


def include(uri: str, inner: str = "<pose>4 2 0 0 0 0</pose>") -> str:
    return f"<include><uri>{uri}</uri>{inner}</include>"


FUEL = "https://fuel.gazebosim.org/1.0/OpenRobotics/models"


@pytest.mark.parametrize("where", ["worlds/models", "worlds", "models", "fuel_models", "elsewhere"])
@pytest.mark.parametrize("uri", ["model://desk", "package://desk", "file://desk", f"{FUEL}/Desk", f"{FUEL}/desk/2"])
def test_models_are_found_around_the_world_and_in_the_folders_given(run, tmp_path, where, uri):
    put(tmp_path / where / "desk", DESK)
    np.testing.assert_allclose(places(run(include(uri), models=[tmp_path / "elsewhere"]))["desk"][:3, 3], [4, 2, 0])


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


def test_versions_of_a_model_hold_no_versions(run, tmp_path, monkeypatch):
    folder = tmp_path / "models" / "loop"
    folder.mkdir(parents=True)
    for link_to_itself in ("1", "2"):
        (folder / link_to_itself).symlink_to(".")
    searched = []
    glob = Path.glob
    monkeypatch.setattr(Path, "glob", lambda self, pattern: searched.append(self) or glob(self, pattern))
    with pytest.raises(SceneError, match="'model://loop' is in none of"):
        run(include("model://loop"))
    assert len(searched) < 100


def test_the_file_of_a_model_is_searched_once_and_its_copies_are_numbered(run, tmp_path, monkeypatch):
    put(tmp_path / "models" / "desk", DESK)
    searched = []
    find = sdf_files._Includes._find
    monkeypatch.setattr(sdf_files._Includes, "_find", lambda *words: searched.append(words[1]) or find(*words))
    assert list(places(run(include("model://desk") * 40))) == ["desk", *(f"desk_{k}" for k in range(39))]
    assert searched == ["model://desk", "model.sdf"]


def test_many_equal_names_are_told_apart():
    found = list(distinct(["a"] * 20_000 + ["b", "a 7"], ["b"]))
    assert (len(set(found)), found[:3]) == (len(found), ["a", "a 2", "a 3"])
    assert found[-2:] == ["b 2", "a 7 2"]


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
    put(tmp_path, ball("<pose>4 2 0 0 0 0</pose>", name="a") + ball("<pose>4 -2 0 0 0 0</pose>", name="b"))
    assert list(places(import_world(tmp_path / "model.sdf", tmp_path / "a.xml", **TASK))) == ["a", "b"]


def test_what_differs_from_gazebo_is_reported_by_name(run):
    world = (
        model("<pose>4 2 0 0 0 0</pose>" + link(collision(BALL)), name="bin", static="")
        + '<actor name="walker"/>'
        + model(link(collision("<geometry><box><size>2 2 0.01</size></box></geometry>")), name="carpet")
        + model("<pose>1 1 -7.5e8 0 0 0</pose>" + link(collision(BALL)), name="fallen")
    )
    refused(lambda: run(world), 'model "fallen"', "leave the model out by name")
    imported = run(world, without=["fallen"])
    assert list(places(imported)) == ["bin"]
    assert [note.rpartition(": ")[2] for note in imported.notes] == ["bin", "walker", "carpet"]


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
    (model("<x>" * 200_000 + "</x>" * 200_000), "nested deeper than"),
    (meshed("<uri>model.sdf</uri>"), ".dae, .obj, .ply, .stl"),
    (meshed("<uri>model.sdf</uri><scale>1 0 1</scale>"), "'1 0 1'"),
]


@pytest.mark.parametrize(("text", "words"), BAD_FILES)
def test_bad_models_are_refused_in_one_line(run, tmp_path, text, words):
    put(tmp_path / "models" / "desk", text)
    refused(lambda: run(include("model://desk")), "desk", words)
