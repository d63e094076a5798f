"""The robot on wheels: friction carries it where the stochastic equation goes, as far as its file claims."""

import mujoco
import numpy as np
import pytest
from plants import QUIET, WALL, hold, problem_of, scene_file

from pirrht import Outcome, Unicycle
from sim.drive.executor import Executor
from sim.mjcf import Loaded, load


def wheeled(
    folder, *, V: float = 1.0, b: float = QUIET, period: float = 4.0, world: str = "", option: str = ""
) -> tuple[Loaded, Executor]:
    loaded = load(scene_file(folder, world=world, option=option), robot="diffdrive")
    return loaded, Executor(loaded, problem_of(loaded, Unicycle(V=V, b=b)), period=period)


@pytest.mark.parametrize("timestep", [0.002, 0.01])
@pytest.mark.parametrize(("V", "turn"), [(1.0, 0.0), (1.0, 0.5), (1.0, 1.5), (1.0, 3.0), (1.0, -3.0), (0.5, 2.0)])
def test_speed_and_turn_rate_are_tracked_within_a_percent(tmp_path, V, turn, timestep):
    _, plant = wheeled(tmp_path, V=V, option=f'<option timestep="{timestep}" gravity="0 0 0"/>')
    states = plant.advance(hold(turn), np.random.default_rng(0)).states
    steps = np.diff(states[len(states) // 4 :], axis=0) / timestep
    assert np.hypot(steps[:, 0], steps[:, 1]).mean() == pytest.approx(V, rel=0.01)
    assert steps[:, 2].mean() == pytest.approx(turn, rel=0.01, abs=1e-3)
    assert np.ptp(states[:, 2]) == pytest.approx(4 * abs(turn), abs=0.03 * abs(turn) + 1e-3)  # unwrapped, late


def test_heading_diffuses_as_the_equation_says(tmp_path):
    """Seed 0, 60 drives of 1 s: the variance of 60 Gaussians has a standard error of 18 % of b^2 t.

    Against the equation under the same noise it is 2 %, so that is what is held to 10 %.
    """
    b, t, count = 0.03, 1.0, 60
    _, plant = wheeled(tmp_path, b=b, period=t)
    rng = np.random.default_rng(0)
    turned, due = np.empty(count), np.empty(count)
    for k in range(count):
        plant.reset(np.zeros(3))
        advance = plant.advance(hold(0.0), rng)
        turned[k], due[k] = advance.states[-1, 2], b * advance.noise.sum()
    assert np.mean(turned**2) == pytest.approx(np.mean(due**2), rel=0.1)
    assert np.mean(turned**2) == pytest.approx(b**2 * t, rel=3 * np.sqrt(2 / count))
    assert np.sqrt(np.mean((turned - due) ** 2)) < 0.15 * b * np.sqrt(t)


def test_it_starts_settled_and_at_speed(tmp_path):
    _, plant = wheeled(tmp_path, V=0.8, period=0.2)
    plant.reset(np.array([3.0, -2.0, 8.0]))
    np.testing.assert_allclose(plant.state, [3.0, -2.0, 8.0])
    height = plant.data.qpos[2]
    np.testing.assert_allclose(plant.data.qvel[:3], [0.8 * np.cos(8.0), 0.8 * np.sin(8.0), 0.0])
    heights = []

    def watch(x, s):
        heights.append(plant.data.qpos[2])
        return np.zeros(1)

    end = plant.advance(watch, np.random.default_rng(0))
    assert np.ptp([height, *heights]) < 1e-5
    along = np.diff(np.vstack([[3.0, -2.0, 8.0], end.states])[:, :2], axis=0) @ [np.cos(8.0), np.sin(8.0)]
    np.testing.assert_allclose(along, 0.8 * 0.002, rtol=1e-3)


def test_a_wall_is_a_collision_and_the_floor_is_none(tmp_path):
    floor = '<geom name="floor" type="plane" size="0 0 0.1"/>'
    for wall in (WALL, WALL.replace('0.3"', '0.004"').replace("0 0.3", "0 0.004")):
        loaded, plant = wheeled(tmp_path, world=floor + wall)
        assert [o.name for o in loaded.scene.obstacles] == ["wall"]
        end = plant.advance(hold(0.0), np.random.default_rng(0))
        assert end.outcome is Outcome.COLLISION
        assert 0.6 - loaded.scene.robot_radius < end.states[-1, 0] < 0.6
    _, plant = wheeled(tmp_path, world=floor)
    assert plant.advance(hold(0.7), np.random.default_rng(0)).outcome is None
    assert plant.data.ncon == 4


def test_all_that_collides_lies_inside_the_footprint_and_the_ground_is_no_border(tmp_path):
    loaded, plant = wheeled(tmp_path)
    model = loaded.model
    assert not loaded.robot_geoms[model.geom("robot/ground").id]
    assert loaded.scene.upper[0] == 1e4
    solid = loaded.robot_geoms & (model.geom_contype > 0)
    centre = plant.data.geom_xpos[model.geom("robot/footprint").id]
    mujoco.mj_kinematics(model, plant.data)
    reach = np.linalg.norm(plant.data.geom_xpos[solid] - centre, axis=1) + model.geom_rbound[solid]
    assert np.all(reach < loaded.scene.robot_radius + 1e-9)
