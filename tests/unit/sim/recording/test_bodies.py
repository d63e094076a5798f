"""Bodies in a recording: what is drawn only changes no motion, a script makes the meshes, nothing is at the origin."""

import runpy

import mujoco
import numpy as np
import pytest
import trimesh
from drives import Drive, logged
from repository import ROOT
from rerun.chunk import RrdReader

from sim.mjcf import load, models_folder
from sim.recording import geoms

DRAWN = ["unicycle", "car", "rover", "diffdrive", "jackal", "puck", "hover"]
MESHES = models_folder() / "robots" / "meshes"


def bare(path) -> mujoco.MjSpec:
    """A robot without what is drawn only."""
    spec = mujoco.MjSpec.from_file(str(path))
    for geom in [g for g in spec.geoms if g.classname.name != "main" and not (g.contype or g.conaffinity)]:
        if not any(geom.name in (p.geomname1, p.geomname2) for p in spec.pairs):
            spec.delete(geom)
    for body in [b for b in spec.bodies if b.name.endswith("wheel") and not b.joints]:
        spec.delete(body)
    return spec


@pytest.mark.parametrize("robot", DRAWN)
def test_what_is_drawn_only_changes_no_bit_of_the_motion(robot):
    path = models_folder() / "robots" / f"{robot}.xml"
    whole, plain = mujoco.MjModel.from_xml_path(str(path)), bare(path).compile()
    assert plain.ngeom < whole.ngeom
    ends = []
    for model in (whole, plain):
        data, rng = mujoco.MjData(model), np.random.default_rng(0)
        for _ in range(300):
            data.ctrl[:] = rng.standard_normal(model.nu)
            mujoco.mj_step(model, data)
        ends.append(np.concatenate([data.qpos, data.qvel]))
    np.testing.assert_array_equal(*ends)


def test_meshes_are_what_the_script_makes_and_small(tmp_path):
    runpy.run_path(str(ROOT / "scripts" / "robot_meshes.py"))["main"](tmp_path)
    assert {f.name for f in MESHES.iterdir()} == {f.name for f in tmp_path.iterdir()}
    for made in tmp_path.iterdir():
        kept = MESHES / made.name
        assert kept.stat().st_size < 45_000
        np.testing.assert_allclose(trimesh.load(kept).triangles, trimesh.load(made).triangles, atol=1e-6)
        assert trimesh.load(kept).is_watertight


def test_geoms_of_a_body_are_in_its_own_frame():
    model = load("slit", robot="unicycle").model
    body = "robot/left rear wheel"
    solids = geoms.solids(model, model.geom_bodyid == model.body(body).id, body=body)
    assert len(solids) == 2
    for solid in solids.values():
        points = np.array(solid.vertex_positions.as_arrow_array().to_pylist()[0:]).reshape(-1, 3)
        assert np.abs(points.mean(axis=0)).max() < 2e-3
        normals = np.array(solid.vertex_normals.as_arrow_array().to_pylist()).reshape(-1, 3)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-4)


def test_whoever_reads_a_recording_from_its_beginning_never_sees_the_robot_at_the_origin(tmp_path):
    drive, file = Drive(), tmp_path / "a.rrd"
    logged(drive.recorder(file), drive.frames(0.02))
    order = [
        chunk.entity_path
        for chunk in RrdReader(str(file)).stream()
        if not chunk.is_static or "body" in chunk.entity_path
    ]
    body = next(i for i, path in enumerate(order) if path.startswith("/world/robot/body"))
    assert {"/world/robot", "/world/eyes/following"} <= set(order[:body])
