"""psi among moving obstacles against closed forms, against standing worlds, against samples and against itself."""

from dataclasses import replace

import numpy as np
import pytest
from discs import block, disc, scene_of
from moving import SCENES, START, moved, walled
from thoroughly import first, thorough

from pirrht import Desirability, FreeSpace, OptionError, Problem, Scene, SingleIntegrator, Unicycle

# Of an independent march, at b = 0.1, 0.2, 0.3: v to 0.002; shares in front, through the gap, between, below, above
V = {"crossing": (8.578, 8.752, 9.000), "closing_door": (8.852, 9.410, 9.918), "pincer": (8.833, 9.155, 9.531)}
SHARES = {
    "crossing": {"0": (0.93, 0.69, 0.61)},
    "closing_door": {"0,0": (1.00, 0.46, 0.06)},
    "pincer": {"0,0": (0.97, 0.31, 0.16), "1,0": (0.03, 0.60, 0.62), "0,-1": (0.0, 0.10, 0.22)},
}


def room(*movers, goal: tuple[float, float] = (4.3, 0.6), radius: float = 0.2, standing: tuple = ()) -> Scene:
    """5 x 3 m, for a robot so large that the grid is coarse."""
    return scene_of(standing, start=(0.6, 1.5), goal=(*goal, 0.3), side=(5.0, 3.0), radius=radius, movers=movers)


def solved(scene: Scene, b: float = 0.3, phi: float = np.inf, **options: float) -> Desirability:
    problem = Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2.0 * np.eye(2), phi=phi)
    return Desirability.of(problem, FreeSpace.of(scene), **options)


def crosser(repeat: bool = False):
    rows = [(0.0, 2.0, 0.6, 0.0), (1.5, 2.2, 2.2, 0.0), (2.0, 2.0, 0.6, 0.0)]
    return moved("crosser", rows, disc("disc", 0.0, 0.0, 0.3), repeat=repeat)


def places(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform([0.1, 0.1], [4.9, 2.9], (count, 2)), rng.uniform(0.0, 3.0, count)


@pytest.fixture(scope="module")
def crossed() -> Desirability:
    return solved(room(crosser()))


@pytest.mark.parametrize("speed", first([0.4, -0.4, 1.0]))
def test_before_a_wall_at_constant_speed_a_path_pays_what_girsanov_says(speed):
    b, (scene, rate_of) = 0.3, walled(speed)
    grid = solved(scene, b, 0.0)
    rate = rate_of(b, grid.problem.temperature)
    for z in (0.05, 0.15, 0.3, 0.45):
        x = np.array([2.5 + 0.3 + z, 1.5])
        assert -grid.log_psi(x, 0.4) == pytest.approx(rate * z, rel=5e-3, abs=5e-3)
        assert grid.control(x, 0.4) == pytest.approx([-(b**2) * rate, 0.0], rel=0.01, abs=0.01)


@pytest.mark.parametrize(("phi", "accuracy"), [(np.inf, 1e-3), thorough(3.0, 2e-3)])
def test_a_mover_that_stands_still_is_an_obstacle(phi, accuracy):
    solids = disc("disc", 0.0, 0.0, 0.3), block("box", 0.0, 0.0, (0.15, 0.5))
    rows = [(0.0, 2.0, 1.7, 0.3), (0.5, 2.0, 1.7, 0.3)], [(0.0, 3.2, 1.0, -0.4), (1.5, 3.2, 1.0, -0.4)]
    movers = [moved(solid.name, row, solid) for solid, row in zip(solids, rows, strict=True)]
    standing = tuple(solid for mover in movers for solid in mover.at(0.0))
    moving = solved(room(*movers, radius=0.1), phi=phi)
    still = solved(room(standing=standing, radius=0.1), phi=phi, spacing=0.02)
    x, _ = places(200)
    away = still.space.collision.clearance(x) > 0.02
    assert moving.value(x[away]) == pytest.approx(still.value(x[away]), rel=accuracy, abs=1e-3)


def test_the_control_is_the_gradient_of_the_value_at_any_time(crossed):
    x, t = places(60, seed=3)
    free = np.isfinite(crossed.log_psi(x, t)) & (crossed.value(x, t) > 0.0) & (t < 2.0)
    x, t, step = x[free], t[free], 1e-5
    slope = [(crossed.value(x + step * e, t) - crossed.value(x - step * e, t)) / (2.0 * step) for e in np.eye(2)]
    assert crossed.control(x, t) == pytest.approx(-0.5 * np.array(slope).T, rel=1e-3, abs=1e-3)


@pytest.mark.thorough
def test_a_motion_that_starts_over_is_one_of_many_rows():
    """Six periods from now the way is done: psi does not know whether there is a seventh."""
    turn = crosser(repeat=True)
    rows = turn.motion.rows
    many = np.vstack([rows[:1], *(rows[1:] + np.array([2.0 * k, 0.0, 0.0, 0.0]) for k in range(6))])
    once = moved("crosser", many, *turn.solids)
    x, t = places(60)
    again, unrolled = solved(room(turn)), solved(room(once))
    for late in (0.0, 2.0):
        a, b = again.log_psi(x, t + late), unrolled.log_psi(x, t)
        free = np.isfinite(a) & np.isfinite(b)
        assert free.sum() > 45
        assert a[free] == pytest.approx(b[free], abs=5e-3)
    shifted = solved(room(replace(turn, motion=turn.motion.after(0.7)))).log_psi(x, t)
    a = again.log_psi(x, t + 0.7)
    free = np.isfinite(a) & np.isfinite(shifted)
    assert shifted[free] == pytest.approx(a[free], abs=5e-3)


@pytest.mark.parametrize(
    ("dynamics", "options", "message"),
    [
        (SingleIntegrator(b=0.3), {"dt": 0.1}, "leave out dt"),
        (SingleIntegrator(b=0.3), {"spacing": 0.5}, "too coarse"),
        (Unicycle(), {}, "Unicycle among moving obstacles; it takes SingleIntegrator"),
    ],
)
def test_what_the_march_cannot_do_is_refused_with_what_it_can(dynamics, options, message):
    scene = room(crosser())
    problem = Problem(dynamics=dynamics, scene=scene, R=np.eye(dynamics.m))
    with pytest.raises(OptionError, match=message):
        Desirability.of(problem, FreeSpace.of(scene), **options)


@pytest.mark.parametrize("b", first([0.2, 0.1, 0.3]))
@pytest.mark.parametrize("name", first(["pincer", "closing_door", "crossing"]))
def test_values_and_shares_are_those_of_an_independent_march(name, b):
    """Values within 0.3 %, shares within 3 points; their standard errors are 1.1 at most, seed 0.

    At b = 0.1, where paths take longest to draw, shares are near 0 or 1, and 600 paths tell as much.
    """
    row, paths = round(10 * b) - 1, 600 if b == 0.1 else 2000
    grid = solved(SCENES[name](), b)
    assert grid.value(START) == pytest.approx(V[name][row], rel=3e-3)
    shares = grid.shares(START, paths)
    for winding, expected in SHARES[name].items():
        assert shares.get(winding, 0.0) == pytest.approx(expected[row], abs=0.03)


def test_a_passage_between_bodies_that_slide_past_each_other_has_two_walls():
    """They are longer than the workspace, so that what they leave, 0.12 m for the robot's centre, stays as it is."""

    def corridor(speed: float) -> Scene:
        walls = [
            moved(f"wall{side:g}", [(0.0, 1.5, y, 0.0), (2.0, 1.5 + 2.0 * side * speed, y, 0.0)],
                  block("wall", 0.0, 0.0, (5.0, 0.2)))
            for side, y in ((1.0, 0.86), (-1.0, 0.14))
        ]  # fmt: skip
        solids = tuple(solid for wall in walls for solid in wall.at(0.0))
        parts = {"movers": tuple(walls)} if speed else {"obstacles": solids}
        return scene_of(**parts, start=(0.5, 0.5), goal=(2.5, 0.5, 0.05), side=(3.0, 1.0))

    x = np.array([[0.4, 0.5], [1.0, 0.46], [1.6, 0.53], [2.2, 0.5], [2.9, 0.48]])
    moving, still = solved(corridor(0.4), 0.2), solved(corridor(0.0), 0.2, spacing=0.01)
    assert moving.value(x) == pytest.approx(still.value(x), rel=3e-3)
    assert moving.control(x) == pytest.approx(still.control(x), rel=0.02, abs=0.01)
