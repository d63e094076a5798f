"""Mocap bodies with a motion are read as bodies that move; what cannot move so is refused by name."""

import numpy as np
import pytest
from mjcf_samples import refusal
from plants import body, flown_over, moving_scene, rows
from repository import ROOT

from pirrht.geometry.obstacle import about_vertical
from pirrht.geometry.scene import Kind
from sim.mjcf import load

SOLID = 'type="cylinder" size=".3 .2"'
DISC = body("b", SOLID, "2 0 0.1")
GOING = "0 2 0 0  1 2 3 0"


def test_a_motion_makes_a_mover_of_its_body_and_of_bodies_in_it_and_leaves_the_rest_standing(tmp_path):
    world = """
      <geom name="wall" type="box" size=".1 1 .2" pos="4 4 .1"/>
      <body name="post" mocap="true" pos="-4 4 0.1"><geom name="post" size=".1"/></body>
      <body name="cart" mocap="true" pos="2 1 0.3" euler="0 0 90">
        <geom name="cart" type="box" size=".3 .2 .3"/>
        <geom name="paint" type="box" size=".1 .1 .1" contype="0" conaffinity="0"/>
        <geom name="roof" type="box" size=".3 .2 .1" pos="0 0 1"/>
        <body pos="1 0 0"><geom name="trailer" type="sphere" size=".2" pos="0 .5 -.2"/></body>
      </body>"""
    half = np.pi / 2
    loaded = load(moving_scene(tmp_path, world, rows("cart", f"0 2 1 {half}  2 5 1 0", repeat=True)))
    assert [o.name for o in loaded.scene.obstacles] == ["wall", "post"]
    [cart] = loaded.scene.movers
    assert (cart.name, cart.motion.repeat) == ("cart", True)
    np.testing.assert_array_equal(cart.motion.rows, [[0, 2, 1, half], [2, 5, 1, 0]])
    box, ball = cart.solids
    assert (box.name, box.kind, ball.name, ball.kind) == ("cart", Kind.BOX, "trailer", Kind.SPHERE)
    np.testing.assert_allclose(box.position, [0, 0, 0.3], atol=1e-12)
    np.testing.assert_allclose(box.rotation, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(ball.position, [1, 0.5, 0.1], atol=1e-12)
    names = {loaded.model.geom(int(g)).name for g in np.flatnonzero(loaded.moving_geoms)}
    assert names == {"cart", "paint", "roof", "trailer"}
    hits = {loaded.model.geom(int(g)).name for g in np.flatnonzero(loaded.obstacle_geoms)}
    assert hits == {"wall", "post", "cart", "trailer"}


def test_at_time_zero_the_solids_are_where_the_file_places_them(tmp_path):
    world = body("b", 'type="box" size=".3 .1 .2" pos=".2 .1 0" euler="10 20 30"', "2 0 0.1", more='euler="0 0 40"')
    [standing] = load(moving_scene(tmp_path, world, "")).scene.obstacles
    [mover] = load(moving_scene(tmp_path, world, rows("b", f"0 2 0 {np.radians(40)}  1 0 0 0"))).scene.movers
    [there] = mover.at(0.0)
    np.testing.assert_allclose(there.position, standing.position, atol=1e-12)
    np.testing.assert_allclose(there.rotation, standing.rotation, atol=1e-12)


def test_a_body_may_leave_the_workspace_and_a_scene_without_motions_has_no_movers(tmp_path):
    assert len(load(moving_scene(tmp_path, DISC, rows("b", "0 2 0 0  1 200 0 0"))).scene.movers) == 1
    assert load(moving_scene(tmp_path, DISC, "")).scene.movers == ()
    assert not load("slit").moving_geoms.any()


def test_the_example_of_the_documentation_moves(tmp_path):
    (tmp_path / "walk.xml").write_text((ROOT / "docs" / "moving.md").read_text().split("```xml")[1].split("```")[0])
    [walker] = load(tmp_path / "walk.xml").scene.movers
    np.testing.assert_array_equal(walker.motion.pose(4.5), [3.25, 3.79, 0])


JOINTED = '<body name="b" pos="2 0 0.1"><joint name="hinge"/><geom size=".3"/></body>'
FIXED = '<body name="b" pos="2 0 0.1"><geom size=".3"/></body>'
INNER = '<body name="a" pos="2 0 0.1"><body name="b"><geom size=".3"/></body></body>'
ARM = '<body><joint name="arm"/><geom size=".1"/></body>'
HANGING = f'<body name="b" mocap="true" pos="2 0 0.1"><geom size=".3"/>{ARM}</body>'
GHOST = body("b", SOLID + ' contype="0" conaffinity="0"', "2 0 0.1")
HIGH = body("b", SOLID, "2 0 1")
CUSTOM = '"pirrht_motion_b"'
REFUSED = [  # world, custom, words of the message
    (DISC, rows("b", "0 2 0 0  2 3 0 0  1 4 0 0"), (CUSTOM, "row 3", "1 s after one at 2 s")),
    (DISC, rows("b", "0 2 0 0  1 3 0"), (CUSTOM, "7 numbers", "t x y yaw")),
    (DISC, rows("b", "0 2 0 0  1 inf 0 0"), (CUSTOM, "row 2", "finite")),
    (DISC, rows("b", "0 2 0 0  1 nan 0 0"), ("pirrht_motion_b", "nan")),
    (DISC, rows("b", "1 2 0 0  2 3 0 0"), (CUSTOM, "1 s", "at 0")),
    (DISC, rows("b", "0 2 0 0  1 1e9 0 0"), (CUSTOM, "1e+09")),
    (DISC, rows("b", "0 2 0.1 0  1 3 0 0"), ('body "b"', "(2, 0)", 'pos="2 0.1 0.1"', "jump")),
    (DISC, rows("b", "0 2 0 1  1 3 0 0"), ('body "b"', "yaw 1")),
    (body("b", SOLID, "0.35 0 0.1"), rows("b", "0 0.35 0 0  1 3 0 0"), ('body "b"', "by 0.05 m", "first row")),
    (JOINTED, rows("b", GOING), ('body "b"', 'joint "hinge"', 'mocap="true"')),
    (JOINTED.replace('name="hinge"', ""), rows("b", GOING), ('body "b"', "has a joint;", 'mocap="true"')),
    (DISC, '<numeric name="pirrht_motion_b" size="8"/>', (CUSTOM, "8 numbers that are all 0")),
    (HANGING, rows("b", GOING), ('body "b"', 'joint "arm"', "without joints")),
    (DISC, rows("c", GOING), ('"pirrht_motion_c"', 'body "c"', 'move are "b"', 'mocap="true"')),
    (FIXED, rows("c", GOING), ('body "c"', "move are none")),
    (FIXED, rows("b", GOING), (CUSTOM, "no mocap body", 'mocap="true"')),
    (INNER, rows("b", GOING), (CUSTOM, "no mocap body")),
    (DISC, rows("b", GOING) + '<text name="pirrht_motion_b" data="loop"/>', (f"text {CUSTOM}", '"loop"', '"repeat"')),
    (DISC, '<text name="pirrht_motion_b" data="repeat"/>', (f"text {CUSTOM}", "<numeric")),
    (DISC, rows("b", GOING) + '<text name="pirrht_motion_d" data="repeat"/>', ('"pirrht_motion_d"', f"are {CUSTOM}")),
    (DISC, rows("b", "0 2 0 0", repeat=True), (CUSTOM, "two or more")),
    (GHOST, rows("b", GOING), ('body "b"', "contype", "remove")),
    (HIGH, rows("b", GOING), ('body "b"', "height")),
]


@pytest.mark.parametrize(("world", "custom", "words"), REFUSED)
def test_what_cannot_move_so_is_refused_with_file_and_element_and_what_to_write(tmp_path, world, custom, words):
    message = refusal(moving_scene(tmp_path, world, custom))
    assert message.startswith(str(tmp_path / "field.xml"))
    for word in words:
        assert word in message, message


def test_the_start_that_counts_is_the_one_given_and_the_footprint_there_is_what_must_be_free(tmp_path):
    path = moving_scene(tmp_path, DISC, rows("b", GOING))
    assert load(path).scene.movers
    assert 'body "b"' in refusal(path, start=(2.3, 0.1))
    world = body("b", 'type="box" size=".002 .002 .2"', "0 0.149 0.1")  # the unicycle itself does not reach there
    path = moving_scene(tmp_path, world, rows("b", "0 0 0.149 0  1 0 5 0"))
    assert 'body "b"' in refusal(path, robot="unicycle")


def test_rows_of_poses_move_a_body_in_space_and_a_motion_about_the_vertical_becomes_such_rows(tmp_path):
    box = 'type="box" size=".3 .1 .2" pos=".2 .1 0" euler="10 20 30"'
    poses = "0 2 1 3 0.6 0 0.8 0  1 5 1 4 1 0 0 0"
    [mover] = load(flown_over(tmp_path, box, poses, repeat=True)).scene.movers
    assert mover.motion.in_space
    assert mover.motion.repeat
    np.testing.assert_allclose(mover.motion.rows[0], [0, 2, 1, 3, 0.6, 0, 0.8, 0])
    world = body("b", box, "2 0 0.1", more='euler="0 0 40"')
    [standing] = load(moving_scene(tmp_path, world, "")).scene.obstacles
    file = moving_scene(tmp_path, world, rows("b", f"0 2 0 {np.radians(40)}  1 4 0 6"))
    yaw = np.radians(40)
    file.write_text(file.read_text().replace('type="cylinder" pos="45', 'type="sphere" pos="45'))
    [mover] = load(file, robot="ball").scene.movers
    [there] = mover.at(0.0)
    np.testing.assert_allclose(there.position, standing.position, atol=1e-12)
    np.testing.assert_allclose(there.rotation, standing.rotation, atol=1e-12)
    [later] = mover.at(0.7)
    turn = about_vertical(0.7 * (6 - yaw))
    np.testing.assert_allclose(later.rotation, turn @ standing.rotation, atol=1e-9)
    off = standing.position - [2.0, 0.0, 0.0]
    np.testing.assert_allclose(later.position, turn @ off + [3.4, 0.0, 0.0], atol=1e-9)


POSED = "0 2 0 1 1 0 0 0"
WRONG = [  # rows, robot, words of the message
    (f"{POSED} 1 3 0 1", None, ('"pirrht_poses_b"', "12 numbers", "t x y z", "quaternion w x y z")),
    (f"{POSED}  1 3 0 1 0 0 0 0", None, ("quaternion of row 2", "is 0")),
    (f"{POSED}  0 3 0 1 1 0 0 0", None, ("row 2", "times must increase")),
    (f"{POSED}  1 3 0 1 1 0 0 0", "puck", ('body "b" moves in space', 'write "pirrht_motion_b"', "robot in space")),
]


@pytest.mark.parametrize(("poses", "robot", "words"), WRONG)
def test_rows_of_poses_that_cannot_be_are_refused_with_a_remedy(tmp_path, poses, robot, words):
    file = flown_over(tmp_path, 'type="sphere" size=".3"', poses)
    if robot:
        file.write_text(file.read_text().replace('type="sphere" pos="45', 'type="cylinder" pos="45'))
    message = refusal(file, robot=robot)
    assert all(word in message for word in words), message


def test_a_body_that_stands_elsewhere_or_has_two_motions_is_refused(tmp_path):
    file = flown_over(tmp_path, 'type="sphere" size=".3"', f"{POSED}  1 3 0 1 1 0 0 0")
    text = file.read_text()
    file.write_text(text.replace('quat="1 0 0 0"', 'quat="0 1 0 0"'))
    message = refusal(file)
    assert all(word in message for word in ('body "b" stands at (2, 0, 1) with quat 0 1 0 0', "a jump at the start"))
    file.write_text(text.replace("</custom>", rows("b", "0 2 0 0") + "</custom>"))
    assert 'body "b" has two motions' in refusal(file)
