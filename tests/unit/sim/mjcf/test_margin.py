"""A margin is room that plans keep: the footprint grows, the robot itself does not."""

import mujoco
import numpy as np
import pytest
from mjcf_samples import ON_GROUND, refusal, robot_mjcf
from plants import scene_file

from pirrht import Outcome
from pirrht.geometry.collision import Collision
from sim.mjcf import Loaded, load
from sim.scenario import prepare


def solids(loaded: Loaded) -> list[tuple]:
    """Sizes and places of all of the robot that collides, in a row that names do not order."""
    model = loaded.model
    numbers = np.flatnonzero(loaded.robot_geoms & (model.geom_contype | model.geom_conaffinity).astype(bool))
    return sorted((int(model.geom_type[g]), *model.geom_size[g], *model.geom_pos[g]) for g in numbers)


@pytest.mark.parametrize("robot", ON_GROUND)
def test_plans_take_the_robot_to_be_larger_and_what_it_weighs_and_collides_with_stays(robot):
    plain, wide = load("slit", robot=robot), load("slit", robot=robot, margin=0.03)
    assert wide.scene.robot_radius == pytest.approx(plain.scene.robot_radius + 0.03)
    assert wide.scene.robot_height == plain.scene.robot_height
    assert solids(wide) == solids(plain)
    body = plain.model.body("robot/robot").id
    for kind in ("body_mass", "body_inertia", "body_ipos"):
        np.testing.assert_array_equal(getattr(wide.model, kind)[body], getattr(plain.model, kind)[body])


def test_a_robot_whose_footprint_has_its_mass_keeps_it_and_a_scene_says_its_margin(tmp_path, write):
    file = write(robot_mjcf(geom='<geom name="footprint" pos="0 0 0.1" size="0.1" mass="3"/>'), "ball.xml")
    found = [load(scene_file(tmp_path), robot=file, margin=margin).model for margin in (0.0, 0.05)]
    for model in found:
        assert mujoco.mj_getTotalmass(model) == pytest.approx(3.0)
    np.testing.assert_array_equal(*(model.body_inertia for model in found))
    said = '<custom><numeric name="pirrht_margin" data="0.15"/></custom>'
    assert load(scene_file(tmp_path, option=said)).scene.robot_radius == pytest.approx(0.25)


ROOM = """<mujoco><worldbody>{}
<geom name="wall" type="box" size="1.5 0.05 0.3" pos="2 0.95 0.3"/>
<site name="workspace" type="box" size="2.5 2 0.5" pos="2.5 2 0.5"/>
<site name="start" pos="1.5 1.2 0"/><site name="goal" type="cylinder" size="0.3 0.01" pos="4.5 2.5 0"/>
</worldbody></mujoco>"""


@pytest.mark.parametrize("robot", ["puck", "unicycle"])
def test_a_robot_that_starts_inside_the_margin_drives_out_of_it_and_arrives(write, robot):
    file = write(ROOM.format(""))
    scenario = prepare(file, robot=robot, margin=0.2, given={"vertices": 400, "noise": 0.03, "max_time": 8.0})
    frames = list(scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())))
    assert frames[-1].outcome is Outcome.GOAL
    states = np.vstack([frame.advance.states for frame in frames])
    full = Collision(scenario.loaded.scene.world, scenario.loaded.scene.footprint).clearance(states[:, :2])
    assert full[0] < 0.0
    assert full[np.hypot(*(states[:, :2] - scenario.start[:2]).T) > scenario.space.scene.waivers[0].radius].min() > 0.0


def test_only_who_touches_a_wall_at_the_start_is_refused_and_rounding_does_not_count(write):
    file = write(ROOM.format(""))
    for y in (1.1, 1.1 - 1e-12, 1.1 + 1e-6):
        assert prepare(file, start=(1.5, y)).references(prepare(file, start=(1.5, y)).grown_tree())
    assert 'touches geom "wall"' in refusal(file, margin=0.2, start=(1.5, 1.09))


def test_next_to_a_moving_obstacle_the_margin_is_half_of_what_it_leaves(write):
    walker = '<body name="walker" mocap="true" pos="1.5 1.6 0.3"><geom type="cylinder" size="0.2 0.3"/></body>'
    custom = '<mujoco><custom><numeric name="pirrht_motion_walker" data="0 1.5 1.6 0  4 4 3.5 0"/></custom>'
    loaded = load(write(ROOM.format(walker).replace("<mujoco>", custom)), margin=0.3)
    assert (loaded.margin, loaded.scene.robot_radius) == (pytest.approx(0.05), pytest.approx(0.15))
