"""Gazebo worlds become scenes: all stands where Gazebo has it, and what cannot be taken over is named."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from sdf_samples import BALL, PLANE, ball, collision, imported, link, model, places, sdf

from sim.mjcf import load


@pytest.fixture
def run(tmp_path: Path):
    return partial(imported, tmp_path)


def test_shapes_have_their_sizes_and_the_scene_its_defaults(run):
    shapes = {
        "box": "<box><size>1 2 3</size></box>",
        "drum": "<cylinder><radius>0.3</radius><length>1</length></cylinder>",
        "ball": "<sphere><radius>0.4</radius></sphere>",
        "log": "<capsule><radius>0.2</radius><length>1</length></capsule>",
        "egg": "<ellipsoid><radii>0.3 0.4 0.5</radii></ellipsoid>",
    }
    world = "".join(
        model(f"<pose>{k + 2} 3 0 0 0 0</pose>" + link(collision(f"<geometry>{g}</geometry>")), name=name)
        for k, (name, g) in enumerate(shapes.items())
    )
    found = run(sdf(world), start=(0, 0, 1.5))
    loaded = load(found.path)
    solids = {o.name: (o.kind.value, *o.size.tolist()) for o in loaded.scene.obstacles}
    assert solids == {
        "box": ("box", 0.5, 1, 1.5),
        "drum": ("cylinder", 0.3, 0.5, 0),
        "ball": ("sphere", 0.4, 0, 0),
        "log": ("capsule", 0.2, 0.5, 0),
        "egg": ("ellipsoid", 0.3, 0.4, 0.5),
    }
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
    (pose,) = places(run(sdf(world))).values()
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
    (pose,) = places(run(sdf(world))).values()
    np.testing.assert_allclose(pose[:3, 3], expected, atol=1e-9)


def test_shapes_of_one_model_get_names_of_their_own(run):
    two = link(collision(BALL) + collision(BALL, name="d"), name="l")
    odd = model("<pose>4 2 0 0 0 0</pose>" + two, name="a &quot;&lt;b>")
    found = places(run(sdf(ball("<pose>6 3 0 0 0 0</pose>", name="floor") + odd)))
    assert list(found) == ["floor 2", 'a "<b>::l::c', 'a "<b>::l::d']


def test_ground_lights_and_what_does_not_collide_are_left_out(run):
    ground = model(link(collision(PLANE.format(size="10 8"))), name="ground")
    ghost = model(link('<visual name="v">' + BALL + "</visual>"), name="ghost", static="")
    light = '<light name="sun" type="directional"><pose>0 0 10 0 0 0</pose></light>'
    found = run(sdf(ground + ghost + light + ball("<pose>4 2 0 0 0 0</pose>")))
    assert (found.geoms, found.obstacles) == (1, 1)
    assert list(places(found)) == ["m"]


def test_a_ground_plane_with_a_modest_size_is_the_workspace(run):
    ground = model("<pose>4 1 0 0 0 0</pose>" + link(collision(PLANE.format(size="12 8"))), name="ground")
    scene = load(run(sdf(ground), workspace=None).path).scene
    np.testing.assert_allclose([*scene.lower, *scene.upper], [-2, -3, 10, 5])
