"""Worlds, tasks and targets that cannot work are refused in one line, and no file is harmed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sdf_samples import BALL, PLANE, TASK, ball, collision, link, model, sdf

from pirrht.errors import SceneError
from sim.importing.scene_file import Imported, import_world


@pytest.fixture
def run(tmp_path: Path):
    def run(text: str | bytes, **task) -> Imported:
        source = tmp_path / "maze.world"
        source.write_bytes(text if isinstance(text, bytes) else text.encode())
        return import_world(source, tmp_path / "maze.xml", **(TASK | task))

    return run


GEOMETRY = "<geometry>{}</geometry>"
MESH = "<mesh><uri>model://sofa/meshes/sofa.dae</uri></mesh>"
CHAIN = "".join(f'<frame name="f{k}"><pose relative_to="f{k + 1}"/></frame>' for k in range(2000))
BAD_WORLDS = {
    "mesh": (sdf(model(link(collision(GEOMETRY.format(MESH))))), "sofa.dae"),
    "height map": (sdf(model(link(collision(GEOMETRY.format("<heightmap/>"))))), "<heightmap>"),
    "two shapes": (sdf(model(link(collision(BALL.replace("</geometry>", "<empty/></geometry>"))))), '"c"'),
    "no shape": (sdf(model(link(collision("")))), '"c"'),
    "include": (sdf("<include><uri>model://sofa</uri></include>"), "model://sofa"),
    "include of nothing": (sdf("<include/>"), "<uri>"),
    "download": (sdf("<include><uri>https://example.org/sofa</uri></include>"), "no model on this machine"),
    "other scheme": (sdf("<include><uri>ftp://example.org/models/sofa</uri></include>"), "no model on this machine"),
    "escape": (sdf("<include><uri>model://../../../../../../etc</uri></include>"), "leads out"),
    "absolute": (sdf("<include><uri>file:///etc/passwd</uri></include>"), "leads out"),
    "itself": (sdf("<include><uri>maze.world</uri></include>"), "0 elements <model>"),
    "unexpanded": (sdf("<if><include><uri>maze.world</uri></include></if>"), "<model>"),
    "in another element": (sdf("<if>" + ball("") + "</if>"), "<if>"),
    "nested include": (sdf(model("<include><uri>model://desk</uri></include>")), "model://desk"),
    "xinclude": (sdf('<x:include xmlns:x="http://www.w3.org/2001/XInclude" href="a.sdf"/>'), "include"),
    "population": (sdf('<population name="cans"/>'), '"cans"'),
    "wall plane": (
        sdf(model("<pose>0 0 0 1.57 0 0</pose>" + link(collision(PLANE)), name="wall")),
        '"wall::l"',
    ),
    "raised plane": (
        sdf(model("<pose>0 0 1 0 0 0</pose>" + link(collision(PLANE)), name="deck")),
        '"deck::l"',
    ),
    "no radius": (sdf(ball("").replace("<radius>0.4</radius>", "")), "<radius>"),
    "negative radius": (sdf(ball("").replace("0.4", "-0.4")), "'-0.4'"),
    "infinite radius": (sdf(ball("").replace("0.4", "inf")), "'inf'"),
    "huge radius": (sdf(ball("").replace("0.4", "1e308")), "from 1e-06 to 1e+06"),
    "tiny radius": (sdf(ball("").replace("0.4", "1e-320")), "'1e-320'"),
    "huge pose": (sdf(ball("<pose>1e308 0 0 0 0 0</pose>")), "none beyond 1e+06"),
    "huge angles": (sdf(ball("<pose>4 2 0 1e308 0 0</pose>")), "none beyond 1e+06"),
    "no turn": (sdf(ball('<pose rotation_format="quat_xyzw">4 2 0 1e-320 0 0 0</pose>')), "1e-320"),
    "Python's number": (sdf(ball("<pose>4_0 2 0 0 0 0</pose>")), "4_0"),
    "negative box": (
        sdf(model(link(collision("<geometry><box><size>1 -1 1</size></box></geometry>")))),
        "'1 -1 1'",
    ),
    "never closed": ("<sdf><world>" + "<a>" * 10_000, "not XML"),
    "word as radius": (sdf(ball("").replace("0.4", "wide")), "'wide'"),
    "short pose": (sdf(ball("<pose>1 2 3</pose>")), "1 2 3"),
    "pose of nan": (sdf(ball("<pose>1 2 3 0 nan 0</pose>")), "nan"),
    "unknown frame": (sdf(ball('<pose relative_to="moon">0 0 0 0 0 0</pose>')), '"moon"'),
    "its own frame": (sdf(ball('<pose relative_to="m">0 0 0 0 0 0</pose>')), '"m"'),
    "old frame": (sdf(ball('<pose frame="a">0 0 0 0 0 0</pose>')), 'frame="a"'),
    "long chain": (sdf(CHAIN + '<frame name="f2000"/>' + ball('<pose relative_to="f0"/>')), "chain"),
    "placement": (sdf('<model name="m" placement_frame="l"><static>1</static></model>'), '"l"'),
    "twins": (sdf(ball("<pose>2 2 0 0 0 0</pose>") + ball("<pose>4 2 0 0 0 0</pose>")), 'model "m"'),
    "scaled": (sdf('<state><model name="m"><scale>2 1 1</scale></model></state>' + ball("")), "'2 1 1'"),
    "inserted": (sdf("<state><insertions><model/></insertions></state>"), "<insertions>"),
    "deep": (sdf("<model name='m'>" * 40 + "</model>" * 40), "nested"),
    "in the way": (sdf(ball("")), 'geom "m"'),
    "not closed": ("<sdf><world>", "not XML"),
    "nothing": (b"", "not XML"),
    "bytes": (bytes(range(256)), "not XML"),
    "no world": ("<sdf></sdf>", "<world>"),
    "two worlds": ("<sdf><world/><world/></sdf>", "<world>"),
    "urdf": ("<robot/>", "<robot>"),
    "unknown encoding": ('<?xml version="1.0" encoding="klingon"?><sdf/>', "not XML"),
    "document type": ('<!DOCTYPE sdf SYSTEM "file:///etc/passwd"><sdf/>', "DOCTYPE"),
    "bomb": ('<!DOCTYPE b [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><sdf>&b;</sdf>', "DOCTYPE"),
    "too large": (b"<sdf>" + b" " * (33 * 2**20) + b"</sdf>", "MiB"),
}


@pytest.mark.parametrize("case", BAD_WORLDS)
def test_a_bad_world_is_refused_in_one_line_and_nothing_is_written(run, case, tmp_path):
    text, element = BAD_WORLDS[case]
    (tmp_path / "maze.xml").write_text("what was here before")
    with pytest.raises(SceneError) as caught:
        run(text)
    message = str(caught.value)
    assert "\n" not in message
    assert "maze.world" in message
    assert element in message
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
def test_a_bad_task_is_refused_with_the_option_to_add(run, task, word, tmp_path):
    ground = model(link(collision(PLANE.format(size="100 100"))), name="ground")
    with pytest.raises(SceneError) as caught:
        run(sdf(ground + ball("<pose>4 2 0 0 0 0</pose>")), **task)
    assert word in str(caught.value)
    assert "maze.world" in str(caught.value)
    assert not list(tmp_path.glob("*.xml"))


def test_a_bad_target_or_source_is_refused(tmp_path):
    source = tmp_path / "world.xml"
    source.write_text(sdf(ball("<pose>4 2 0 0 0 0</pose>")))
    folder = tmp_path / "folder.xml"
    folder.mkdir()
    for target in (source, folder, tmp_path / "scene.mjcf", tmp_path / "nowhere" / "scene.xml"):
        with pytest.raises(SceneError, match=target.name):
            import_world(source, target, **TASK)
    for bad in (tmp_path / "missing.world", tmp_path):
        with pytest.raises(SceneError, match="cannot be read"):
            import_world(bad, tmp_path / "new.xml", **TASK)
    assert "<sdf" in source.read_text()
