"""Guides of the car: cheap, free, of their class, stabilising; and the weights of samples drawn around them are exact.

Statistical tests compare a mean over independent samples or seeds with the exact value in units of its standard error.
"""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from batches import batch_of
from discs import disc, scene_of
from guides import best, valid
from trees import grown

from pirrht import Controller, Dubins, FreeSpace, Problem, Sampling, Scene, Unicycle, path_integral
from pirrht.proposals.guide import DDPGuide
from pirrht.steering.motion import Trajectory, running_cost

Found = tuple[Trajectory, tuple[int, ...]]


@cache
def case(post: bool, b: float, goal: float) -> tuple[Problem, FreeSpace, tuple[Found, ...]]:
    """Problem, free space and the shortened references at the start; passing the post on the right is cheaper."""
    posts = [disc("post", 2.2, 0.1, 0.5)] if post else []
    ends = {"start": (0.0, 0.0), "goal": (goal, 0.0, 0.4), "lower": (-1.0, -3.0), "side": (6.0, 3.0)}
    scene = scene_of(posts, **ends, radius=0.15)
    problem, space = Problem(dynamics=Unicycle(b=b), scene=scene, R=np.eye(1), phi=1000.0), FreeSpace.of(scene)
    tree = grown(space, Dubins.of(problem), 300)
    return problem, space, tuple((r.trajectory, r.winding) for r in tree.references(scene.start))


def setting(steps: str = "fitted"):
    """Sampler, grid, and the guide of each class past the post."""
    problem, space, references = case(True, 0.03, 4.5)
    integral = path_integral(problem, space, Sampling(steps=steps))
    times = integral.grid(max(running_cost(problem, problem.scene.start, t) for t, _ in references))
    return integral, times, [valid(integral, problem.scene.start, times, w, t) for t, w in references]


def polyline(guide) -> np.ndarray:
    return guide.states[: guide.length + 1, :2]


def test_guides_cost_less_than_the_curves_they_come_from_and_stay_free_and_in_class():
    integral, _, guides = setting()
    assert len(guides) == 2
    for guide, (trajectory, winding) in zip(guides, case(True, 0.03, 4.5)[2], strict=True):
        assert guide.valid
        assert guide.cost < running_cost(integral.problem, np.zeros(3), trajectory)
        line = polyline(guide)
        assert integral.space.collision.clearance(np.vstack([line, 0.5 * (line[1:] + line[:-1])])).min() > 0.0
        assert integral.space.homology.winding(line) == winding


@pytest.mark.parametrize(("late", "most"), [(False, 12), (True, 2)])
def test_by_a_clock_guides_are_free_at_once_and_cheaper_from_plan_to_plan_until_they_cost_the_least(late, most):
    integral, times, optima = setting()
    guidance, x = integral.guidance, np.zeros(3)
    optimise, passes = guidance.optimise, list[int]()

    def counted(*arguments):
        passes.append(arguments[5])
        return optimise(*arguments)

    guidance.optimise = counted
    for optimum, (trajectory, winding) in zip(optima, case(True, 0.03, 4.5)[2], strict=True):
        query = guidance.query(x, times, integral.space.homology.key(winding))
        found, costs = list[DDPGuide](), [np.inf]
        for _ in range(30):
            found = guidance.optima(query, trajectory, found[:1], short=lambda: late)
            assert found[0].valid
            costs.append(found[0].penalised)
        tolerance = guidance.tuning.tolerance * integral.temperature
        assert np.all(np.diff(costs) < tolerance)
        assert costs[-1] == pytest.approx(optimum.penalised, abs=5.0 * tolerance)
    assert max(passes) == most


def test_a_guide_is_a_minimum_of_what_it_minimises():
    integral, _, (guide, *_) = setting(steps="uniform")
    rng = np.random.default_rng(0)

    def cost(control: np.ndarray) -> float:
        x, total = np.zeros(3), 0.0
        for i in range(guide.length):
            middle = x[2] + 0.05 * control[i]
            total += 0.1 * (1.0 + 0.5 * control[i] ** 2)
            for k in range(1, 5):
                point = x[:2] + 0.025 * k * np.array([np.cos(middle), np.sin(middle)])
                total += 0.025 * barrier(float(integral.space.collision.clearance(point[None])[0]))
            x = x + 0.1 * np.array([np.cos(middle), np.sin(middle), control[i]])
        gap = integral.problem.scene.goal.center - x[:2]
        along = gap @ [np.cos(x[2]), np.sin(x[2])]
        return total + along - np.sqrt(0.16 - gap @ gap + along**2)

    def barrier(c: float) -> float:
        car = integral.guidance.tasks[1.0]
        if c >= car.margin:
            return 0.0
        if c <= 0.0:
            return np.inf
        edge = car.margin ** (-2 / 3)
        return car.price * (c ** (-2 / 3) - edge + 2 / 3 * edge / car.margin * (c - car.margin))

    control = guide.tape[:, 0]
    best = cost(control)
    assert best == pytest.approx(guide.penalised, abs=2e-3)  # the field errs by up to a millimetre
    t = np.linspace(0.0, 1.0, len(control))
    for _ in range(10):
        assert cost(control + 0.02 * sum(rng.normal() * np.sin(k * np.pi * t) for k in range(1, 6))) > best


@pytest.mark.parametrize("steps", ["fitted", "uniform"])
def test_likelihood_ratios_of_feedback_guides_average_to_one(steps):
    """E_Q[dQ_g / dQ] = 1 for each law Q and passive paths, wherever the ratio has a variance that samples can see.

    The noise of a guide is narrower than the passive one, so dP/dQ itself has tails; that of a weak law has not.
    """
    problem, space, references = case(False, 0.3, 2.0)
    integral = path_integral(problem, space, Sampling(steps=steps))
    times = np.arange(9) * 0.1  # the goal is out of reach: nothing ends a path early
    far = np.arange(100) * 0.1
    x = np.array([0.0, 0.0, 0.35])
    steering = Dubins.of(problem)
    curve = steering.trajectory(steering.connect(x[None], np.array([[2.0, 0.0, -0.4]])))
    guide = best(integral.guidance, x, far, space.homology.key(references[0][1]), curve)
    cut = replace(guide, times=times, states=guide.states[:9], modes=guide.modes[:8], gains=guide.gains[:8],
                  share=guide.share[:8], inverse=guide.inverse[:8], volume=guide.volume[:8], length=8)  # fmt: skip
    modes = cut.modes.shape[1]
    assert modes == (2 if steps == "fitted" else 1)
    assert np.all(np.any(cut.modes != 0.0, axis=0))
    share = np.tile(0.97 * np.eye(modes), (8, 1, 1))
    wide = replace(cut, modes=0.4 * cut.modes, gains=0.3 * cut.gains, share=share, inverse=np.linalg.inv(share),
                   volume=np.full(8, modes * np.log(0.97)))  # fmt: skip
    other = replace(cut, modes=cut.modes + 0.5, gains=1.2 * cut.gains)
    laws = {"passive": None, "cut": cut, "wide": wide, "other": other}
    names = list(laws)
    assert np.any(cut.gains != 0.0)
    assert cut.share.min() < 0.95
    for source, target in [("passive", "cut"), ("passive", "other"), ("wide", "passive"), ("cut", "other")]:
        counts = [40000 * (name == source) for name in names]
        batch = batch_of(integral, x, times, np.zeros((4, 8, 1)), counts=counts, guides=list(laws.values()))
        ratio = integral.rollout(batch, 3).paths.log_ratio
        weight = np.exp(ratio[:, names.index(target)] - ratio[:, names.index(source)])
        error = weight.std() / np.sqrt(len(weight))
        assert 0.0 < error < 0.1
        assert abs(weight.mean() - 1.0) < 3.0 * error, (source, target)


def test_the_next_guide_starts_from_the_last_and_agrees_with_a_fresh_one():
    problem, space, references = case(True, 0.03, 4.5)
    integral, times, (last, *_) = setting()
    x = last.states[1] + np.array([0.0, 0.002, 0.01])
    key = space.homology.key(references[0][1])
    warm = best(integral.guidance, x, times, key, references[0][0], last, 0.1)
    rest = last.rest(0.1, problem.scene.goal.center)
    fresh = best(integral.guidance, x, times, key, rest)
    assert warm.valid
    assert warm.penalised == pytest.approx(fresh.penalised, abs=1e-4)
    assert rest.length == pytest.approx(references[0][0].length, abs=0.5)
    assert last.rest(100.0, problem.scene.goal.center) is None


def test_a_course_that_high_prices_of_walls_lead_astray_is_begun_anew_at_the_true_price(monkeypatch):
    problem, space, references = case(True, 0.03, 4.5)
    integral, x = path_integral(problem, space, Sampling()), problem.scene.start
    times = integral.grid(max(running_cost(problem, x, t) for t, _ in references))
    guidance, (trajectory, winding) = integral.guidance, references[0]
    expected = valid(integral, x, times, winding, trajectory)
    optimise = guidance.optimise

    def lost(setup, classes, task, *rest):
        return optimise(setup, classes, task, *rest) if task is guidance.tasks[1.0] else (-1, np.inf, np.inf, False)

    monkeypatch.setattr(guidance, "optimise", lost)
    assert valid(integral, x, times, winding, trajectory).penalised == pytest.approx(expected.penalised, rel=1e-3)


def test_a_unicycle_turns_tighter_than_its_references_where_walls_leave_no_other_way_to_turn():
    """Next to the gap of a wall, less is left to turn, and to pay, from heading to heading; references turn away."""
    walls = [(1.0, -3.0, 1.1, -0.35), (1.0, 0.35, 1.1, 3.0)]
    start = (0.55, 0.0, -2.0)
    scene = Scene.from_boxes(walls, lower=(-1.5, -2.0), upper=(3.0, 2.0), robot_radius=0.2, start=start,
                             goal=(2.5, 0.0, 0.3))  # fmt: skip
    problem = Problem(scene=scene, dynamics=Unicycle(rho=0.5, b=0.4), R=np.eye(1))
    space = FreeSpace.of(scene)
    controller = Controller(
        problem, space, grown(space, Dubins.of(problem), 400), Sampling(samples=200), rng=np.random.default_rng(1)
    )
    estimates = []
    for heading in (-2.2, -2.0, -1.8):
        controller.begin(np.array([0.55, 0.0, heading]))
        estimates.append(controller.plan(np.array([0.55, 0.0, heading])).estimate)
    assert all(a.value > b.value + 0.1 for a, b in pairwise(estimates))
    assert all(one.control[0] > 2.0 for one in estimates)
