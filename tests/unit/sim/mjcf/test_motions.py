"""Mocap bodies with a motion are read as bodies that move; what cannot move so is refused by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mjcf_samples import refusal
from moving_scenes import body, moving_scene, rows
from repository import ROOT

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
    scene = loaded.scene
    assert [o.name for o in scene.obstacles] == ["wall", "post"]
    [cart] = scene.movers
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
    path = moving_scene(tmp_path, world, "")
    [standing] = load(path).scene.obstacles
    [mover] = load(moving_scene(tmp_path, world, rows("b", f"0 2 0 {np.radians(40)}  1 0 0 0"))).scene.movers
    [there] = mover.at(0.0)
    np.testing.assert_allclose(there.position, standing.position, atol=1e-12)
    np.testing.assert_allclose(there.rotation, standing.rotation, atol=1e-12)


def test_a_body_may_leave_the_workspace_and_a_scene_without_motions_has_no_movers(tmp_path):
    assert len(load(moving_scene(tmp_path, DISC, rows("b", "0 2 0 0  1 200 0 0"))).scene.movers) == 1
    assert load(moving_scene(tmp_path, DISC, "")).scene.movers == ()
    assert not load("slit").moving_geoms.any()


@pytest.mark.parametrize("name", ["crossing", "closing_door", "pincer"])
def test_a_built_in_scene_has_the_geometry_of_its_definition(name):
    loaded = load(name)
    expected = {
        "crossing": ([], {"crosser": [[0, 3.25, 1.09, 0], [4.5, 3.25, 3.79, 0]]}, [5.5, 2.5, 0.3]),
        "closing_door": (
            [([3.1, 1.075], [0.1, 1.075]), ([3.1, 3.175], [0.1, 0.325])],
            {"door": [[0, 3.1, 1.7, 0], [0.3, 3.1, 1.7, 0], [1.7, 3.1, 2.5, 0]]},
            [5.2, 2.5, 0.3],
        ),
        "pincer": (
            [],
            {"low": [[0, 3.25, 1.35, 0], [1.9, 3.25, 2.25, 0]], "high": [[0, 3.25, 3.75, 0], [1.9, 3.25, 2.85, 0]]},
            [5.5, 2.5, 0.3],
        ),
    }
    walls, motions, goal = expected[name]
    scene = loaded.scene
    assert (loaded.robot, scene.robot_radius) == ("puck", 0.1)
    assert [([*o.position[:2]], [*o.size[:2]]) for o in scene.obstacles] == walls
    assert {m.name: m.motion.rows.tolist() for m in scene.movers} == motions
    for mover in scene.movers:
        [solid] = mover.solids
        np.testing.assert_allclose(solid.position, [0, 0, 0.2])
        size = [0.08, 0.4, 0.198] if name == "closing_door" else [0.3, 0.2, 0.0]
        np.testing.assert_allclose(solid.size, size)
    np.testing.assert_allclose([*scene.goal.center, scene.goal.radius], goal)
    np.testing.assert_allclose([*scene.start[:2], *scene.lower, *scene.upper], [1, 2.5, 0, 0, 6, 5])


def test_the_example_of_the_documentation_moves(tmp_path):
    page = (ROOT / "docs" / "moving.md").read_text()
    (tmp_path / "walk.xml").write_text(page.split("```xml")[1].split("```")[0])
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
REFUSED = {  # world, custom, words of the message
    "rows out of order": (DISC, rows("b", "0 2 0 0  2 3 0 0  1 4 0 0"), (CUSTOM, "row 3", "1 s after one at 2 s")),
    "two rows at once": (DISC, rows("b", "0 2 0 0  1 3 0 0  1 4 0 0"), (CUSTOM, "row 3")),
    "seven numbers": (DISC, rows("b", "0 2 0 0  1 3 0"), (CUSTOM, "7 numbers", "t x y yaw")),
    "infinite": (DISC, rows("b", "0 2 0 0  1 inf 0 0"), (CUSTOM, "row 2", "finite")),
    "not a number": (DISC, rows("b", "0 2 0 0  1 nan 0 0"), (CUSTOM.strip('"'), "nan")),
    "a late beginning": (DISC, rows("b", "1 2 0 0  2 3 0 0"), (CUSTOM, "1 s", "at 0")),
    "far away": (DISC, rows("b", "0 2 0 0  1 1e9 0 0"), (CUSTOM, "1e+09")),
    "a jump at the start": (DISC, rows("b", "0 2 0.1 0  1 3 0 0"), ('body "b"', "(2, 0)", 'pos="2 0.1 0.1"', "jump")),
    "a turn at the start": (DISC, rows("b", "0 2 0 1  1 3 0 0"), ('body "b"', "yaw 1")),
    "a jump through the start": (
        body("b", SOLID, "-2 0 0.1"),
        rows("b", "0 -2 0 0  1 -2 2 0  2 2 2 0  3 2 0 0", repeat=True),
        ('body "b"', "starts over at 3 s", "(2, 0) to (-2, 0)", 'site "start"'),
    ),
    "a body on the start": (
        body("b", SOLID, "0.35 0 0.1"),
        rows("b", "0 0.35 0 0  1 3 0 0"),
        ('geom "b"', 'body "b"', "first row"),
    ),
    "joints": (JOINTED, rows("b", GOING), ('body "b"', 'joint "hinge"', 'mocap="true"')),
    "a joint without a name": (
        JOINTED.replace('name="hinge"', ""),
        rows("b", GOING),
        ('body "b"', "has a joint;", 'mocap="true"'),
    ),
    "a size and no data": (DISC, '<numeric name="pirrht_motion_b" size="8"/>', (CUSTOM, "8 numbers that are all 0")),
    "joints inside": (HANGING, rows("b", GOING), ('body "b"', 'joint "arm"', "remove")),
    "no such body": (DISC, rows("c", GOING), ('"pirrht_motion_c"', 'body "c"', 'move are "b"', 'mocap="true"')),
    "no body at all": (FIXED, rows("c", GOING), ('body "c"', "none")),
    "no mocap body": (FIXED, rows("b", GOING), (CUSTOM, "no mocap body", 'mocap="true"')),
    "a body in a body": (INNER, rows("b", GOING), (CUSTOM, "no mocap body")),
    "another text": (
        DISC,
        rows("b", GOING) + '<text name="pirrht_motion_b" data="loop"/>',
        (f"text {CUSTOM}", '"loop"', '"repeat"'),
    ),
    "a text alone": (DISC, '<text name="pirrht_motion_b" data="repeat"/>', (f"text {CUSTOM}", "<numeric")),
    "a text of another name": (
        DISC,
        rows("b", "0 2 0 0 1 3 0 0") + '<text name="pirrht_motion_d" data="repeat"/>',
        ('text "pirrht_motion_d"', f"the motions here are {CUSTOM}"),
    ),
    "one row that repeats": (DISC, rows("b", "0 2 0 0", repeat=True), (CUSTOM, "two or more")),
    "nothing to touch": (GHOST, rows("b", GOING), ('body "b"', "contype", "remove")),
    "nothing in reach": (HIGH, rows("b", GOING), ('body "b"', "height")),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_move_so_is_refused_with_file_and_element_and_what_to_write(tmp_path, case):
    world, custom, words = REFUSED[case]
    message = refusal(moving_scene(tmp_path, world, custom))
    assert message.startswith(str(tmp_path / "moving.xml"))
    for word in words:
        assert word in message, message


def test_a_jump_that_passes_the_start_is_taken_and_so_is_one_on_the_way(tmp_path):
    ways = ("0 -2 1 0  1 -2 2 0  2 2 2 0  3 2 1 0", "0 -2 0 0  1 2 0 0  2 -2 0 0")
    for way in ways:  # the second is over the robot after a while: that is for the drive to see to
        x, y = way.split()[1:3]
        world = body("b", SOLID, f"{x} {y} 0.1")
        assert load(moving_scene(tmp_path, world, rows("b", way, repeat=True))).scene.movers


def test_a_start_given_is_the_one_that_counts(tmp_path: Path):
    path = moving_scene(tmp_path, DISC, rows("b", GOING))
    assert load(path).scene.movers
    assert 'body "b"' in refusal(path, start=(2.3, 0.1))


def test_a_footprint_that_a_body_cuts_at_the_start_is_refused_though_the_robot_itself_is_free(tmp_path):
    world = body("b", 'type="box" size=".002 .002 .2"', "0 0.149 0.1")
    path = moving_scene(tmp_path, world, rows("b", "0 0 0.149 0  1 0 5 0"))
    assert 'body "b"' in refusal(path, robot="unicycle")
