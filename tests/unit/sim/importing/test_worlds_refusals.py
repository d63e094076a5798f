"""Worlds, tasks and targets that cannot work are refused in one line, and no file is harmed."""

import numpy as np
import pytest
from sdf_samples import BALL, PLANE, TASK, ball, collision, imported, link, model, refused, sdf

from pirrht.errors import SceneError
from sim.importing.scene_file import import_world

GEOMETRY = "<geometry>{}</geometry>"
MESH = "<mesh><uri>model://sofa/meshes/sofa.dae</uri></mesh>"
PART = "<mesh><uri>maze.world</uri><submesh><name>a</name></submesh></mesh>"
CHAIN = "".join(f'<frame name="f{k}"><pose relative_to="f{k + 1}"/></frame>' for k in range(2000))
BAD_WORLDS = [
    (sdf(model(link(collision(GEOMETRY.format(MESH))))), "sofa.dae"),
    (sdf(model(link(collision(GEOMETRY.format("<heightmap/>"))))), "<heightmap>"),
    (sdf(model(link(collision(GEOMETRY.format(PART))))), "<submesh>"),
    (sdf(model(link(collision(BALL.replace("</geometry>", "<empty/></geometry>"))))), '"m::l::c"'),
    (sdf(model(link(collision("")))), '"m::l::c"'),
    (sdf("<include><uri>model://sofa</uri></include>"), "model://sofa"),
    (sdf("<include/>"), "<uri>"),
    (sdf("<include><uri>https://example.org/sofa</uri></include>"), "no model on this machine"),
    (sdf("<include><uri>ftp://example.org/models/sofa</uri></include>"), "no model on this machine"),
    (sdf("<include><uri>model://../../../../../../etc</uri></include>"), "leads out"),
    (sdf("<include><uri>file:///etc/passwd</uri></include>"), "leads out"),
    (sdf("<include><uri>maze.world</uri></include>"), "0 elements <model>"),
    (sdf("<if><include><uri>maze.world</uri></include></if>"), "<model>"),
    (sdf("<if>" + ball("") + "</if>"), "<if>"),
    (sdf(model("<include><uri>model://desk</uri></include>")), "model://desk"),
    (sdf('<x:include xmlns:x="http://www.w3.org/2001/XInclude" href="a.sdf"/>'), "include"),
    (sdf('<population name="cans"/>'), '"cans"'),
    (sdf(model("<pose>0 0 0 1.57 0 0</pose>" + link(collision(PLANE)), name="wall")), '"wall::l::c"'),
    (sdf(model("<pose>0 0 1 0 0 0</pose>" + link(collision(PLANE)), name="deck")), '"deck::l::c"'),
    (sdf(ball("").replace("<radius>0.4</radius>", "")), "<radius>"),
    *((sdf(ball("").replace("0.4", bad)), f"'{bad}'; write 1 positive") for bad in ("-0.4", "inf", "1e-320", "wide")),
    (sdf(ball("<pose>1e308 0 0 0 0 0</pose>")), "none beyond 1e+06"),
    (sdf(ball('<pose rotation_format="quat_xyzw">4 2 0 1e-320 0 0 0</pose>')), "1e-320"),
    (sdf(ball("<pose>4_0 2 0 0 0 0</pose>")), "4_0"),
    (sdf(model(link(collision("<geometry><box><size>1 -1 1</size></box></geometry>")))), "'1 -1 1'"),
    ("<sdf><world>" + "<a>" * 10_000, "not XML"),
    (sdf(ball("<pose>1 2 3</pose>")), "1 2 3"),
    (sdf(ball("<pose>1 2 3 0 nan 0</pose>")), "nan"),
    (sdf(ball('<pose relative_to="moon">0 0 0 0 0 0</pose>')), '"moon"'),
    (sdf(ball('<pose relative_to="m">0 0 0 0 0 0</pose>')), '"m"'),
    (sdf(ball('<pose frame="a">0 0 0 0 0 0</pose>')), 'frame="a"'),
    (sdf(CHAIN + '<frame name="f2000"/>' + ball('<pose relative_to="f0"/>')), "chain"),
    (sdf('<model name="m" placement_frame="x"><static>1</static>' + link(collision(BALL)) + "</model>"), '"x"'),
    (sdf(ball("<pose>2 2 0 0 0 0</pose>") + ball("<pose>4 2 0 0 0 0</pose>")), 'model "m"'),
    (sdf('<state><model name="m"><scale>2 1 1</scale></model></state>' + ball("")), "'2 1 1'"),
    (sdf("<state><insertions><model/></insertions></state>"), "<insertions>"),
    (sdf("<model name='m'>" * 40 + "</model>" * 40), "nested"),
    (b"", "not XML"),
    (bytes(range(256)), "not XML"),
    ("<sdf></sdf>", "<world>"),
    ("<sdf><world/><world/></sdf>", "<world>"),
    ("<robot/>", "<robot>"),
    ('<?xml version="1.0" encoding="klingon"?><sdf/>', "not XML"),
    ('<!DOCTYPE sdf SYSTEM "file:///etc/passwd"><sdf/>', "DOCTYPE"),
    ('<!DOCTYPE b [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><sdf>&b;</sdf>', "DOCTYPE"),
    (b"<sdf>" + b" " * (33 * 2**20) + b"</sdf>", "MiB"),
]


@pytest.mark.parametrize(("text", "element"), BAD_WORLDS)
def test_a_bad_world_is_refused_in_one_line_and_nothing_is_written(text, element, tmp_path):
    (tmp_path / "maze.xml").write_text("what was here before")
    refused(lambda: imported(tmp_path, text), "maze.world", element)
    assert (tmp_path / "maze.xml").read_text() == "what was here before"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["maze.world", "maze.xml"]


BAD_TASKS = [
    ({"start": None}, "--start X Y"),
    ({"goal": None}, "--goal X Y R"),
    ({"workspace": None}, "--workspace X0 X1 Y0 Y1, for example -1 9 -1 3"),
    ({"start": (0,)}, "--start"),
    ({"start": (20, 0)}, "start"),
    ({"goal": (8, 0)}, "--goal"),
    ({"goal": (8, 0, 0)}, "goal"),
    ({"goal": (8, 0, np.nan)}, "--goal"),
    ({"goal": (8, 0, 1e-320)}, "1e-06 or more"),
    ({"goal": (8, 0, 1e308)}, "--goal X Y R"),
    ({"start": (0, 0, 1e308)}, "--start X Y [TH]"),
    ({"workspace": (-1e12, 1e12, -1, 1)}, "up to 1e+06"),
    ({"workspace": (9, -1, -5, 5)}, "least first"),
    ({"workspace": (0, 1)}, "--workspace"),
]


@pytest.mark.parametrize(("task", "word"), BAD_TASKS)
def test_a_bad_task_is_refused_with_the_option_to_add(task, word, tmp_path):
    ground = model(link(collision(PLANE.format(size="100 100"))), name="ground")
    refused(lambda: imported(tmp_path, sdf(ground + ball("<pose>4 2 0 0 0 0</pose>")), **task), "maze.world", word)
    assert not list(tmp_path.glob("*.xml"))


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("a.world", {"unknown": "free"}, "--unknown is for maps"),
        ("a.json", {"unknown": "free"}, "--unknown is for maps"),
        ("a.world", {"number": "7"}, "--world is for files of motions"),
        ("a.yaml", {"without": ["robot"]}, "only models of a Gazebo world"),
        ("a.sdf", {"decompose": True}, "--decompose is for meshes"),
        ("a.obj", {"cell": 0.1}, "--cell is for grids of voxels"),
        ("a.pgm", {}, "a.pgm: a picture has neither scale nor place; give the map's .yaml"),
    ],
)
def test_options_of_other_kinds_of_files_are_refused(tmp_path, name, options, words):
    (tmp_path / name).write_text("<sdf/>")
    refused(lambda: import_world(tmp_path / name, tmp_path / "new.xml", **TASK, **options), words)


def test_a_bad_target_or_source_is_refused(tmp_path):
    source, folder = tmp_path / "world.xml", tmp_path / "folder.xml"
    source.write_text(sdf(ball("<pose>4 2 0 0 0 0</pose>")))
    folder.mkdir()
    for target in (source, folder, tmp_path / "scene.mjcf", tmp_path / "nowhere" / "scene.xml"):
        with pytest.raises(SceneError, match=target.name):
            import_world(source, target, **TASK)
    for bad in (tmp_path / "missing.world", tmp_path):
        with pytest.raises(SceneError, match="cannot be read"):
            import_world(bad, tmp_path / "new.xml", **TASK)
