"""Drives among bodies that move: what is known or foretold of them, and that classes keep their names."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from discs import disc
from moving import SCENES, hall, moved

from pirrht.control.baselines import Mppi
from pirrht.control.controller import Controller
from pirrht.control.prediction import ConstantVelocity, favourite_path, straight_on
from pirrht.control.proposals import ProposalBuilder
from pirrht.control.settings import TimeBudget
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Motion
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.planner.tuning import TUNING
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch
from pirrht.steering.in_time import InTime
from pirrht.steering.straight_line import StraightLine
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.topology.homology import Driven

START = np.array([1.0, 2.5])


TURNING = [(0.0, 3.2, 0.6, 0.0), (1.0, 3.2, 1.4, 0.0), (2.0, 4.4, 1.4, 0.0), (3.0, 4.4, 1.4, 0.0)]


def rooted(space: FreeSpace, seed: int = 0) -> HomologyTree:
    return HomologyTree(space, InTime(), limit=0.8, rng=np.random.default_rng(seed))


def among(name: str = "crossing", b: float = 0.2) -> tuple[Problem, FreeSpace]:
    scene = SCENES[name]()
    return Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2.0 * np.eye(2)), FreeSpace.of(scene)


def controller(name: str = "crossing", b: float = 0.2, first: float | None = None, **more: object) -> Controller:
    problem, space = among(name, b)
    tree = rooted(space)
    tree.grow(400)
    sampling = Sampling(samples=400, threads=1, first=first)
    return Controller(problem, space, tree, sampling, rng=np.random.default_rng(1), **more)  # type: ignore[arg-type]


def sampled(one: Controller, monkeypatch: pytest.MonkeyPatch) -> list[Counter[str]]:
    """How many samples each plan from now on draws around each class."""
    found: list[Counter[str]] = []
    batch = ProposalBuilder.batch

    def counted(*given: Any) -> Batch:
        made = batch(*given)
        found.append(Counter())
        for proposal in made.proposals:
            found[-1][proposal.name] += proposal.count
        return made

    monkeypatch.setattr(ProposalBuilder, "batch", counted)
    return found


def by_velocity(space: FreeSpace) -> ConstantVelocity:
    return ConstantVelocity(space, InTime(), rooted, vertices=200)


def test_the_velocity_of_a_motion_is_that_which_led_to_where_it_is():
    motion = Motion(rows=np.array(TURNING))
    for t in (0.0, 0.3, 1.0):
        assert motion.velocity(t) == pytest.approx([0.0, 0.8, 0.0])
    assert motion.velocity(1.001) == pytest.approx([1.2, 0.0, 0.0])
    assert motion.velocity(7.0) == pytest.approx(np.zeros(3))
    again = replace(motion, repeat=True)
    assert again.velocity(3.5) == pytest.approx([0.0, 0.8, 0.0])
    assert again.velocity(3.0) == pytest.approx(np.zeros(3))
    assert motion.after(1.5).velocity(0.0) == pytest.approx([1.2, 0.0, 0.0])


def test_a_body_that_is_foretold_goes_straight_on_from_where_it_is():
    mover = moved("walker", TURNING, disc("disc", 0.0, 0.0, 0.3))
    on = straight_on(mover, 0.5, 10.0)
    for t in (0.0, 0.4, 3.0):
        assert on.motion.pose(t) == pytest.approx(mover.motion.pose(0.5) + t * np.array([0.0, 0.8, 0.0]))


def test_nothing_is_foretold_anew_before_a_body_moves_otherwise():
    space = FreeSpace.of(hall("turning", [moved("walker", TURNING, disc("disc", 0.0, 0.0, 0.3))]))
    prediction = by_velocity(space)
    first = prediction.at(START, 0.0)
    assert prediction.at(START, 0.9) is first
    second = prediction.at(START, 1.1)
    assert second is not first
    assert second.since == 1.1
    assert second.tree is not None
    assert second.tree.size == 200
    assert prediction.at(START, 1.9) is second
    prediction.begin()
    assert prediction.at(START, 0.0) is not second


def test_numbers_of_samples_stay_equal_among_bodies_where_they_are_to(monkeypatch):
    problem, space = among()
    tree = rooted(space)
    tree.grow(400)
    sampling = Sampling(samples=100, threads=1, allocation="equal")
    one = Controller(problem, space, tree, sampling, rng=np.random.default_rng(1))
    counts = sampled(one, monkeypatch)
    for _ in range(3):
        one.plan(START)
    assert len(counts) == 3
    assert {samples for count in counts for samples in count.values()} == {100}


def test_a_walker_that_goes_straight_on_is_foretold_exactly():
    """Before its rows end, knowing and seeing are the same; the values of plans from the same place agree."""
    problem, space = among()
    known = controller()
    seen = controller(predict=by_velocity(space))
    plans = [[one.plan(START) for _ in range(2)][1] for one in (known, seen)]
    assert plans[0].ids[:2] == plans[1].ids[:2]
    values = [plan.estimate.value for plan in plans if plan.estimate is not None]
    assert values[0] == pytest.approx(values[1], abs=0.05)
    assert problem.scene.movers


def test_a_class_keeps_its_name_when_something_else_is_foretold():
    """The walker turns at 1 s; what the robot follows is called as before, and the drive goes on in that class."""
    scene = hall("turning", [moved("walker", TURNING, disc("disc", 0.0, 0.0, 0.3))])
    problem, space = Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=2.0 * np.eye(2)), FreeSpace.of(scene)
    tree = rooted(space)
    tree.grow(300)
    one = Controller(
        problem, space, tree, Sampling(samples=200, threads=1), predict=by_velocity(space),
        rng=np.random.default_rng(3),
    )  # fmt: skip
    x, favourites = START.copy(), []
    one.begin(x)
    for _ in range(14):
        plan = one.plan(x)
        favourites.append(plan.favourite)
        x = x + 0.1 * plan.control
        one.observe(x[None], 0.1)
    assert one.run.since > 1.0
    assert favourites[9] in plan.ids
    assert len(set(favourites[8:])) == 1


def test_the_driven_class_among_bodies_is_that_of_the_whole_path():
    """Piece by piece, and with places that were only expected in between; as `Homology.winding` of it all."""
    space = FreeSpace.of(SCENES["pincer"]())
    homology = InTime().homology(space)
    rng = np.random.default_rng(4)
    for _ in range(20):
        times = np.linspace(0.0, 3.0, 13)
        path = np.column_stack([np.linspace(1.0, 4.8, 13), 2.5 + np.cumsum(rng.normal(0.0, 0.35, 13)), times])
        drive = Driven(homology, path[0], 0.0)
        for k in range(1, 13, 3):
            drive.expect(rng.uniform(1.0, 4.0, (2, 2)), float(times[k + 2]))
            drive.observe(path[k : k + 3, :2], float(times[k + 2]))
        assert drive.winding() == homology.winding(path)


@pytest.mark.parametrize("few", [0, 60, 1000])
def test_a_tree_that_is_grown_anew_is_as_large_as_is_enough(few):
    """And by less than one batch of draws larger; all of it where nothing less is."""
    _, space = among()
    tree = by_velocity(space).at(START, 0.0, lambda vertices: vertices >= few).tree
    assert tree is not None
    assert min(few, 200) <= tree.size <= min(few + TUNING.draws_in_time, 200)
    assert few == 0 or tree.references(np.array([*START, 0.0]))


def test_mppi_goes_by_the_clock_of_the_bodies():
    """What stands in the way at 2 s does not at 0: the two plans differ, and each is that of its own time."""
    problem, space = among("crossing", 0.3)
    sampling = Sampling(samples=500, threads=1, guide="open-loop", draws="independent")
    one = Mppi(problem, space, sampling, rng=np.random.default_rng(0))
    values = []
    for time in (0.0, 2.5):
        one.begin(np.array([2.2, 2.5]), time)
        plan = [one.plan(np.array([2.2, 2.5])) for _ in range(5)][4]
        assert plan.time == time
        values.append(plan.estimate.value if plan.estimate is not None else np.inf)
    assert abs(values[0] - values[1]) > 0.05


def test_samples_of_a_class_that_was_not_looked_at_have_its_name_still(monkeypatch):
    """Ten plans at one place that look at one class, after one that looked at all; equal seeds but for that; b = 0.3.

    Before and behind the body weigh alike there, so that many samples around one way go the other. Without a name
    they would all be "other".
    """
    one = controller(b=0.3)
    names = set(one.plan(START).ids)
    monkeypatch.setattr(TimeBudget, "most_classes", lambda self, classes: 1)
    one.run.most = 1
    found = [one.plan(START) for _ in range(10)]
    assert all(len(plan.ids) == 1 for plan in found)
    shares = [plan.estimate.class_weights for plan in found if plan.estimate is not None]
    unseen = [
        sum(w for name, w in each.items() if name in names - set(plan.ids))
        for each, plan in zip(shares, found, strict=True)
    ]
    assert np.mean(unseen) > 0.05
    assert np.mean([each["other"] for each in shares]) < 0.01
    assert all(plan.favourite in names for plan in found)


def test_where_all_classes_are_looked_at_no_other_has_a_name():
    one = controller()
    for x in (START, START + np.array([0.3, 0.1])):
        one.begin(x)
        plan = one.plan(x)
        assert list(plan.classes.values()) == list(plan.ids)


def test_of_a_favourite_in_one_piece_its_end_is_known_again():
    """Who hurries straight past a body is not of the class of the straight way at the best speed."""
    steering = InTime()
    path = steering.connect(np.array([[1.0, 2.5, 4.0]]), np.array([[5.2, 2.4, 5.5]]))
    found = Reference(winding=(1,), signature=np.ones(1), trajectory=steering.trajectory(path))
    plan = SimpleNamespace(ids=("1",), references=(found,), favourite="1", time=7.0)
    np.testing.assert_allclose(favourite_path(plan)[-1], [5.2, 2.4, 8.5])
    assert favourite_path(SimpleNamespace(ids=(), references=(), favourite=None, time=7.0)) is None


def test_the_end_of_a_way_along_curves_is_known_again_too():
    lines = StraightLine(pace=1.0, cost_rate=2.0)
    path = lines.connect(np.array([[1.0, 2.5]]), np.array([[4.0, 2.5]]))
    found = Reference(winding=(0,), signature=np.ones(1), trajectory=lines.trajectory(path))
    plan = SimpleNamespace(ids=("0",), references=(found,), favourite="0", time=1.0)
    np.testing.assert_allclose(favourite_path(plan)[-1], [4.0, 2.5, 4.0])
