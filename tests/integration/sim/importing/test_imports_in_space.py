"""Meshes and grids of voxels become scenes in space: what is solid in the file is solid in the scene, and no more."""

import sys
from itertools import product

import numpy as np
import pytest
import trimesh
from mjcf_samples import mjcf
from repository import ROOT
from sdf_samples import refused

from pirrht.geometry.collision import Collision
from pirrht.topology.nerve import Loop, loops
from sim import cli
from sim.importing.scene_file import import_world
from sim.importing.voxels import FREE, INNER, OCCUPIED, read_voxels
from sim.mjcf import convex, load

TASK = {"start": (0.5, 0.5, 0.5), "goal": (5.5, 3.5, 2.5, 0.3)}
WORLDS = ROOT.parent / "shared" / "data" / "space"
BORDER = (0, 6, 0, 4, 0, 3)
SIDE = 0.25


def wall() -> np.ndarray:
    """Voxels of a wall with a window in it and room above it, in a room of 6 x 4 x 3 m."""
    occupied = np.zeros((24, 16, 12), dtype=bool)
    occupied[11:13, :, :10] = True
    occupied[11:13, 6:10, 4:8] = False
    return occupied


def ring(folder, name: str = "ring.obj"):
    """A ring of eight sides that stands across the way in the middle of the room."""
    mesh = trimesh.creation.annulus(0.8, 1.2, 0.4, sections=8)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.5 * np.pi, [0.0, 1.0, 0.0]))
    mesh.apply_translation([3.0, 2.0, 1.5])
    mesh.export(folder / name)
    return folder / name


def around(scene) -> list:
    """What paths can link with."""
    return [part for part in loops(Collision(scene.world, scene.footprint)) if isinstance(part, Loop)]


def tree(kind: np.ndarray) -> bytes:
    """OctoMap's binary tree of a grid of kinds that begins in the middle of its cube; parts of one kind are joined."""
    depth = int(np.ceil(np.log2(max(kind.shape))))
    kind = np.pad(kind, [(0, 2**depth - size) for size in kind.shape])

    def written(cube: np.ndarray) -> tuple[int, bytes]:
        if np.all(cube == cube.flat[0]):
            return int(cube.flat[0]), b""
        ends = slice(len(cube) // 2), slice(len(cube) // 2, None)
        parts = [written(cube[ends[x], ends[y], ends[z]]) for z, y, x in product((0, 1), repeat=3)]
        bits = sum(which << 2 * part for part, (which, _) in enumerate(parts))
        return INNER, bits.to_bytes(2, "little") + b"".join(rest for _, rest in parts)

    which, body = written(kind)
    for place in [0] * (15 - depth) + [7]:  # the first part of the last of the root's parts, over and over
        body = (which << 2 * place).to_bytes(2, "little") + body
        which = INNER
    return body


def octomap(path, occupied: np.ndarray, known: np.ndarray | None = None):
    kind = np.where(occupied, OCCUPIED, FREE) * (True if known is None else known)
    head = f"# Octomap OcTree binary file\n# a comment\nid OcTree\nsize 7\nres {SIDE}\ndata\n"
    path.write_bytes(head.encode() + tree(kind))
    return path


def saved(folder, name: str, occupied: np.ndarray):
    path = folder / name
    if path.suffix == ".bt":
        return octomap(path, occupied)
    if path.suffix == ".npy":
        np.save(path, 0.9 * occupied)
    else:
        np.savez(path, occupied=occupied, cell=SIDE, origin=[0.0, 0.0, 0.0])
    return path


@pytest.mark.parametrize(("name", "cell"), [("a.npy", SIDE), ("a.npz", None), ("a.bt", None)])
def test_a_grid_of_voxels_is_a_scene_of_few_boxes_with_the_border_of_the_grid(tmp_path, name, cell):
    imported = import_world(saved(tmp_path, name, wall()), tmp_path / "scene.xml", cell=cell, **TASK)
    assert (imported.geoms, imported.obstacles, imported.notes) == (4, 4, ())
    loaded = load(imported.path)
    scene = loaded.scene
    assert loaded.robot == "ball"
    np.testing.assert_allclose([*scene.lower, *scene.upper], [0, 0, 0, 6, 4, 3])
    np.testing.assert_allclose(
        [*scene.start, *scene.goal.center, scene.goal.radius], [0.5, 0.5, 0.5, 5.5, 3.5, 2.5, 0.3]
    )
    centres = SIDE * (np.argwhere(np.ones((24, 16, 12))) + 0.5)
    inside = Collision(scene.world, scene.footprint).true_distance(centres) <= 0.0
    np.testing.assert_array_equal(inside, wall().ravel())
    assert [len(part.members) for part in around(scene)] == [4]


@pytest.mark.parametrize("seed", range(4))
def test_a_tree_of_octomap_holds_its_voxels_and_what_is_unknown_is_free(tmp_path, seed):
    rng = np.random.default_rng(seed)
    shape = rng.integers(3, 18, 3)
    coarse = rng.random(-(-shape // 4)) < 0.4  # so that some parts are joined
    occupied = np.kron(coarse, np.ones((4, 4, 4), dtype=bool))[tuple(map(slice, shape))] ^ (rng.random(shape) < 0.05)
    known = rng.random(shape) < 0.9
    occupied[0, 0, 0] = known[0, 0, 0] = known[-1, -1, -1] = True
    world = read_voxels(octomap(tmp_path / "a.bt", occupied, known))
    found = np.zeros(shape, dtype=int)
    for solid in world.solids:
        low, high = (np.rint((solid.pose[:3, 3] + sign * solid.size) / SIDE).astype(int) for sign in (-1, 1))
        found[tuple(map(slice, low, high))] += 1
    np.testing.assert_array_equal(found, occupied & known)
    np.testing.assert_allclose(world.ground[::2], 0.0, atol=1e-9)


def test_one_solid_is_as_far_away_in_each_kind_of_file(tmp_path):
    points = np.random.default_rng(0).uniform([1, 0.5, 0.2], [5, 3.5, 2.8], (200, 3))
    faces = trimesh.load_mesh(ring(tmp_path, "ring.stl")).triangles
    nearest = [trimesh.triangles.closest_point(faces, np.tile(point, (len(faces), 1))) for point in points]
    exact = np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)
    away = np.hypot(*(points - [3.0, 2.0, 1.5]).T[1:])
    maybe = (np.abs(points[:, 0] - 3.0) <= 0.2) & (away > 0.7) & (away < 1.2)
    for kind in ("obj", "stl", "ply"):
        target = tmp_path / f"{kind}.xml"
        scene = load(import_world(ring(tmp_path, f"ring.{kind}"), target, workspace=BORDER, **TASK).path).scene
        found = Collision(scene.world, scene.footprint).true_distance(points)
        np.testing.assert_allclose(found[found > 0.0], exact[found > 0.0], atol=1e-5)
        assert 0 < np.sum(found <= 0.0) == np.sum(maybe & (found <= 0.0))
        assert len(around(scene)) == 1


def test_without_coacd_a_mesh_too_intricate_to_cut_is_taken_by_its_faces_which_a_line_tells(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "coacd", None)
    monkeypatch.setattr(convex, "MOST_CUTS", 2)
    imported = import_world(ring(tmp_path), tmp_path / "a.xml", workspace=BORDER, **TASK)
    assert imported.obstacles == 48
    (note,) = imported.notes
    assert "ring.obj: its own faces leave parts that are not convex; it is taken by 48 flat faces" in note
    assert len(around(load(imported.path).scene)) == 1


def test_a_mesh_in_a_scene_is_split_for_a_robot_in_space_and_a_hull_for_one_in_the_plane(tmp_path):
    ring(tmp_path, "ring.stl")
    path = tmp_path / "scene.xml"
    path.write_text(
        mjcf(
            '<body pos="1 0 -1.2" euler="0 0 90"><geom name="ring" type="mesh" mesh="ring" pos="0 -0.5 0"/></body>'
            '<site name="workspace" type="box" pos="0 3 1.5" size="4 4 1.5"/><site name="start" pos="-1 0 1.5"/>'
            '<site name="goal" type="sphere" pos="-1 6 1.5" size="0.3"/>',
            head='<asset><mesh name="ring" file="ring.stl"/></asset>',
        )
    )
    loaded = load(path, robot="ball")
    (note,) = loaded.notes
    assert 'geom "ring" (' in note
    assert note.endswith(f"MuJoCo collides with its {len(loaded.scene.obstacles)} convex parts, and so do plans")
    assert len(loaded.scene.obstacles) == loaded.obstacle_geoms.sum() == 8
    (loop,) = around(loaded.scene)
    assert all(name.startswith("ring #") for name in loop.names if name != "workspace")
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    middle = turn @ [3.0, 1.5, 1.5] + [1.0, 0.0, -1.2]
    distance = Collision(loaded.scene.world, loaded.scene.footprint).true_distance(np.array([middle]))
    assert 0.7 < distance[0] < 0.76
    flat = load(path, robot="puck", start=(-3.0, 0.0), goal=(-3.0, 6.0, 0.3), radius=0.3)
    assert len(flat.scene.obstacles) == 1
    assert "convex hulls of meshes, and so do plans" in flat.notes[0]


REFUSED = [
    ("a.npy", {}, "the side of its voxels is not stated; give it in metres, --cell M"),
    ("a.npy", {"cell": -1.0}, "the side of its voxels is -1; give it in metres, --cell M"),
    ("a.npy", {"cell": 0.25, "goal": (5, 3, 1)}, "[5, 3, 1] is no --goal X Y Z R"),
    ("a.npy", {"cell": 0.25, "start": (3.0, 0.5, 0.5)}, "the start (3, 0.5, 0.5) the robot touches"),
    (
        "a.obj",
        {},
        "the box around the mesh leaves out start or goal, or is wider than 50 m: add --workspace X0 X1 Y0 Y1 Z0 Z1",
    ),
    ("a.bt", {"cell": 0.25}, "a tree states the side of its voxels; leave out --cell"),
]


@pytest.mark.parametrize(("name", "task", "words"), REFUSED)
def test_a_bad_task_in_space_is_refused_in_one_line(tmp_path, name, task, words):
    path = ring(tmp_path, name) if name.endswith("obj") else saved(tmp_path, name, wall())
    refused(lambda: import_world(path, tmp_path / "new.xml", **TASK | task), name, words)


BAD = [
    ("a.npy", b"", "this is no array of NumPy"),
    ("a.npz", b"PK", "this is no array of NumPy"),
    ("a.bt", b"", "this is no binary tree of OctoMap"),
    ("a.bt", b"# Octomap OcTree file\nid OcTree\nres 0.1\ndata\n\x03\x00", "this is no binary tree of OctoMap"),
    ("a.bt", b"id OcTree\nres x\ndata\n", "this is no binary tree of OctoMap"),
    ("a.bt", b"id OcTree\nres 0.1\ndata\n\x00\x00", "none of its voxels is known"),
    ("a.bt", b"id OcTree\nres 0.1\ndata\n" + 20 * b"\x03\x00", "this is no binary tree of OctoMap"),
    ("a.bt", b"id OcTree\nres 0.1\ndata\n\x01\x80", "cells, and at most 25,000,000 are taken"),
]


@pytest.mark.parametrize(("name", "data", "words"), BAD)
def test_what_is_no_grid_of_voxels_is_refused_by_name(tmp_path, name, data, words):
    (tmp_path / name).write_bytes(data)
    refused(lambda: read_voxels(tmp_path / name, None if name == "a.bt" else 0.1), name, words)


def test_a_grid_that_is_empty_or_takes_too_many_boxes_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((3, 3, 3), dtype=bool))
    refused(lambda: read_voxels(tmp_path / "a.npy", 0.1), "none of its 27 voxels is occupied")
    np.save(tmp_path / "b.npy", np.random.default_rng(0).random((40, 40, 40)) < 0.3)
    refused(lambda: read_voxels(tmp_path / "b.npy", 0.1), "boxes, and at most 3000 are taken")
    np.save(tmp_path / "c.npy", np.zeros((3, 3), dtype=bool))
    refused(lambda: read_voxels(tmp_path / "c.npy", 0.1), "(nx, ny, nz)")


def test_a_mesh_in_millimetres_is_refused_with_the_factor(tmp_path):
    trimesh.creation.box((6000, 4000, 3000)).export(tmp_path / "a.ply")
    refused(lambda: import_world(tmp_path / "a.ply", tmp_path / "a.xml", **TASK), "6000 m wide", "scale it by 0.001")


@pytest.mark.skipif(not WORLDS.is_dir(), reason="the worlds of CTopPRM are not next to the repository")
@pytest.mark.parametrize(
    ("name", "radius", "task", "solids", "ways"),
    [
        ("1-2-1", 0.3, ["-8 -15 3.5", "8 9 3.5 0.5", "-11 15 -15.5 20 0 10"], 16, 4),
        ("0-3-0", 0.25, ["-8 -8 3.5", "8 3 3.5 0.5", "-11 15 -15 20 0 10"], 11, 3),
        ("small_random_columns", 0.2, ["-4.5 -4.5 1.5", "4.5 4.5 1.5 0.3", ""], 17, 10),
    ],
)  # fmt: skip
def test_worlds_of_others_are_scenes_with_a_loop_for_each_window_or_pair_of_pillars(
    tmp_path, capsys, name, radius, task, solids, ways
):
    words = zip(("--start", "--goal", "--workspace"), task, strict=True)
    given = [word for option, numbers in words if numbers for word in (option, *numbers.split())]
    assert cli.main(["import", str(WORLDS / f"{name}.obj"), "-o", str(tmp_path / "a.xml"), *given]) == 0
    assert capsys.readouterr().out.endswith(f"{solids} geoms, {solids} of them obstacles\n")
    assert len(around(load(tmp_path / "a.xml", radius=radius).scene)) == ways
