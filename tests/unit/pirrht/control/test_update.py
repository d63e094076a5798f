"""Obstacles come and go while a controller drives: classes keep their names, and what is known of them goes on."""

import threading
from itertools import pairwise

import numpy as np
import pytest
from rays import scan_of
from thoroughly import thorough
from trees import grown, point

from pirrht import (
    Controller,
    Dubins,
    FreeSpace,
    Mppi,
    Optimal,
    OptionError,
    Problem,
    Sampling,
    Scene,
    SceneError,
    SingleIntegrator,
    Unicycle,
)  # fmt: skip
from pirrht.control.mapped import Mapped
from pirrht.geometry.collision import Collision

WALLS = [[2.0, 0.75, 2.4, 2.1], [2.0, 2.9, 2.4, 4.25]]
CRATE = [3.3, 2.2, 3.9, 2.9]  # in the way of what comes through between the walls
TASK = {"lower": (0, 0), "upper": (6, 5), "start": (0.5, 2.5), "goal": (5.5, 2.45, 0.25), "robot_radius": 0.15}
PERIOD = {"puck": 0.05, "car": 0.1}


def room(*boxes, **task) -> Scene:
    return Scene.from_boxes(boxes, **TASK | task)


def controller(scene: Scene, robot: str = "puck", *, vertices: int = 300) -> Controller:
    if robot == "puck":
        return point(scene, 0.1, vertices, samples=100, first=PERIOD[robot])
    problem, space = Problem(dynamics=Unicycle(b=0.03), scene=scene, R=np.eye(1), phi=1000.0), FreeSpace.of(scene)
    return Controller(
        problem, space, grown(space, Dubins.of(problem), vertices), Sampling(samples=100), rng=np.random.default_rng(1)
    )


def start(c: Controller) -> np.ndarray:
    return c.problem.dynamics.state_of(c.problem.scene.start)


def drive(c: Controller, x: np.ndarray, seconds: float, rng: np.random.Generator, h: float = 0.002) -> np.ndarray:
    """Positions (k, 2) that the equation passes, from x (n,) on until the goal."""
    d, period = c.problem.dynamics, PERIOD["puck" if c.problem.dynamics.n == 2 else "car"]
    path = [x]
    while len(path) * h < seconds and not c.problem.scene.goal.contains(path[-1][:2]):
        plan = c.plan(path[-1])
        for k in range(round(period / h)):
            path.append(d.step(path[-1], plan.at(path[-1], k * h), np.sqrt(h) * rng.standard_normal(d.m), h))
        c.observe(np.array(path[-round(period / h) :]), period)
    return np.array(path)


def assert_equal_plans(one, other):
    assert one.ids == other.ids
    assert one.estimate.value == other.estimate.value
    np.testing.assert_array_equal(one.tape, other.tape)


@pytest.mark.parametrize("robot", ["puck", "car"])
def test_an_update_with_an_equal_scene_changes_nothing(robot: str):
    one, other = (controller(room(*WALLS), robot) for _ in range(2))
    x = drive(one, start(one), 0.2, np.random.default_rng(2))[-1]
    np.testing.assert_array_equal(drive(other, start(other), 0.2, np.random.default_rng(2))[-1], x)
    tree = one.tree
    one.update(room(*WALLS, start=(1.0, 1.0)))
    assert one.tree is tree
    assert_equal_plans(one.plan(x), other.plan(x))


@pytest.mark.parametrize(
    ("scene", "error", "words"),
    [
        (room(*WALLS, CRATE, goal=(5.4, 2.5, 0.25)), OptionError, "keeps the goal"),
        (room(*WALLS, [5.2, 2.1, 5.8, 2.8]), SceneError, "everywhere in its disc"),
    ],
)
def test_a_refused_update_says_why_in_one_line_and_changes_nothing(scene: Scene, error, words: str):
    one, other = controller(room(*WALLS)), controller(room(*WALLS))
    with pytest.raises(error, match=words) as caught:
        one.update(scene)
    assert "\n" not in str(caught.value)
    assert_equal_plans(one.plan(start(one)), other.plan(start(other)))


@pytest.mark.parametrize("seed", range(6))
def test_every_class_whose_path_stays_free_keeps_its_name_but_for_turns_about_what_is_new(seed: int):
    rng = np.random.default_rng(seed)
    c = controller(room(*WALLS))
    x = drive(c, start(c), 0.3, rng)[-1]
    before = c.plan(x)
    assert len(before.ids) == 3
    corner = rng.uniform([2.6, 0.3], [4.4, 4.0])
    c.update(room(*WALLS, [*corner, *(corner + 0.5)]))
    after = c.plan(x)
    straight = np.linspace(x, c.problem.scene.goal.center, 2)
    kept = 0
    for name, reference in zip(before.ids, before.references, strict=True):
        path = reference.trajectory.points
        if not c.space.collision.segments_free(path[:-1], path[1:]).all():
            continue
        kept += 1
        # The turn about the new marker of the path ahead, against the straight line from where the robot is.
        turns = [c.space.homology.turns(line)[2:] for line in (np.vstack([path, straight[1:]]), straight)]
        more = np.rint(turns[0] - turns[1]).astype(int)
        assert (name if not more.any() else f"{name},{more[0]}") in after.ids
    assert kept > 0
    assert all(name.split(",")[:2] in [["0", "0"], ["1", "0"], ["0", "-1"]] for name in after.ids)


def test_a_wall_that_reaches_the_border_keeps_its_number():
    c = controller(room(*WALLS))
    c.update(room(*WALLS, [2.0, 0.0, 2.4, 0.8]))
    assert set(c.plan(start(c)).ids) == {"0,0", "0,-1"}


def test_a_crate_that_comes_and_goes_leaves_names_and_plans_as_they_were():
    c = controller(room(*WALLS))
    x = start(c)
    before = {one.id: one.length for one in c.plan(x).references}
    for _ in range(3):
        c.update(room(*WALLS, CRATE))
        assert c.space.homology.M == 3
        c.update(room(*WALLS))
    assert c.space.homology.M == 2
    assert {one.id: one.length for one in c.plan(x).references} == pytest.approx(before, rel=1e-3)


def test_guides_and_paths_of_classes_that_stay_free_go_on_and_others_do_not():
    c = controller(room(*WALLS), "car", vertices=600)
    c.plan(start(c))
    guides = dict(c.run.starts.optima)
    assert set(guides) >= {(0, 0)}
    c.update(room(*WALLS, [4.0, 0.2, 4.4, 0.6]))  # off every path
    assert {whole[:2]: guide for whole, guide in c.run.starts.optima.items()} == guides
    assert c.run.starts.sampled
    c.update(room(*WALLS, CRATE))
    assert (0, 0) not in {whole[:2] for whole in c.run.starts.optima}


def touched(scene: Scene, path: np.ndarray) -> bool:
    """Whether a robot on a path (k, n) touches something; steps are shorter than walls are thick."""
    gaps = [np.hypot(*(b - a)) for a, b in pairwise(path[:, :2])]
    return bool(np.any(Collision(scene.world, scene.footprint).clearance(path[:, :2]) <= 0.0)) or max(gaps) > 0.1


SEEDS = [(robot, seed) if seed == 0 else thorough(robot, seed) for robot in ("puck", "car") for seed in range(5)]


@pytest.mark.parametrize(("robot", "seed"), SEEDS)
def test_a_crate_that_appears_in_the_path_is_not_hit(robot: str, seed: int):
    """And who knows nothing of it runs into it."""
    scene, crate = room(*WALLS), room(*WALLS, [3.5, 2.2, 4.1, 2.8])
    paths = []
    for knows in (True, False):
        c, rng = controller(scene, robot), np.random.default_rng(seed)
        x = drive(c, start(c), 0.6, rng)[-1]
        if knows:
            c.update(crate)
        paths.append(drive(c, x, 12.0, rng))
        assert scene.goal.contains(paths[-1][-1, :2])
    assert [touched(crate, path) for path in paths] == [False, True]


STATE = r"the state (is|has) .*(2 numbers|finite numbers)$"
MISUSES = {
    "no scene": (
        lambda c: c.update(None),
        r"^an update is to a Scene, and None is none; Scene\.from_boxes",
    ),
    "no vertices": (lambda c: c.update(room(*WALLS), vertices=-1), r"^vertices is -1; .* whole number of at least 1"),
    "half a vertex": (lambda c: c.update(room(*WALLS), vertices=0.5), r"^vertices is 0\.5; .* whole number"),
    "no dt": (lambda c: c.step(np.array([0.5, 2.5]), None), r"^dt is None; a control is held for a positive number"),
    "dt of 0": (lambda c: c.step(np.array([0.5, 2.5]), 0.0), r"^dt is 0; a control is held for a positive number"),
    "begun at nan": (lambda c: c.begin(np.array([np.nan, 2.5])), STATE),
    "begun at a pose": (lambda c: c.begin(np.array([0.5, 2.5, 0.0])), STATE),
    "begun at a word": (lambda c: c.begin("here"), STATE),
    "begun at no time": (lambda c: c.begin(np.array([0.5, 2.5]), np.nan), r"^the time is nan; a run begins at"),
    "stepped at a word": (lambda c: c.step("here", 0.1), STATE),
    "one proposal": ({"propose": 5}, r"^propose is 5; it must be a sequence of functions"),
    "no functions": ({"propose": [1]}, r"^propose is \[1\]; it must be a sequence of functions"),
    "a backend's name": ({"backend": "x"}, r"^backend is 'x'; it must be None, or have the methods sample and replay"),
    "a seed": ({"rng": 1}, r"^rng is 1; it must be a generator"),
    "no sampling": ({"sampling": None}, r"^sampling is None; it must be a Sampling$"),
}


@pytest.fixture(scope="module")
def misused() -> Controller:
    return controller(room(*WALLS), vertices=60)


@pytest.mark.parametrize("case", MISUSES)
def test_what_a_controller_cannot_use_is_refused_in_one_line_and_changes_nothing(case: str, misused: Controller):
    act, message = MISUSES[case]
    before = misused.run, misused.tree

    def made(c: Controller) -> Controller:
        return Controller(c.problem, c.space, c.tree, **{"sampling": Sampling(), "rng": c.rng} | act)

    with pytest.raises(OptionError, match=message):
        (act if callable(act) else made)(misused)
    assert (misused.run, misused.tree) == before


@pytest.mark.parametrize("name", ["dt", "first", "samples", "window", "target", "budget"])
def test_a_number_of_sampling_that_is_none_is_refused(name: str):
    with pytest.raises(OptionError, match=f"^{name} is 'x'; it must be a number$"):
        Sampling(**{name: "x"})


def mppi(scene: Scene) -> Mppi:
    problem = Problem(dynamics=SingleIntegrator(b=0.3), scene=scene, R=2.0 * np.eye(2))
    sampling = Sampling(samples=300, guide="open-loop", draws="independent")
    return Mppi(problem, FreeSpace.of(scene), sampling, horizon=0.3, rng=np.random.default_rng(1))


def test_mppi_goes_on_along_the_shortest_paths_of_another_scene():
    one = mppi(room())
    x = one.problem.dynamics.state_of(one.problem.scene.start)
    open_room = one.plan(x).estimate.value
    one.update(room([2.0, 0.75, 2.4, 5.0]))
    assert len(one.space.scene.obstacles) == 1
    detour = 2.0 * (np.hypot(1.5, 1.9) + np.hypot(3.3, 1.8) - 4.75)  # below the wall, at 2 a metre
    assert one.plan(x).estimate.value - open_room == pytest.approx(detour, rel=0.2)
    one.update(room())
    assert one.plan(x).estimate.value == pytest.approx(open_room, rel=0.05)


def test_mppi_drives_by_what_scans_show():
    (wall,) = room([2.0, 0.75, 2.4, 5.0]).obstacles
    one = Mapped(mppi(room()), cell=0.1)
    x = one.problem.dynamics.state_of(one.problem.scene.start)
    one.begin(x)
    open_room = one.plan(x).estimate.value
    one.see(scan_of([wall], np.append(x, 0.0)))
    assert one.plan(x).estimate.value > open_room + 0.3
    assert one.space.scene.obstacles
    one.begin(x)
    assert not one.space.scene.obstacles


def test_mppi_examines_maps_in_the_background_once_it_has_a_plan(monkeypatch):
    walls = room([2.0, 2.0, 2.4, 3.0], [1.0, 0.5, 1.4, 1.0]).obstacles
    one = Mapped(mppi(room()), cell=0.1, background=True)
    x = one.problem.dynamics.state_of(one.problem.scene.start)
    threads = list[threading.Thread]()
    examined = one._examined

    def noted(occupied):
        threads.append(threading.current_thread())
        return examined(occupied)

    monkeypatch.setattr(one, "_examined", noted)
    one.begin(x)
    for known in (1, 2):
        one.see(scan_of(walls[:known], np.append(x, 0.0)))
        one.plan(x)
    one._pool.shutdown()
    main = threading.main_thread()
    assert [thread is main for thread in threads] == [True, False]


def test_a_law_that_is_solved_for_one_scene_has_no_other():
    with pytest.raises(OptionError, match="Optimal knows one scene alone; make another"):
        Optimal.__new__(Optimal).adopt(None)
