"""The quadrotor: it hovers, tilts to the acceleration that a plan wants, keeps its rotors' limits, and takes gusts."""

from dataclasses import replace

import numpy as np
import pytest
from mjcf_samples import refusal
from plants import QUIET, STEP, driven, hold, problem_of, states_of

from pirrht.systems.drone import Drone
from sim.drive.executor import Executor, Plant
from sim.mjcf import load, models_folder

FREE = {"start": (-50.0, 2.0, 50.0), "workspace": (-100.0, 6.0, -100.0, 100.0, 0.2, 100.0)}  # far off the wall
MOST = 6.0  # thrust of a rotor [N]


def plant_of(b: float = QUIET, *, scene="window", periods: int = 1, robot="drone") -> tuple[Executor, list[np.ndarray]]:
    """The plant, with a period of 0.1 s times so many, and a list that takes all commands of its rotors."""
    loaded = load(scene, robot=robot, **FREE)
    plant = Executor(loaded, problem_of(loaded, Drone(b=b)), period=0.1 * periods)
    commands = []
    fly = plant._joints.fly

    def noting(data, wanted, made):
        fly(data, wanted, made)
        commands.append(data.ctrl.copy())

    plant._joints.fly = noting
    return plant, commands


def altered(folder, *pairs: tuple[str, str], name: str = "robots/drone"):
    """A copy of a built-in file with parts of its text replaced."""
    text = (models_folder() / f"{name}.xml").read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    (folder / "machine.xml").write_text(text)
    return folder / "machine.xml"


@pytest.mark.parametrize("timestep", [STEP, 0.01])
def test_it_hovers_where_it_is_and_glides_on_level(tmp_path, timestep):
    """For 1 s within a micrometre and a microradian."""
    scene = altered(tmp_path, ('timestep="0.002"', f'timestep="{timestep}"'), name="scenes/window")
    plant, commands = plant_of(scene=scene, periods=10)
    for speed in (0.0, 2.0):
        start = np.array([*FREE["start"], speed, 0.0, -0.5 * speed])
        plant.reset(start)
        end = plant.advance(hold(0.0, 0.0, 0.0), np.random.default_rng(0))
        np.testing.assert_allclose(end.states[-1, :3], start[:3] + start[3:], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(end.attitudes[-1], [1.0, 0.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(commands, 9.81 / 4.0, rtol=1e-6)


@pytest.mark.parametrize("wanted", [(1, 0, 0), (0, -1, 0), (3, 2, 0), (0, 0, 3), (1, 1, -4), (-4, 0, 4)])
@pytest.mark.parametrize("timestep", [STEP, 0.01])
def test_a_wanted_acceleration_is_there_within_a_tenth_of_a_second_and_heading_and_height_stay(
    tmp_path, wanted, timestep
):
    """Two thirds within 0.1 s, 1 % from 0.3 s on; upwards at once. The speed stays behind by 0.08 s at most."""
    scene = altered(tmp_path, ('timestep="0.002"', f'timestep="{timestep}"'), name="scenes/window")
    plant, commands = plant_of(scene=scene, periods=4)
    u = np.array(wanted, dtype=float)
    advance = plant.advance(hold(*u), np.random.default_rng(0))
    speeds = np.vstack([np.zeros(3), advance.states[:, 3:]])
    along = np.diff(speeds, axis=0) @ u / (timestep * u.dot(u))
    assert np.argmax(along > 0.63) * timestep < (0.1 if u[:2].any() else 1e-9)
    np.testing.assert_allclose(np.diff(speeds, axis=0)[round(0.3 / timestep) :] / timestep - u, 0.0, atol=0.06)
    assert 0.4 - speeds[-1] @ u / u.dot(u) < 0.08
    assert np.abs(speeds[:, 2] - u[2] * timestep * np.arange(len(speeds))).max() < 0.15
    w, x, y, z = advance.attitudes.T
    assert np.abs(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))).max() < 0.1  # it slews with the tilt
    assert np.min(commands) >= 0.0
    assert np.max(commands) <= MOST


def test_rotors_keep_their_limits_whatever_is_asked_of_them_and_it_comes_to_rest_afterwards():
    plant, commands = plant_of(3.0)
    rng = np.random.default_rng(5)
    home = np.array(FREE["start"])
    for _ in range(8):
        driven(plant, hold(*rng.normal(scale=60.0, size=3)), int(rng.integers(99)), 1)
    assert (np.min(commands), np.max(commands)) == (0.0, MOST)
    plant.enter(replace(plant._problem, dynamics=Drone(b=QUIET)))
    end = driven(plant, lambda x, s: Drone().brake(x, home, 1.0), 0, 100)[-1]
    np.testing.assert_allclose(end.states[-1], [*home, 0.0, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(np.abs(end.attitudes[-1]), [1.0, 0.0, 0.0, 0.0], atol=1e-3)


def test_a_gust_is_the_noise_of_the_plan():
    """Without control it is the same, step by step; of 1000 steps the variance is b^2 t within 3 of its errors."""
    b = 0.7
    plant, _ = plant_of(b)
    advances = driven(plant, hold(0.0, 0.0, 0.0), 3, 20)
    noise = np.concatenate([advance.noise for advance in advances])
    np.testing.assert_allclose(states_of(advances)[:, 3:], b * np.cumsum(noise, axis=0), rtol=0.0, atol=1e-9)
    steps = np.diff(states_of(advances)[:, 3:], axis=0)
    assert np.abs(np.var(steps, axis=0) / (b * b * STEP) - 1.0).max() < 3.0 * np.sqrt(2.0 / len(steps))


def test_it_follows_a_circle_as_its_equation_does():
    """A third of a circle of 1 m at 1 m/s, with a law that knows the way: within 1 cm, the equation within 1 mm."""
    off = []
    quadrotor, _ = plant_of()
    for plant in (quadrotor, Plant(quadrotor._problem, period=0.1)):
        centre = np.array(FREE["start"])

        def law(x, s, plant=plant, centre=centre):
            t = plant.time
            place = np.array([np.sin(t), 1.0 - np.cos(t), 0.0])
            speed = np.array([np.cos(t), np.sin(t), 0.0])
            return np.array([-np.sin(t), np.cos(t), 0.0]) - 9.0 * (x[:3] - centre - place) - 6.0 * (x[3:] - speed)

        plant.reset(np.array([*centre, 1.0, 0.0, 0.0]))
        ways = states_of(driven(plant, law, 0, 21))[:, :3] - centre
        off.append(np.abs(np.hypot(ways[:, 0], ways[:, 1] - 1.0) - 1.0).max())
        assert np.abs(ways[:, 2]).max() < 0.01
    assert off[0] < 0.01
    assert off[1] < 0.001


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('gravity="0 0 -9.81"', 'gravity="0 0 0"', "a robot with rotors needs gravity"),
        ("-0.016", "0.016", "at least four rotors"),
        ("0 0 1 0 0 0.016", "1 0 1 0 0 0.016", "at least four rotors"),
        ('inertial pos="0 0 0"', 'inertial pos="0.1 0 0"', "its mass around its origin"),
        ("<freejoint", '<joint type="ball"', "or a free joint and rotors"),
        ('data="drone"', 'data="ball"', 'ball has no velocities: name the dynamics "drone"'),
    ],
)
def test_what_rotors_cannot_fly_is_refused_in_one_line(tmp_path, old, new, reason):
    message = refusal("window", robot=altered(tmp_path, (old, new)))
    assert reason in message
    assert "machine.xml" in message
