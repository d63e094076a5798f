"""Classes in words, in colours, and as the way that samples went on average."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from drives import Drive

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


def test_no_two_classes_are_called_the_same():
    rng = np.random.default_rng(0)
    for _ in range(50):
        rows = {tuple(row) for row in rng.integers(-1, 2, size=(12, 5)).tolist()}
        straight = rng.uniform(0.05, 0.45, 5) * rng.choice([-1, 1], 5)
        words = worded({str(row): row for row in rows}, straight, [f"post {k}" for k in range(5)])
        same = [(a, b) for a in rows for b in rows if a < b and words[str(a)] == words[str(b)]]
        for a, b in same:  # only how often they go round can be left unsaid
            assert max(abs(straight[k] + r[k]) for r in (a, b) for k in range(5)) >= 1.0


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
    return scenario, references, {name: sides(one, scenario.homology) for name, one in references.items()}


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
    assert passing(references["1,0"], scenario.homology) == ["low: right of it", "high: right of it"]
    words = worded({name: references[name].winding for name in passed}, np.zeros(0), (), ("low", "high"), None, passed)
    assert len(set(words.values())) == 3
