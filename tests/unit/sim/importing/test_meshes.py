"""Meshes become convex parts that fill what the mesh fills, and no more."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pirrht.errors import SceneError
from sim.importing.meshes import CONCAVE, split
from sim.importing.solids import as_box


def ring() -> trimesh.Trimesh:
    return trimesh.creation.annulus(2.8, 3.0, 2.0, sections=6)


def parts(mesh: trimesh.Trimesh, path: Path, **more) -> tuple[list[np.ndarray], float]:
    mesh.export(path)
    return split(path, **more)


def volume(parts: list[np.ndarray]) -> float:
    return sum(trimesh.convex.convex_hull(v).volume for v in parts)


@pytest.mark.parametrize("suffix", ["stl", "obj"])
def test_a_ring_of_walls_leaves_its_inside_free(tmp_path, suffix):
    mesh = ring()
    found, rough = parts(mesh, tmp_path / f"ring.{suffix}")
    assert len(found) == 6
    assert volume(found) == pytest.approx(mesh.volume, rel=1e-5)
    assert rough == 0


def test_normals_that_point_inward_and_mirroring_scales_change_nothing(tmp_path):
    mesh = ring()
    for scale in ((1.0, 1.0, 1.0), (-1.0, 1.0, 1.0)):
        mesh.invert()
        found, _ = parts(mesh, tmp_path / "ring.stl", scale=scale)
        assert volume(found) == pytest.approx(abs(mesh.volume), rel=1e-5)


def test_what_does_not_hang_together_is_separate(tmp_path):
    boxes = [trimesh.creation.box((1, 1, 1), trimesh.transformations.translation_matrix((x, 0, 0))) for x in (0, 5)]
    found, _ = parts(trimesh.util.concatenate(boxes), tmp_path / "two.stl", scale=(2.0, 1.0, 1.0))
    assert sorted(float(v[:, 0].mean().round(6)) for v in found) == [0.0, 10.0]
    assert volume(found) == pytest.approx(4.0)


def test_walls_without_thickness_become_plates_around_free_space(tmp_path):
    shell = trimesh.creation.box((6, 4, 2))
    shell.update_faces(np.abs(shell.face_normals[:, 2]) < 0.5)  # neither floor nor ceiling
    found, _ = parts(shell, tmp_path / "shell.stl")
    assert len(found) == 4
    assert volume(found) < 0.05


def test_a_box_without_a_bottom_is_a_box(tmp_path):
    box = trimesh.creation.box((1, 1, 1))
    box.update_faces(box.face_normals[:, 2] > -0.5)
    assert volume(parts(box, tmp_path / "box.stl")[0]) == pytest.approx(1.0)


def test_round_shapes_are_within_the_tolerance(tmp_path):
    torus = trimesh.creation.torus(1.0, 0.2)
    found, rough = parts(torus, tmp_path / "torus.stl")
    assert rough == 0
    assert abs(volume(found) - torus.volume) < CONCAVE * torus.area
    assert not any(trimesh.convex.convex_hull(v).contains([[0, 0, 0]])[0] for v in found)


def test_a_hull_is_what_is_asked_for(tmp_path):
    assert len(parts(ring(), tmp_path / "ring.stl", hull=True)[0]) == 1


def test_meshes_too_intricate_are_hulls_that_are_reported(tmp_path):
    rng = np.random.default_rng(0)
    many = trimesh.Trimesh(rng.uniform(-1, 1, (3600, 3)), np.arange(3600).reshape(-1, 3), process=False)
    found, rough = parts(many, tmp_path / "many.stl")
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
    found = as_box(local @ rotation.T + [3, 2, 1])
    assert found is not None
    pose, half = found
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    again = np.array(list(product((-1.0, 1.0), repeat=3))) * half @ pose[:3, :3].T + pose[:3, 3]
    gaps = np.linalg.norm(again[:, None] - (local @ rotation.T + [3, 2, 1]), axis=2)
    assert gaps.min(axis=1).max() < 2e-3


def test_a_frustum_is_no_box():
    local = np.array(list(product((-1.0, 1.0), repeat=3)))
    assert as_box(local * np.where(local[:, 2:] > 0, [0.9, 0.9, 1.0], 1.0)) is None
    assert as_box(local[:7]) is None


BAD = [
    ("a.stl", b"", "a.stl"),
    ("b.stl", b"solid x\nfacet", "b.stl"),
    ("c.obj", b"f 1 2 3", "c.obj"),
    ("c.obj", b"mtllib /dev/zero\nv 0 0 0\n", "mesh"),
    ("d.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", "farther out"),
    ("e.obj", b"v 1e300 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", "farther out"),
    ("f.glb", b"glTF", ".dae, .obj, .stl"),
    ("g.dae", b"<COLLADA/>", "no triangles"),
    ("h.dae", b'<!DOCTYPE a [<!ENTITY b "c">]><COLLADA/>', "DOCTYPE"),
]


@pytest.mark.parametrize(("name", "data", "words"), BAD)
def test_what_is_no_mesh_is_refused_by_name_in_one_line(tmp_path, name, data, words):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(SceneError) as caught:
        split(tmp_path / name)
    message = str(caught.value)
    assert words in message
    assert name in message
    assert "\n" not in message
