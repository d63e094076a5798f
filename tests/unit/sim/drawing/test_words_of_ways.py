"""Classes in words, in colours, and as the way that samples went on average."""

from dataclasses import replace
from itertools import permutations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from discs import block
from drives import Drive
from moving import moved

from pirrht.geometry.scene import Footprint
from pirrht.topology.homology import Homology
from sim.drawing import strokes
from sim.drawing.colors import EARLY, ClassColors, method_color, nth_color, passing, place_of, sides, worded
from sim.scenario import prepare

WALLS = ("upper wall", "lower wall")
SLIT = {"0,0": (0, 0), "0,1": (0, 1), "-1,0": (-1, 0)}
START = np.array([0.458, -0.458])  # H of the straight line between the walls, by which one passes both


def test_ways_are_named_by_the_sides_on_which_they_pass():
    assert worded(SLIT, START, WALLS) == {
        "0,0": "between upper wall and lower wall",
        "0,1": "right of lower wall",
        "-1,0": "left of upper wall",
    }


def random_classes(rng: np.random.Generator, static: int, moving: int) -> tuple[list[Any], Homology]:
    """Paths of different classes among random obstacles, some of which stand or share a name, and their homology."""
    markers, goal = rng.uniform(0.0, 6.0, (static, 2)), rng.uniform(5.0, 6.0, 2)
    movers = []
    for j in range(moving):
        times = np.cumsum(rng.uniform(0.2, 2.0, 4)) * np.arange(4)
        rows = np.column_stack([times - times[0], rng.uniform(0.0, 6.0, (4, 2)), np.zeros(4)])
        rows[:, 1:3] = rows[:1, 1:3] if rng.random() < 0.2 else rows[:, 1:3]
        movers.append(moved(("walker", "cart", "walker", "van", "door")[j], rows, block("b", 0.0, 0.0, (0.1, 0.1))))
    homology = Homology(markers=markers, goal=goal).with_moving(movers, Footprint(0.1, 0.1))
    found, start = {}, rng.uniform(0.0, 1.0, 2)
    for _ in range(40):
        places = np.vstack([start, rng.uniform(-1.0, 7.0, (rng.integers(0, 6), 2)), goal])
        knots = np.column_stack([places, np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 2.0, len(places) - 1))])])
        winding = homology.winding(knots)
        path = SimpleNamespace(path=SimpleNamespace(knots=knots))
        found[winding] = SimpleNamespace(
            winding=winding, signature=homology.signature(knots[0], winding), trajectory=path, id=str(winding)
        )
    return [*found.values()], homology


@pytest.mark.parametrize("moving", range(6))
@pytest.mark.parametrize("static", [0, 1, 2, 5])
def test_no_two_classes_are_called_the_same(static, moving):
    rng, classes = np.random.default_rng(10 * static + moving), 0
    for _ in range(5):
        found, homology = random_classes(rng, static, moving)
        windings = {one.id: one.winding for one in found}
        passed = dict(zip(windings, sides(found, homology), strict=True)) if moving else None
        straight = np.array(found[0].signature[:static]) - found[0].winding[:static] - 1.0
        names = ["post", "table", "post", "lamp", "shelf"][:static]
        for among in (None, {*list(windings)[:2]}, set()):
            words = worded(windings, straight, names, homology.names, among, passed)
            assert len({*words.values()}) == len(windings)
        if moving:
            assert len({tuple(lines) for lines in passing(found, homology)}) == len(windings)
        classes += len(windings)
    assert classes > 10 or static + moving == 0


def coming(angle: float, aside: float, speed: float = 1.0) -> str:
    """How a robot that goes along x at 1 m/s passes a walker in its way that goes in a direction [rad]."""
    way = np.array([[0.0, 0.0, 0.0], [4.0, 2.0 * aside, 4.0], [8.0, 0.0, 8.0]])
    heading = speed * np.array([np.cos(angle), np.sin(angle)])
    rows = [(t, *((4.0, 0.0) + heading * (t - 4.0)), 0.0) for t in (0.0, 8.0)]
    walker = moved("walker", rows, block("b", 0.0, 0.0, (0.1, 0.1)))
    homology = Homology(markers=np.zeros((0, 2)), goal=np.array([8.0, 0.0])).with_moving([walker], Footprint(0.1, 0.1))
    winding = homology.winding(way)
    one = SimpleNamespace(winding=winding, signature=homology.signature(way[0], winding), id="")
    one.trajectory = SimpleNamespace(path=SimpleNamespace(knots=way))
    return sides([one], homology)[0][0]


@pytest.mark.parametrize(
    ("angle", "aside", "speed", "said"),
    [
        (np.pi, 0.2, 1.0, "left of"),
        (np.pi, -0.2, 1.0, "right of"),
        (np.pi - 0.4, 0.2, 1.0, "left of"),
        (np.pi + 0.4, -0.2, 1.0, "right of"),
        (0.0, 0.2, 0.5, "left of"),
        (0.0, -0.2, 2.0, "right of"),
        (0.0, 0.2, 2.0, "left of"),
        (0.5 * np.pi, 0.2, 1.0, "before"),
        (0.5 * np.pi, -0.2, 1.0, "behind"),
        (-0.5 * np.pi, 0.2, 1.0, "behind"),
        (-0.5 * np.pi, -0.2, 1.0, "before"),
        (0.0, 0.2, 0.0, "left of"),
    ],
)
def test_who_comes_towards_the_robot_is_passed_left_or_right_and_who_crosses_its_way_before_or_behind(
    angle, aside, speed, said
):
    assert coming(angle, aside, speed) == said


def test_a_class_is_told_apart_from_those_that_matter():
    windings = {"0,0,0": (0, 0, 0), "0,1,0": (0, 1, 0), "0,0,1": (0, 0, 1)}
    straight, names = np.array([0.4, -0.4, -0.3]), ["table", "shelf", "lamp"]
    assert worded(windings, straight, names)["0,0,0"] == "left of shelf and lamp"
    assert worded(windings, straight, names, among={"0,0,0", "0,1,0"})["0,0,0"] == "left of shelf"


def test_a_class_has_its_colour_in_every_picture_whatever_came_before():
    names = ("0,0", "0,1", "-1,0", "1,0", "0,-1")
    assert len({place_of(name) for name in names}) == len(names)
    for order in permutations(names):
        colors = ClassColors(order)
        assert [colors[name] for name in names] == [ClassColors()[name] for name in names]


@pytest.fixture(scope="module")
def planned():
    drive = Drive()
    drive.controller.begin(drive.scene.start[:2])
    plan = drive.controller.plan(drive.scene.start[:2])
    key = drive.space.homology.key
    return drive, plan, {key(r.winding): name for r, name in zip(plan.references, plan.ids, strict=True)}


def test_samples_without_weight_are_drawn_and_not_seen(planned):
    """Of a plan whose earlier samples have all the weight: nothing is divided by it."""
    drive, plan, _ = planned
    weightless = replace(plan.estimate, weight=np.zeros_like(plan.estimate.weight))
    found = strokes.fans(drive.controller.path_integral, weightless, plan.classes, points=400, everything=False)
    assert found
    assert all(len(fan.opacity) and not fan.opacity.any() for fan in found.values())


def test_the_average_way_of_a_class_is_free_and_of_that_class(planned):
    drive, plan, names = planned
    ways = strokes.mean_paths(drive.controller.path_integral, plan.estimate, names)
    heavy = {name for name, w in plan.estimate.class_weights.items() if w > 0.01}
    assert heavy
    assert heavy <= ways.keys()
    for name in heavy:
        line = ways[name]
        np.testing.assert_allclose(line[0], plan.state, atol=1e-9)
        assert drive.space.collision.segments_free(line[:-1], line[1:]).all()
        assert names[drive.space.homology.key(drive.space.homology.winding(line))] == name


def test_methods_have_colours_that_no_early_class_has():
    classes = {nth_color(k) for k in range(EARLY)}
    assert len({method_color(k) for k in range(9)} - classes) == 9


def among(scene: str, vertices: int, *ids: str):
    """A scene of moving obstacles, its references of these ids, and how each passes them."""
    scenario = prepare(scene, given={"vertices": vertices})
    references = {one.id: one for one in scenario.references(scenario.grown_tree()) if one.id in ids}
    found = sides([*references.values()], scenario.homology)
    return scenario, references, dict(zip(references, found, strict=True))


def test_ways_among_moving_obstacles_are_named_by_whether_they_pass_before_or_behind():
    """The crosser goes up: above it a path passes before it, below it behind it."""
    scenario, references, passed = among("crossing", 200, "0", "1")
    motion = scenario.loaded.scene.movers[0].motion
    for name, one in references.items():
        t, x, y = one.path.knots[:, 2], one.path.knots[:, 0], one.path.knots[:, 1]
        time = float(np.interp(3.25, x, t))
        above = np.interp(time, t, y) > motion.pose(time)[1]
        assert passed[name] == (("before",) if above else ("behind",))
    words = worded({n: r.winding for n, r in references.items()}, np.zeros(0), (), ("walker",), None, passed)
    assert set(words.values()) == {"before walker", "behind walker"}


def test_bodies_that_rest_are_passed_left_or_right():
    """The discs of `pincer` have met when the robot comes by below or above them."""
    scenario, references, passed = among("pincer", 300, "0,0", "1,0", "0,-1")
    assert passed == {"0,0": ("before",) * 2, "1,0": ("right of",) * 2, "0,-1": ("left of",) * 2}
    assert ["low: right of it", "high: right of it"] in passing([*references.values()], scenario.homology)
    words = worded({name: references[name].winding for name in passed}, np.zeros(0), (), ("low", "high"), None, passed)
    assert len(set(words.values())) == 3
