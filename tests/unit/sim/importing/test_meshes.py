"""Meshes become convex parts that fill what the mesh fills, and no more.

COLLADA files give the triangles that Gazebo draws: units and nodes count, the up axis does not.
"""

import sys
from itertools import product

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sdf_samples import refused
from trimesh.triangles import area

from pirrht.errors import SceneError
from sim.importing.meshes import read_collada, split
from sim.importing.solids import as_box
from sim.mjcf.convex import CONCAVE, Budget

RING = trimesh.creation.annulus(2.8, 3.0, 2.0, sections=6)
SHELL = trimesh.creation.box((6, 4, 2))  # walls without thickness, and neither floor nor ceiling
SHELL.update_faces(np.abs(SHELL.face_normals[:, 2]) < 0.5)
OPEN = trimesh.creation.box((1, 1, 1))  # a box without a bottom
OPEN.update_faces(OPEN.face_normals[:, 2] > -0.5)
INWARD = RING.copy()
INWARD.invert()
TWO = trimesh.util.concatenate([trimesh.creation.box(bounds=[(x, 0, 0), (x + 1, 1, 1)]) for x in (0, 5)])


def volume(parts: list[np.ndarray]) -> float:
    return sum(trimesh.convex.convex_hull(v).volume for v in parts)


@pytest.mark.parametrize(
    ("mesh", "name", "options", "count", "filled"),
    [
        (RING, "a.stl", {}, 6, RING.volume),
        (RING, "a.obj", {}, 6, RING.volume),
        (RING, "a.ply", {}, 6, RING.volume),
        (RING, "a.stl", {"hull": True}, 1, RING.convex_hull.volume),
        (RING, "a.stl", {"scale": (-1.0, 1.0, 1.0)}, 6, RING.volume),
        (INWARD, "a.stl", {}, 6, RING.volume),
        (TWO, "a.stl", {"scale": (2.0, 1.0, 1.0)}, 2, 4.0),
        (SHELL, "a.stl", {}, 4, 0.04),
        (OPEN, "a.stl", {}, 1, 1.0),
    ],
)
def test_parts_fill_what_the_mesh_fills(tmp_path, mesh, name, options, count, filled):
    mesh.export(tmp_path / name)
    found, rough = split(tmp_path / name, **options)
    assert len(found) == count
    assert rough == 0
    assert volume(found) == pytest.approx(filled, rel=1e-5)


def soup(triangles: np.ndarray) -> trimesh.Trimesh:
    """Triangles in any order, each from any of its corners on."""
    rng = np.random.default_rng(0)
    mixed = [np.roll(one, rng.integers(3), axis=0) for one in rng.permutation(triangles)]
    return trimesh.Trimesh(np.reshape(mixed, (-1, 3)), np.arange(3 * len(mixed)).reshape(-1, 3), process=False)


def crates() -> trimesh.Trimesh:
    """Three thin crates side by side, with both faces where two of them meet."""
    bounds = [[(0.1 * x, 0, 0), (0.1 * x + 0.1, 1, 1)] for x in range(3)]
    return trimesh.util.concatenate([trimesh.creation.box(bounds=one) for one in bounds])


@pytest.mark.parametrize(("mesh", "count"), [(RING, 6), (SHELL, 4), (TWO, 2), (crates(), 3)])
@pytest.mark.parametrize("second", [np.s_[:, ::-1], np.s_[::2, ::-1], np.s_[:, :]], ids=["back", "part", "again"])
def test_a_surface_that_is_stored_from_both_sides_counts_once(tmp_path, mesh, count, second):
    soup(np.concatenate([mesh.triangles, mesh.triangles[second]])).export(tmp_path / "both.stl")
    soup(mesh.triangles).export(tmp_path / "one.stl")
    found, rough = split(tmp_path / "both.stl")
    expected, _ = split(tmp_path / "one.stl")
    assert len(found) == len(expected) == count
    assert rough == 0
    assert volume(found) == pytest.approx(volume(expected), rel=1e-5)


def test_a_closed_surface_may_be_wound_in_both_ways(tmp_path):
    triangles = RING.triangles.copy()
    triangles[::3] = triangles[::3, ::-1]
    soup(triangles).export(tmp_path / "ring.stl")
    found, _ = split(tmp_path / "ring.stl")
    assert len(found) == 6
    assert volume(found) == pytest.approx(RING.volume, rel=1e-5)


def test_both_sides_of_other_triangles_are_no_block_without_a_word(tmp_path):
    corners = np.array(
        [(r * x, r * y, z) for z in (0, 1) for r in (2.0, 3.0) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    )
    around = [(a, (a + 1) % 4) for a in range(4)]
    quads = [(k + a, k + b, k + 8 + b, k + 8 + a) for k in (0, 4) for a, b in around]
    quads += [(k + a, k + b, k + 4 + b, k + 4 + a) for k in (0, 8) for a, b in around]
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d), (d, b, a), (d, c, b))]
    soup(corners[faces]).export(tmp_path / "ring.stl")
    found, rough = split(tmp_path / "ring.stl")
    assert len(found) == 1
    assert rough > CONCAVE


def test_walls_that_share_corners_with_a_floor_are_parts_of_their_own(tmp_path):
    walls = [trimesh.creation.box(bounds=one) for one in ([(0, 0, 0), (6, 0.2, 1)], [(0, 3.8, 0), (6, 4, 1)])]
    floor = trimesh.Trimesh([(0, 0, 0), (6, 0, 0), (6, 4, 0), (0, 4, 0)], [(0, 1, 2), (0, 2, 3)])
    trimesh.util.concatenate([*walls, floor]).export(tmp_path / "room.stl")
    found, _ = split(tmp_path / "room.stl")
    assert sorted(round(float(np.ptp(corners[:, 2])), 3) for corners in found) == [0.001, 1.0, 1.0]


def test_what_is_left_to_split_when_the_work_is_done_is_a_hull_that_is_reported(tmp_path):
    RING.export(tmp_path / "ring.stl")
    trimesh.creation.icosphere(2).export(tmp_path / "ball.stl")
    budget = Budget(1e5)
    found, rough = split(tmp_path / "ring.stl", budget=budget)
    assert len(found) == 1
    assert rough > CONCAVE
    assert budget.left < 0.0
    assert split(tmp_path / "ball.stl", budget=budget)[1] == 0  # a hull anyway


def test_round_shapes_are_within_the_tolerance(tmp_path):
    torus = trimesh.creation.torus(1.0, 0.2)
    torus.export(tmp_path / "torus.stl")
    found, rough = split(tmp_path / "torus.stl")
    assert rough == 0
    assert abs(volume(found) - torus.volume) < CONCAVE * torus.area
    assert not any(trimesh.convex.convex_hull(v).contains([[0, 0, 0]])[0] for v in found)


def test_meshes_too_intricate_are_hulls_that_are_reported(tmp_path):
    corners = np.random.default_rng(0).uniform(-1, 1, (3600, 3))
    trimesh.Trimesh(corners, np.arange(3600).reshape(-1, 3), process=False).export(tmp_path / "many.stl")
    found, rough = split(tmp_path / "many.stl")
    assert len(found) == 1
    assert rough > 0.5


@given(
    st.lists(st.floats(0.01, 50.0), min_size=3, max_size=3),
    st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    st.permutations(range(8)),
)
def test_a_box_is_found_from_its_corners_in_any_order(sizes, turn, order):
    rotation = Rotation.from_euler("xyz", turn).as_matrix()
    local = np.array(list(product((-1.0, 1.0), repeat=3)))[order] * sizes
    pose, half = as_box(local @ rotation.T + [3, 2, 1])
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    again = np.array(list(product((-1.0, 1.0), repeat=3))) * half @ pose[:3, :3].T + pose[:3, 3]
    assert np.linalg.norm(again[:, None] - (local @ rotation.T + [3, 2, 1]), axis=2).min(axis=1).max() < 2e-3


def test_a_frustum_is_no_box():
    local = np.array(list(product((-1.0, 1.0), repeat=3)))
    assert as_box(local * np.where(local[:, 2:] > 0, [0.9, 0.9, 1.0], 1.0)) is None
    assert as_box(local[:7]) is None


BAD = [
    ("a.stl", b"", "a.stl"),
    ("a.ply", b"ply\nformat binary_little_endian 1.0\nend_header\n\xff", "a.ply"),
    ("b.stl", b"solid x\nfacet", "b.stl"),
    ("c.obj", b"f 1 2 3", "c.obj"),
    ("c.obj", b"mtllib /dev/zero\nv 0 0 0\n", "mesh"),
    ("d.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", "farther out"),
    ("e.obj", b"v 1e300 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", "farther out"),
    ("f.glb", b"glTF", ".dae, .obj, .ply, .stl"),
    ("g.dae", b"<COLLADA/>", "no triangles"),
    ("h.dae", b'<!DOCTYPE a [<!ENTITY b "c">]><COLLADA/>', "DOCTYPE"),
]


@pytest.mark.parametrize(("name", "data", "words"), BAD)
def test_what_is_no_mesh_is_refused_by_name_in_one_line(tmp_path, name, data, words):
    (tmp_path / name).write_bytes(data)
    refused(lambda: split(tmp_path / name), name, words)


def test_text_that_is_not_utf_8_needs_no_other_library(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "charset_normalizer", None)
    (tmp_path / "a.obj").write_bytes(b"# T\xfcr\no T\xfcr\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(split(tmp_path / "a.obj")[0]) == 1
    (tmp_path / "b.stl").write_bytes(b"\xff\xfe\x80" * 40)
    with pytest.raises(SceneError, match=r"b.stl: (this is no mesh|it has no triangles)") as caught:
        split(tmp_path / "b.stl")
    assert "charset" not in str(caught.value)


CORNERS = "0 0 0  1 0 0  1 1 0  0 1 0"
QUADS = '<polylist count="1">{inputs}<vcount>4</vcount><p>0 7 1 7 2 7 3 7</p></polylist>'
TRIANGLES = '<triangles count="2">{inputs}<p>0 7 1 7 2 7 0 7 2 7 3 7</p></triangles>'
POLYGONS = '<polygons count="1">{inputs}<p>0 7 1 7 2 7</p><p>0 7 2 7 3 7</p></polygons>'
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


def read(tmp_path, text: str) -> np.ndarray:
    (tmp_path / "a.dae").write_text(text)
    return read_collada(tmp_path / "a.dae")


@pytest.mark.parametrize("polygons", [QUADS, TRIANGLES, TRIANGLES + "<lines/>", POLYGONS])
def test_polygons_become_triangles(tmp_path, polygons):
    triangles = read(tmp_path, document(polygons))
    assert triangles.shape == (2, 3, 3)
    assert area(triangles).sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(triangles[..., 2], 0)  # Y_UP in the file is not obeyed


def test_corners_of_four_numbers_are_read_by_their_stride(tmp_path):
    wide = document(corners="0 0 0 9  1 0 0 9  1 1 0 9  0 1 0 9").replace('stride="3"', 'stride="4"')
    np.testing.assert_array_equal(read(tmp_path, wide), read(tmp_path, document()))


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


LOOP = '<node id="n"><instance_node url="#n"/></node>'
DOUBLING = "".join(f'<node id="n{k}">' + f'<instance_node url="#n{k + 1}"/>' * 2 + "</node>" for k in range(60))
MALFORMED = [
    document(nodes=LOOP),
    document(nodes=DOUBLING + '<node id="n60"/>'),
    document("<tristrips/>"),
    document(nodes='<node><instance_controller url="#g"/></node>'),
    document(QUADS.replace("3 7<", "9 7<")),
    document(QUADS.replace("3 7<", "-1 7<")),
    document(corners="a b c"),
    document(corners="0 0"),
    document(QUADS.replace("<vcount>4", "<vcount>5")),
    document(unit="long"),
    document(nodes='<node><instance_geometry url="#nothing"/></node>'),
]


@pytest.mark.parametrize("text", MALFORMED)
def test_malformed_files_are_refused_in_one_line(tmp_path, text):
    refused(lambda: read(tmp_path, text), "a.dae")
