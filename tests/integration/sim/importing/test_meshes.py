"""A mesh becomes a scene of its convex parts."""

import sys

import numpy as np
import pytest
import trimesh

from pirrht import FreeSpace, OptionError, SceneError
from sim.importing.scene_file import import_world
from sim.mjcf import convex, load

TASK = {"start": (1.0, 1.0), "goal": (3.5, 3.5, 0.3)}
WALLS = [[(0, 0, 0), (4, 0.2, 1)], [(0, 0.3, 0), (0.2, 4, 1)]]


@pytest.fixture
def ring(tmp_path):
    """A torus so large that planes of its own faces do not cut it into a hundred convex parts."""
    trimesh.creation.torus(100.0, 3.0, major_sections=200, minor_sections=6).export(tmp_path / "ring.obj")
    return tmp_path / "ring.obj"


def parted(folder, *parts, **task):
    """A mesh of boxes between corners, and of other meshes, imported as its convex parts."""
    solids = [part if isinstance(part, trimesh.Trimesh) else trimesh.creation.box(bounds=part) for part in parts]
    trimesh.util.concatenate(solids).export(folder / "room.obj")
    return import_world(folder / "room.obj", folder / "scene.xml", decompose=True, **TASK | task)


def test_each_part_is_an_obstacle_where_it_was(tmp_path):
    imported = parted(tmp_path, *WALLS)
    scene = load(imported.path).scene
    assert (imported.geoms, imported.obstacles) == (2, 2)
    np.testing.assert_allclose([*scene.lower, *scene.upper], [0, 0, 4, 4], atol=1e-6)
    reaches = [(o.position, np.abs(o.rotation) @ o.size) for o in scene.obstacles]
    extents = [[*(at - reach), *(at + reach)] for at, reach in reaches]
    np.testing.assert_allclose(sorted(np.round(extents, 5).tolist()), np.reshape(WALLS, (2, 6)), atol=1e-5)


@pytest.mark.parametrize("low", [0.0, 0.5], ids=["shares corners", "apart"])
def test_a_floor_of_one_sheet_is_driven_over(tmp_path, low):
    floor = trimesh.Trimesh([(low, low, 0), (4, low, 0), (4, 4, 0), (low, 4, 0)], [(0, 1, 2), (0, 2, 3)])
    imported = parted(tmp_path, *WALLS, floor)
    assert (imported.geoms, imported.obstacles) == (2, 2)
    assert "driven over and left out: part " in imported.notes[0]
    FreeSpace.of(load(imported.path).scene)


@pytest.mark.parametrize("top", [0.05, 0.3])
@pytest.mark.parametrize("floors", [[(0, 4)], [(0, 2), (2, 4)]], ids=["one part", "two parts"])
def test_a_slab_under_start_and_goal_is_named_as_a_floor(tmp_path, top, floors):
    slabs = [[(low, 0, -0.1), (high, 4, top)] for low, high in floors]
    expected = rf"room.obj: \"part \d\" lies under start and goal and ends {top:g} m above.*lower the mesh by {top:g} m"
    with pytest.raises(SceneError, match=expected):
        parted(tmp_path, *WALLS, *slabs)


def test_a_block_under_the_start_alone_is_no_floor(tmp_path):
    with pytest.raises(SceneError, match=r"room.obj: the start \(1, 1\) is in collision"):
        parted(tmp_path, *WALLS, [(0.5, 0.5, 0), (1.5, 1.5, 0.05)])


@pytest.mark.parametrize(("task", "what"), [({"start": (3.5, 3.5)}, "start"), ({"goal": (3.5, 3.5, 0.2)}, "goal")])
def test_start_and_goal_are_checked_with_the_robot_that_plans(tmp_path, task, what):
    """A board that touches the top of the sphere as which the rover plans, and not the rover itself."""
    with pytest.raises(SceneError, match=rf"room.obj: the {what} \(3.5, 3.5\) is in collision.*rover"):
        parted(tmp_path, *WALLS, [(3, 3, 0.19), (4, 4, 0.3)], **{"goal": (2.0, 2.0, 0.3)} | task)
    assert not (tmp_path / "scene.xml").exists()


def test_what_would_take_coacd_minutes_is_refused(ring, tmp_path, monkeypatch):
    pytest.importorskip("coacd")
    monkeypatch.setattr(convex, "MOST_FACES", 2000)
    with pytest.raises(SceneError, match="2400 triangles would take CoACD minutes; simplify it to 2000 triangles"):
        import_world(ring, tmp_path / "scene.xml", decompose=True, **TASK)


def test_coacd_itself_parts_a_mesh(ring, tmp_path):
    pytest.importorskip("coacd")
    imported = import_world(ring, tmp_path / "scene.xml", decompose=True, workspace=(-5, 8, -5, 8), **TASK)
    assert imported.obstacles > 3
    assert load(imported.path).notes == ()


def test_without_coacd_the_extra_is_named(ring, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "coacd", None)
    with pytest.raises(OptionError, match=r"pip install 'pirrht\[decompose\]'"):
        import_world(ring, tmp_path / "scene.xml", decompose=True, **TASK)
