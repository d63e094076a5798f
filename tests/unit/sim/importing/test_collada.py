"""COLLADA files give the triangles that Gazebo draws: units and nodes count, the up axis does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sdf_samples import refused
from trimesh.triangles import area

from sim.importing.meshes import read_collada

CORNERS = "0 0 0  1 0 0  1 1 0  0 1 0"
QUADS = '<polylist count="1">{inputs}<vcount>4</vcount><p>0 7 1 7 2 7 3 7</p></polylist>'
PRIMITIVES = [
    '<triangles count="2">{inputs}<p>0 7 1 7 2 7 0 7 2 7 3 7</p></triangles>',
    QUADS,
    '<polygons count="1">{inputs}<p>0 7 1 7 2 7 3 7</p></polygons>',
    '<trifans count="1">{inputs}<p>0 7 1 7 2 7 3 7</p></trifans>',
    '<tristrips count="1">{inputs}<p>0 7 1 7 3 7 2 7</p></tristrips>',
]
INPUTS = '<input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>'


SCENE = """<library_visual_scenes><visual_scene id="a">{}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#a"/></scene>"""
GEOMETRY = """<geometry id="{name}" name="{name} mesh"><mesh>
<source id="s"><float_array id="f">{corners}</float_array>
<technique_common><accessor source="#f" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>{primitive}</mesh></geometry>"""
DOCUMENT = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="{unit}"/><up_axis>Y_UP</up_axis></asset>
<library_geometries>{geometries}</library_geometries>{scene}</COLLADA>"""


def document(primitive: str = QUADS, nodes: str = "", unit: str = "1", corners: str = CORNERS) -> str:
    known = {"corners": corners, "primitive": primitive.format(inputs=INPUTS)}
    geometries = "".join(GEOMETRY.format(name=name, **known) for name in ("g", "h")[: 2 if nodes else 1])
    return DOCUMENT.format(unit=unit, geometries=geometries, scene=SCENE.format(nodes) if nodes else "")


def read(tmp_path: Path, text: str, name: str = "") -> np.ndarray:
    (tmp_path / "a.dae").write_text(text)
    return read_collada(tmp_path / "a.dae", name)


@pytest.mark.parametrize("polygons", PRIMITIVES)
def test_every_kind_of_polygon_becomes_triangles(tmp_path, polygons):
    triangles = read(tmp_path, document(polygons))
    assert triangles.shape == (2, 3, 3)
    assert area(triangles).sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(triangles[..., 2], 0)  # Y_UP in the file is not obeyed


def test_units_and_transforms_of_nested_nodes_apply(tmp_path):
    nodes = (
        "<node><translate>100 0 0</translate><node><rotate>0 0 1 90</rotate><scale>2 1 1</scale>"
        '<instance_geometry url="#g"/></node></node>'
        '<node><matrix>1 0 0 0  0 1 0 500  0 0 1 0  0 0 0 1</matrix><instance_geometry url="#g"/></node>'
    )
    triangles = read(tmp_path, document(nodes=nodes, unit="0.01"))
    first, second = triangles[:2].reshape(-1, 3), triangles[2:].reshape(-1, 3)
    np.testing.assert_allclose([first.min(axis=0), first.max(axis=0)], [[0.99, 0, 0], [1, 0.02, 0]], atol=1e-12)
    np.testing.assert_allclose([second.min(axis=0), second.max(axis=0)], [[0, 5, 0], [0.01, 5.01, 0]], atol=1e-12)


@pytest.mark.parametrize("name", ["left", "h", "h mesh"])
def test_one_part_is_read_by_the_name_of_its_node_or_geometry(tmp_path, name):
    nodes = (
        '<node name="left"><translate>3 0 0</translate><instance_geometry url="#h"/></node>'
        '<node name="right"><instance_geometry url="#g"/></node>'
    )
    assert read(tmp_path, document(nodes=nodes), name)[..., 0].min() == 3.0
    assert not len(read(tmp_path, document(nodes=nodes), "middle"))


LOOP = '<node id="n"><instance_node url="#n"/></node>'
DOUBLING = "".join(f'<node id="n{k}">' + f'<instance_node url="#n{k + 1}"/>' * 2 + "</node>" for k in range(60))
BAD = [
    document(nodes=LOOP),
    document(nodes=DOUBLING + '<node id="n60"/>'),
    document(QUADS.replace("3 7<", "9 7<")),
    document(QUADS.replace("3 7<", "-1 7<")),
    document(corners="a b c"),
    document(corners="0 0"),
    document(QUADS.replace("<vcount>4", "<vcount>5")),
    document(unit="long"),
    document(nodes='<node><instance_geometry url="#nothing"/></node>'),
]


@pytest.mark.parametrize("text", BAD)
def test_malformed_files_are_refused_in_one_line(tmp_path, text):
    refused(lambda: read(tmp_path, text), "a.dae")
