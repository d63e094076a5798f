"""Scenes and robots from MJCF: what is read agrees with MuJoCo and with what is written."""

import mujoco
import numpy as np
import pytest
from mjcf_samples import FLOOR, GOAL, ON_GROUND, SITES, SPACE, mjcf, refusal

from pirrht.geometry.scene import Kind, Scene
from sim.mjcf import load


@pytest.mark.parametrize("robot", ON_GROUND)
def test_slit_is_read_as_it_is_written(robot):
    loaded = load("slit", robot=robot)
    scene = loaded.scene
    assert [o.name for o in scene.obstacles] == ["upper wall", "lower wall"]
    np.testing.assert_allclose([*scene.lower, *scene.upper], [0, 0, 6, 5])
    np.testing.assert_allclose([*scene.goal.center, scene.goal.radius], [5.5, 2.5, 0.3])
    np.testing.assert_allclose(scene.start, [1, 2.5, 0])
    assert (scene.defaults["noise"], scene.defaults["limit"]) == (0.1, 0.6)
    assert scene.defaults["max-time"] == 30
    assert loaded.command.shape == (loaded.model.nu, 3 if robot == "car" else 2)
    assert not np.any(loaded.obstacle_geoms & loaded.robot_geoms)


def rebuilt(scene: Scene) -> mujoco.MjModel:
    """The plain values turned into a flat MuJoCo model, obstacle i as geom i, last the robot's sphere."""
    spec = mujoco.MjSpec()
    for i, obstacle in enumerate(scene.obstacles):
        x, y = obstacle.rotation.T[:2]
        geom = spec.worldbody.add_geom(pos=obstacle.position)
        geom.alt.type, geom.alt.xyaxes = mujoco.mjtOrientation.mjORIENTATION_XYAXES, [*x, *y]
        geom.type = getattr(mujoco.mjtGeom, f"mjGEOM_{obstacle.kind.name}")
        if obstacle.vertices is None:
            geom.size = obstacle.size
        else:
            spec.add_mesh(name=f"mesh{i}", uservert=obstacle.vertices.ravel())
            geom.meshname = f"mesh{i}"
    body = spec.worldbody.add_body(pos=[0, 0, scene.robot_height])
    for axis in ([1, 0, 0], [0, 1, 0]):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[scene.robot_radius, 0, 0])
    return spec.compile()


def distances(model: mujoco.MjModel, geoms, robot: int, points) -> np.ndarray:
    data = mujoco.MjData(model)
    out = np.empty((len(points), len(geoms)))
    for i, point in enumerate(points):
        data.qpos[:2] = point
        mujoco.mj_kinematics(model, data)
        out[i] = [mujoco.mj_geomDistance(model, data, int(g), robot, 20.0, None) for g in geoms]
    return out


WEDGE = "0 0 0  1.2 0 0  0 0.8 0  0 0 0.9  0.9 0.5 0.4  0.2 0.2 0.2"


def test_nested_and_rotated_shapes_stand_where_mujoco_has_them(write):
    shapes = """
      <body pos="4 3 0.1" euler="0 0 30"><geom name="box" type="box" size="0.6 0.2 0.4" euler="10 0 0"/>
        <body pos="1 1 0.1" euler="20 0 40"><geom type="cylinder" size="0.3 0.5" euler="0 70 0"/>
          <body pos="1 0 -0.7" euler="0 15 0">
            <geom type="mesh" mesh="wedge" pos="0.3 0 0" euler="0 0 25"/></body>
        </body></body>
      <body pos="7 2 0.2" euler="0 90 10"><geom type="capsule" size="0.2 0.6"/></body>
      <body pos="2 7 0"><geom type="ellipsoid" size="0.5 0.3 0.4" euler="30 20 10"/>
        <geom size="0.3" pos="2 0 0.1"/></body>"""
    loaded = load(write(mjcf(SITES + FLOOR + shapes, head=f'<asset><mesh name="wedge" vertex="{WEDGE}"/></asset>')))
    points = np.random.default_rng(0).uniform(0, 10, (200, 2))
    assert {o.kind for o in loaded.scene.obstacles} == set(Kind)
    flat = rebuilt(loaded.scene)
    footprint = loaded.model.geom("robot/footprint").id
    ours = distances(flat, range(flat.ngeom - 1), flat.ngeom - 1, points)
    theirs = distances(loaded.model, np.flatnonzero(loaded.obstacle_geoms), footprint, points)
    np.testing.assert_allclose(ours, theirs, atol=1e-5)


@pytest.mark.parametrize(
    ("geom", "counts"),
    [
        ('type="box" size="1 1 0.05" pos="5 5 0.05"', True),
        ('type="box" size="1 1 0.05" pos="5 5 0.249"', True),
        ('type="box" size="1 1 0.05" pos="5 5 0.251"', False),  # a beam above the puck
        ('type="box" size="9 9 0.05" pos="5 5 -0.05"', False),  # a slab under it
        ('type="cylinder" size="0.3 1" pos="5 5 0.499" euler="0 90 0"', True),
        ('type="cylinder" size="0.3 1" pos="5 5 0.501" euler="0 90 0"', False),
        ('type="capsule" size="0.1 0.5" pos="5 5 0.75" euler="0 30 0"', False),
        ('type="ellipsoid" size="1 0.2 0.1" pos="5 5 1.21" euler="0 90 0"', False),
        ('size="1" pos="5 5 1.19"', True),
        ('size="1" pos="5 5 0.5" contype="0" conaffinity="0"', False),  # decoration
        ('size="1" pos="5 5 0.5" contype="0" conaffinity="1"', True),
        ('size="1" pos="5 5 0.5" contype="4" conaffinity="4"', False),
    ],
)
def test_an_obstacle_is_what_would_collide_at_the_height_of_the_robot(write, geom, counts):
    assert len(load(write(mjcf(SITES + f"<geom {geom}/>")), robot="puck").scene.obstacles) == counts


@pytest.mark.parametrize("robot", [one for one in ON_GROUND if one != "jackal"])  # which is higher
def test_the_robot_touches_neither_floor_nor_slab_nor_beam(write, robot):
    world = FLOOR + '<geom type="box" size="9 9 0.5" pos="5 5 -0.5"/><geom type="box" size="9 9 0.5" pos="5 5 0.7"/>'
    radius = 0.1 if robot in ("puck", "hover", "rover") else 0.15
    model = load(write(mjcf(SITES + world)), robot=robot, radius=radius).model
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    touched = {model.geom(g).name for g in data.contact.geom.ravel()}
    assert all(name.startswith("robot/") for name in touched)  # wheels stand on their own ground


def test_without_a_workspace_the_floor_is_the_border_and_the_x_axis_of_the_start_is_the_heading(write):
    turned = '<body euler="0 0 30"><site name="start" pos="2 0 0" euler="0 0 90"/></body>'
    scene = load(write(mjcf(GOAL.replace("9 9", "4 4") + turned + FLOOR))).scene
    np.testing.assert_allclose([*scene.lower, *scene.upper], [-6, -7, 6, 7])
    np.testing.assert_allclose(scene.start, [np.sqrt(3), 1, 2 * np.pi / 3])


def test_start_goal_and_radius_of_the_caller_win(write):
    path = write(mjcf(GOAL + SPACE, head='<custom><numeric name="pirrht_radius" data="0.3"/></custom>'))
    loaded = load(path, start=(2, 3), goal=(7, 8, 0.5))
    np.testing.assert_allclose(loaded.scene.start, [2, 3, 0])
    np.testing.assert_allclose([*loaded.scene.goal.center, loaded.scene.goal.radius], [7, 8, 0.5])
    np.testing.assert_allclose(loaded.model.key_qpos[0], [2, 3])
    assert loaded.scene.robot_radius == 0.3
    assert load(path, start=(2, 3), radius=0.2).scene.robot_radius == 0.2


@pytest.mark.parametrize(
    ("scene", "start", "goal"), [("slit", (2, 1), (4, 3, 0.5)), ("window", (1, 2, 2), (5, 2, 2, 0.4))]
)
def test_pictures_show_start_and_goal_where_the_caller_has_them(scene, start, goal):
    model = load(scene, start=start, goal=goal).model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.site("start").xpos[: len(start)], start)
    np.testing.assert_allclose([*data.site("goal").xpos[: len(start)], model.site("goal").size[0]], goal)


def test_a_puck_grows_with_its_radius_and_another_robot_keeps_its_body():
    loaded = load("slit", radius=0.2)
    assert loaded.scene.robot_height == pytest.approx(0.2)
    np.testing.assert_allclose(loaded.model.geom("robot/footprint").pos, [0, 0, 0.2])
    assert loaded.model.geom("robot/bumper").size[0] == pytest.approx(0.201)
    puck = loaded.model.mesh("robot/puck").id
    first, count = loaded.model.mesh_vertadr[puck], loaded.model.mesh_vertnum[puck]
    assert np.hypot(*loaded.model.mesh_vert[first : first + count, :2].T).max() == pytest.approx(0.2, abs=1e-3)
    small, large = (load("slit", robot="unicycle", radius=r) for r in (0.15, 0.2))
    assert (small.scene.robot_radius, large.scene.robot_radius) == (0.15, 0.2)
    np.testing.assert_allclose(small.model.geom("robot/bumper").size, large.model.geom("robot/bumper").size)
    assert '"bumper"' in refusal("slit", robot="unicycle", radius=0.1)


def test_a_scene_names_its_robot_and_its_defaults(write):
    head = """<keyframe><key name="home"/><key name="start" time="3"/></keyframe>
              <custom><text name="pirrht_robot" data="unicycle"/><numeric name="pirrht_record_hz" data="25"/>
              <numeric name="somebody_elses" data="1 2 3"/>
              <text name="pirrht_about" data="A room,&#10;   and a door."/></custom>"""
    loaded = load(write(mjcf(SITES, head=head)))
    assert (loaded.robot, loaded.dynamics_name) == ("unicycle", "unicycle")
    assert (loaded.scene.defaults, loaded.about) == ({"record-hz": 25.0}, "A room, and a door.")
    np.testing.assert_allclose(loaded.model.key_qpos, [[1, 1, 0]])
    assert load(loaded.path, robot="puck").robot == "puck"
