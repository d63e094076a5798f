"""A mesh becomes a scene of its convex parts."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from pirrht.errors import OptionError, SceneError
from sim.importing.scene_file import import_world
from sim.mjcf import load

TASK = {"start": (1.0, 1.0), "goal": (3.5, 3.5, 0.3)}


@pytest.fixture
def angle(tmp_path: Path) -> Path:
    """Two walls as one mesh."""
    walls = [
        trimesh.creation.box(bounds=[(0, 0, 0), (4, 0.2, 1)]),
        trimesh.creation.box(bounds=[(0, 0.3, 0), (0.2, 4, 1)]),
    ]
    path = tmp_path / "angle.obj"
    trimesh.util.concatenate(walls).export(path)
    return path


@pytest.fixture
def ring(tmp_path: Path) -> Path:
    """A torus so large that planes of its own faces do not cut it into a hundred convex parts."""
    path = tmp_path / "ring.obj"
    trimesh.creation.torus(100.0, 3.0, major_sections=200, minor_sections=6).export(path)
    return path


@pytest.fixture
def parted(monkeypatch):
    """CoACD, as far as it is used: a part for each solid that hangs together."""

    def run(mesh, *, threshold, preprocess_mode):
        assert (threshold, preprocess_mode) == (0.05, "off")
        parts = trimesh.Trimesh(mesh.vertices, mesh.faces).split()
        return [[part.vertices, part.faces] for part in parts]

    fake = SimpleNamespace(
        Mesh=lambda vertices, faces: SimpleNamespace(vertices=vertices, faces=faces),
        run_coacd=run,
        set_log_level=lambda level: None,
    )
    monkeypatch.setitem(sys.modules, "coacd", fake)


def test_each_part_is_an_obstacle_where_it_was(angle, tmp_path):
    imported = import_world(angle, tmp_path / "scene.xml", decompose=True, **TASK)
    scene = load(imported.path).scene
    assert (imported.geoms, imported.obstacles) == (2, 2)
    np.testing.assert_allclose([*scene.lower, *scene.upper], [0, 0, 4, 4], atol=1e-6)
    reaches = [np.abs(solid.rotation) @ solid.size for solid in scene.obstacles]
    extents = [[*(o.position - r), *(o.position + r)] for o, r in zip(scene.obstacles, reaches, strict=True)]
    expected = [[0, 0, 0, 4, 0.2, 1], [0, 0.3, 0, 0.2, 4, 1]]
    np.testing.assert_allclose(sorted(np.round(extents, 5).tolist()), expected, atol=1e-5)


def test_a_mesh_that_its_own_faces_do_not_cut_is_parted_by_coacd(ring, parted, tmp_path):
    task = {"start": (105.0, 105.0), "goal": (108.0, 108.0, 0.3), "workspace": (104.0, 110.0, 104.0, 110.0)}
    assert import_world(ring, tmp_path / "scene.xml", decompose=True, **task).geoms == 1


def test_coacd_itself_parts_a_mesh(ring, tmp_path):
    pytest.importorskip("coacd")
    imported = import_world(ring, tmp_path / "scene.xml", decompose=True, workspace=(-5, 8, -5, 8), **TASK)
    assert imported.obstacles > 3
    assert load(imported.path).notes == ()


def test_a_mesh_without_the_switch_and_the_switch_without_a_mesh_are_refused(angle, tmp_path):
    with pytest.raises(OptionError, match="add --decompose"):
        import_world(angle, tmp_path / "scene.xml", **TASK)
    (tmp_path / "hall.sdf").write_text("<sdf/>")
    with pytest.raises(OptionError, match="is for meshes"):
        import_world(tmp_path / "hall.sdf", tmp_path / "scene.xml", decompose=True, **TASK)


def test_without_coacd_the_extra_is_named(ring, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "coacd", None)
    with pytest.raises(OptionError, match=r"pip install 'pirrht\[decompose\]'"):
        import_world(ring, tmp_path / "scene.xml", decompose=True, **TASK)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "mesh"),
        (b"v 0 0 0\n", "mesh"),
        (b"v 0 0 0\nv 1e7 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n", "farther out"),
        (b"mtllib /dev/zero\nv 0 0 0\n", "mesh"),
        (bytes(range(256)), "mesh"),
    ],
)
def test_what_is_no_mesh_is_refused_in_one_line(content, reason, tmp_path):
    path = tmp_path / "room.obj"
    path.write_bytes(content)
    with pytest.raises(SceneError, match=reason) as caught:
        import_world(path, tmp_path / "scene.xml", decompose=True, **TASK)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "scene.xml").exists()
