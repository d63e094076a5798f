"""References are as short as can be: free, of their class, taut; by our own shortening and by that of any steering."""

from typing import Any

import numpy as np
import pytest
from discs import block, disc, scattered, scene_of
from trees import grown

from pirrht import Dubins, FreeSpace, Reference, Scene, Steering, StraightLine
from pirrht.arrays import Array
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.polyline import taut_polyline

RADIUS, GOAL = 0.1, 0.1  # of the robot and of the goal's disc [m]
TOUCHES = 0.01  # clearance of a corner [m]


def length(points: Array) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


@pytest.mark.parametrize("seed", range(8))
def test_every_corner_of_a_taut_reference_touches_something(seed: int):
    space = FreeSpace.of(scattered(seed))
    for reference in grown(space, StraightLine(), 500, seed=seed).references(space.scene.start[:2]):
        points = reference.trajectory.points
        assert np.all(space.collision.segments_free(points[:-1], points[1:]))
        assert space.homology.winding(points) == reference.winding
        assert len(points) == 2 or space.collision.clearance(points[1:-1]).max() < TOUCHES


@pytest.mark.parametrize("seed", range(4))
def test_paths_of_hopeless_classes_are_not_shortened_unless_they_were_cheap_before(seed: int):
    space = FreeSpace.of(scattered(seed))
    start = space.scene.start[:2]
    tree = grown(space, StraightLine(), 300, seed=seed)
    raw = {one.winding: one.cost for one in tree.references(start, shortened=False)}
    short = {one.winding: one for one in tree.references(start)}
    before = {winding: one.path for winding, one in short.items()}
    some = {one.winding: one.cost for one in tree.references(start, hopeless=lambda least: least)}
    again = {one.winding: one.cost for one in tree.references(start, before=before, hopeless=lambda least: least)}
    cheap = {winding for winding in raw if 0.75 * raw[winding] <= min(raw.values())}
    assert some == {winding: short[winding].cost if winding in cheap else raw[winding] for winding in raw}
    assert all(again[winding] == short[winding].cost for winding in raw if short[winding].cost <= min(raw.values()))
    assert len(cheap) < len(raw)


@pytest.mark.parametrize("seed", range(20))
def test_a_corner_that_touches_nothing_goes_also_before_the_goal(seed: int):
    """A path over needless points beside the straight line, its last corner close to the disc it ends in."""
    rng = np.random.default_rng(seed)
    space = FreeSpace.of(scene_of([block("stone", 3.0, 3.0, (0.4, 0.3), rng.uniform(0, 3))],
                                  start=(0.5, 3.0), goal=(5.5, 3.0)))  # fmt: skip
    middle = np.array([[1.0, 3.2], [1.7, 4.2], [3.0, 4.5], [4.2, 4.0], [4.9, 3.2], [5.3, 3.1]])
    middle += rng.uniform(-0.15, 0.15, middle.shape)
    path = np.vstack([[0.5, 3.0], middle, [5.45, 3.0]])
    short = taut_polyline(path, StraightLine().checker(space))
    assert np.all(space.collision.segments_free(short[:-1], short[1:]))
    assert space.homology.winding(short) == space.homology.winding(path)
    assert length(short) <= length(path)
    assert space.collision.clearance(short[1:-1]).max() < TOUCHES


@pytest.mark.parametrize("radius", [0.2, 0.5, 1.0, 1.8])
def test_around_a_disc_a_reference_has_the_length_of_tangents_and_arc(radius: float):
    space = FreeSpace.of(scene_of([disc("pillar", 3.0, 3.0, radius)], start=(0.5, 3.0), goal=(5.5, 3.0)))
    inflated, far = radius + RADIUS, 2.5
    whole = 2.0 * (np.sqrt(far**2 - inflated**2) + inflated * np.arcsin(inflated / far))
    references = grown(space, StraightLine(), 500).references(space.scene.start[:2])
    assert len(references) == 2
    for reference in references:
        assert whole - GOAL - 1e-6 < reference.length < 1.005 * (whole - GOAL)


class Foreign(Steering):
    """What a user writes: the methods that must be there, in NumPy, and none that are compiled."""

    def __init__(self, own: Any) -> None:
        self.own, self.n, self.speed, self.cost_per_meter = own, own.n, own.speed, own.cost_per_meter

    def distance(self, tails: Array, heads: Array) -> Array:
        return self.own.distance(tails, heads)

    def connect(self, tails: Array, heads: Array) -> Any:
        return self.own.connect(tails, heads)

    def controls(self, heading: Array, curvature: Array) -> Array:
        return self.own.controls(heading, curvature)

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        return self.own.sample(scene, rng)

    def roots(self, goal: Array) -> Array:
        return self.own.roots(goal)


class Patient(StraightLine):
    """Straight lines whose paths stay as the tree has them."""

    def shorten(self, path: Any, checker: EdgeChecker) -> Any:
        return path


def by_class(references: list[Reference]) -> dict[tuple[int, ...], Reference]:
    return {reference.winding: reference for reference in references}


@pytest.mark.parametrize("seed", range(3))
def test_straight_lines_of_a_foreign_steering_are_as_taut_as_our_own(seed: int):
    space = FreeSpace.of(scattered(seed))
    x = space.scene.start[:2]
    foreign, own = (grown(space, s, 150).references(x) for s in (Foreign(StraightLine()), StraightLine()))
    shared = by_class(foreign).keys() & by_class(own).keys()
    assert len(shared) >= 2
    for winding in shared:
        assert by_class(foreign)[winding].length == pytest.approx(by_class(own)[winding].length, rel=1e-3)


def test_a_steering_that_shortens_otherwise_is_asked_for_it():
    space = FreeSpace.of(scattered(0))
    x = space.scene.start[:2]
    tree = grown(space, Patient(), 150)
    assert [one.length for one in tree.references(x)] == [one.length for one in tree.references(x, shortened=False)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_curves_of_a_foreign_steering_are_pulled_taut_by_its_own_connections(seed: int):
    """Free, of the same class, never longer, and hardly longer than what is made for Dubins curves."""
    space = FreeSpace.of(scattered(seed))
    car = Dubins(rho=0.4)
    tree = grown(space, Foreign(car), 250)
    x = space.scene.start[:3]
    rough, fine = tree.references(x, shortened=False), by_class(tree.references(x))
    special = grown(space, car, 250).references(x)
    assert len(rough) >= 2
    for before in rough:
        after = fine[before.winding]
        assert after.length <= before.length * (1 + 1e-9)
        assert space.collision.clearance(after.trajectory.points).min() > -1e-3
        assert space.homology.winding(after.trajectory.points) == before.winding
    lengths = {reference.winding: reference.length for reference in special}
    ratios = [fine[w].length / lengths[w] for w in fine.keys() & lengths.keys()]
    assert np.median(ratios) < 1.02
    assert max(ratios) < 1.15
