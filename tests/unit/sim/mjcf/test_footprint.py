"""Robots with corners: as options and files name them, and the same shape in plans and in MuJoCo."""

import mujoco
import numpy as np
import pytest
from mjcf_samples import refusal
from plants import QUIET, body, problem_of, rows, scene_file

from pirrht.errors import OptionError, PirrhtError
from pirrht.geometry.footprint import Footprint
from pirrht.outcome import Outcome
from pirrht.plotting.strokes import rings
from pirrht.systems.rover import Rover
from sim.drive.executor import ClearanceChecker, Executor, Plant
from sim.mjcf import load
from sim.mjcf.footprint import PRESETS, collision_of, footprint_of
from sim.mjcf.library import models_folder
from sim.rehearsal import room_of
from sim.result import settings_json
from sim.scenario import prepare

CART = "1.0x0.4@0.2"
SHAPES = """<geom name="box" type="box" size="0.3 0.2 0.3" pos="1 0.2 0.3" euler="0 0 0.4"/>
<geom name="kerb" type="box" size="0.5 0.1 0.02" pos="-1 0 0.02"/>
<geom name="askew" type="box" size="0.2 0.3 0.1" pos="0 1.2 0.2" euler="0.5 0.3 0.2"/>
<geom name="drum" type="cylinder" size="0.25 0.4" pos="0 -1 0.4"/>
<geom name="ball" type="sphere" size="0.15" pos="1 -1.2 0.15"/>
<geom name="post" type="capsule" size="0.1 0.3" pos="-1 1 0.4"/>"""


@pytest.mark.parametrize(
    ("text", "corners"),
    [("1.0x0.4", [(-0.5, -0.2), (0.5, -0.2), (0.5, 0.2), (-0.5, 0.2)]), ("2x.5@-0.5", [(-1.5, -0.25), (0.5, 0.25)]),
     ("car", [(-0.9, -0.9), (3.6, 0.9)]), ("jackal", [(-0.254, -0.215), (0.254, 0.215)])],
)  # fmt: skip
def test_a_footprint_is_length_by_width_around_a_point_ahead_or_a_preset(text, corners):
    hull = footprint_of(text).hull
    np.testing.assert_allclose([hull.min(axis=0), hull.max(axis=0)], [np.min(corners, 0), np.max(corners, 0)])


@pytest.mark.parametrize(
    ("options", "words"),
    [({"footprint": "1x"}, "must be LENGTHxWIDTH"), ({"footprint": "jackl"}, "did you mean jackal"),
     ({"footprint": "1x0.4@0.7"}, "1x0.4@0.7: the offset is 0.7 m, which puts"), ({"footprint": "0x1"}, "0x1: "),
     ({"footprint": CART, "radius": 0.2}, "leave one of them out"),
     ({"footprint": CART, "robot": "puck"}, "needs a heading, and puck has none"),
     ({"footprint": "jackal", "robot": "hover"}, "needs a heading, and hover has none")],
)  # fmt: skip
def test_what_is_no_footprint_of_the_robot_is_refused_in_one_line(options, words):
    with pytest.raises(PirrhtError, match=words) as caught:
        load("slit", **{"robot": "rover", **options})
    assert "\n" not in str(caught.value)


def test_a_disc_among_the_presets_is_a_radius_and_a_scene_may_carry_a_footprint(tmp_path):
    assert load("house", robot="rover", footprint="turtlebot4").scene.robot_radius == 0.171
    option = '<custom><numeric name="pirrht_footprint" data="{}"/></custom>'
    file = scene_file(tmp_path, option=option.format("1 0.4 0.2"))
    assert load(file, robot="rover").scene.footprint.corners == footprint_of(CART).corners
    assert load(file, robot="rover", radius=0.3).scene.footprint.is_disc
    assert load(file, robot="rover", footprint="jackal").scene.footprint.corners == PRESETS["jackal"].corners
    words = refusal(scene_file(tmp_path, option=option.format("1")), robot="rover")
    assert 'numeric "pirrht_footprint"' in words
    assert "length, width" in words


@pytest.mark.parametrize("robot", ["rover", "unicycle", "car", "diffdrive"])
def test_mujoco_meets_an_obstacle_where_the_footprint_does(tmp_path, robot):
    option = '<compiler angle="radian"/>'
    loaded = load(scene_file(tmp_path, world=SHAPES, option=option, start="-4 -4 0"), robot=robot, footprint=CART)
    joints, rng = loaded.adapter.joints(loaded.model), np.random.default_rng(5)
    exact, data = collision_of(loaded.scene.world, loaded.scene.body), mujoco.MjData(loaded.model)
    poses = np.column_stack([rng.uniform(-2.0, 2.0, (400, 2)), rng.uniform(-np.pi, np.pi, 400)])
    mujoco.mj_resetDataKeyframe(loaded.model, data, 0)
    touching = []
    for pose in poses:
        joints.place(data, loaded.adapter.state_of(pose), np.zeros(2), np.zeros(loaded.model.nu))
        mujoco.mj_fwdPosition(loaded.model, data)
        touching.append(bool(loaded.obstacle_geoms[data.contact.geom[data.contact.dist < 0.0]].any()))
    clearance = exact.clearance(poses)
    sure = np.abs(clearance) > 2e-3  # contacts of curved solids are not exact
    apart = np.flatnonzero(sure & (np.array(touching) != (clearance <= 0.0)))
    assert 40 < np.sum(touching) < 300
    assert not len(apart), [(poses[k].tolist(), float(clearance[k]), touching[k]) for k in apart[:3]]


def test_a_robot_without_a_disc_plans_as_the_hull_of_what_collides(tmp_path, write):
    text = (models_folder() / "robots" / "rover.xml").read_text()
    start, end = text.index('<geom name="footprint"'), text.index('<geom name="hull"')
    geoms = """<geom name="base" type="box" pos="0.1 0 0.1" size="0.3 0.2 0.1"/>
    <geom name="nose" type="cylinder" pos="0.4 0 0.1" size="0.1 0.05"/>"""
    file = write(text[:start] + geoms + text[end:], "lorry.xml")
    loaded = load(scene_file(tmp_path), robot=file)
    assert not loaded.scene.footprint.is_disc
    np.testing.assert_allclose(loaded.scene.footprint.hull.min(axis=0), [-0.2, -0.2])
    assert 0.5 <= loaded.scene.footprint.hull[:, 0].max() <= 0.501  # around what is round
    assert loaded.scene.robot_height == pytest.approx(0.1)
    assert load(scene_file(tmp_path), robot=file, footprint=CART).scene.footprint.is_rectangle
    assert "give --footprint" in refusal(scene_file(tmp_path), robot=file, radius=0.3)
    slides = write(file.read_text().replace('data="rover"', 'data="single_integrator"'), "sledge.xml")
    assert 'no sphere geom "footprint"' in refusal(scene_file(tmp_path), robot=slides)


WALL = 'type="box" size="3 0.1 0.3"'


@pytest.mark.parametrize(
    ("wall", "option"),
    [(f'<geom name="wall" {WALL} pos="0 0.6 0.3"/>', ""),
     (body("wall", WALL, "0 0.6 0.3"), f"<custom>{rows('wall', '0 0 0.6 0')}</custom>")],
    ids=["static", "moving"],
)  # fmt: skip
def test_a_cart_that_turns_on_the_spot_hits_what_its_corners_reach(tmp_path, wall, option):
    """It is 0.5 m aside, and the corners reach 0.73 m."""
    loaded = load(scene_file(tmp_path, world=wall, option=option), robot="rover", footprint=CART)
    problem = problem_of(loaded, Rover(b=QUIET), R=np.diag([2.0, 0.5]))
    for plant in (Executor(loaded, problem, period=1.0), Plant(problem, period=1.0)):
        found = plant.advance(lambda x, s: np.array([0.0, 1.5]), np.random.default_rng(0))
        assert found.outcome is Outcome.COLLISION
        assert (0.7 * np.sin(plant.state[2]) + 0.2 * np.cos(plant.state[2])) == pytest.approx(0.5, abs=0.01)
    checker = ClearanceChecker(loaded.scene, loaded.adapter)
    ahead = np.array([0.0, 0.0, 0.0])
    assert checker.least(ahead[None], np.zeros(1)) == pytest.approx(0.3)
    assert checker.blocked(ahead, np.array([0.0, 0.0, np.pi]))
    assert not checker.blocked(ahead, np.array([0.5, 0.0, 0.0]))


def test_plans_and_pictures_know_the_corners_of_the_robot():
    scenario = prepare("house", robot="rover", footprint=CART, start=(4.2, 1.0, 0.4), vertices=20, samples=20)
    scene = scenario.loaded.scene
    assert scenario.margin > 0.0
    assert settings_json(scenario)["footprint"] == footprint_of(CART).hull.tolist()
    assert "footprint" not in settings_json(prepare("slit"))
    assert scene.body.corners == footprint_of(CART).corners
    assert not room_of(scene).footprint.is_disc
    poses = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.5 * np.pi]])
    tree = scenario.empty_tree()
    line = tree.steering.trajectory(tree.steering.connect(poses[:-1], poses[1:])).poses(5)
    np.testing.assert_allclose(line[[0, 1, 4]], [[1, 1, 0], [0.5, 1, 0], [0, 2, 0.5 * np.pi]], atol=1e-12)  # it backs
    legs = prepare("crossing", robot="rover", footprint=CART, vertices=20, samples=20).steering()
    timed = np.insert(poses, 2, [0.0, 2.0, 4.0], axis=1)
    again = legs.trajectory(legs.connect(timed[:-1], timed[1:])).poses(5)
    np.testing.assert_allclose(again[:4], line[:4], atol=1e-12)
    drawn = rings(scene.body, line)
    assert drawn.shape == (5, 5, 2)
    np.testing.assert_allclose(drawn[0, [0, 2]], [[0.7, 0.8], [1.7, 1.2]])
    assert rings(Footprint.disc(0.2), line[:1]).shape[1] > 20


@pytest.mark.slow
def test_a_tree_of_another_footprint_is_refused(tmp_path):
    from sim import tree_file

    one, other = (
        prepare("house", robot="rover", footprint=text, start=(4.2, 1.0, 0.4), margin=0.0, vertices=20)
        for text in (CART, "1.0x0.4")
    )
    file = tmp_path / "tree.npz"
    with file.open("wb") as stream:
        tree_file.save(one.grown_tree(), stream)
    tree_file.load(str(file), one.space, one.steering())
    with pytest.raises(OptionError, match="another task"):
        tree_file.load(str(file), other.space, other.steering())
