"""The controller names classes by the whole drive, goes on when nothing is known, leaves out what takes long."""

from dataclasses import replace
from itertools import count, pairwise

import numpy as np
import pytest

from pirrht import (
    Controller,
    FreeSpace,
    HomologyTree,
    NoReference,
    OptionError,
    Problem,
    Sampling,
    Scene,
    SingleIntegrator,
)
from pirrht.control.settings import TUNING, TimeBudget
from sim.scenario import prepare

HIDDEN = np.array([1.0, 3.4])  # from here the goal point is behind the upper wall
DT = 0.05


def along(points: np.ndarray, spacing: float) -> np.ndarray:
    """Points at equal distances on a polyline (k, 2)."""
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.arange(0.0, lengths[-1], spacing)
    return np.column_stack([np.interp(at, lengths, points[:, k]) for k in (0, 1)])


@pytest.mark.parametrize("name", ["0,0", "-1,0", "0,1"])
def test_a_class_keeps_its_name_all_the_way(slit, slit_tree: HomologyTree, name: str):
    controller = slit.with_settings(samples=50).controller(slit_tree)
    first = controller.plan(slit.start)
    reference = first.references[first.ids.index(name)]
    controller.begin(slit.start)
    assert controller.driven_class() == (0, 0)
    relative = set()
    for part in np.array_split(along(reference.trajectory.points, 0.02)[1:], 12):
        controller.observe(part, 0.3)
        plan = controller.plan(part[-1])
        assert name in plan.ids
        assert len(set(plan.ids)) == len(plan.ids)
        relative.add(plan.references[plan.ids.index(name)].id)
        assert plan.estimate.class_weights.keys() == {*plan.ids, "other"}
    assert controller.driven_id() == name
    if name != "0,0":
        assert relative != {name}  # seen from where the robot is, the class has another name


def test_methods_differ_in_the_references_they_sample_around(slit, slit_tree: HomologyTree):
    for method, ids in (("pi-rrht", ("0,0", "-1,0", "0,1")), ("single", ("0,0",))):
        plan = slit.with_settings(method=method, samples=50).controller(slit_tree).plan(slit.start)
        assert plan.ids[0] == "0,0"
        assert set(plan.ids) == set(ids)
    nobody = slit.with_settings(method="passive", samples=50).controller(None).plan(slit.start)
    assert nobody.references == ()
    assert nobody.fallback == "no survivor"  # noise alone does not find the goal
    assert np.all(nobody.control == 0.0)


@pytest.mark.parametrize("guide", ["feedback", "open-loop"])
def test_a_held_plan_is_its_control_now_and_its_tape_later(slit, slit_tree: HomologyTree, guide: str):
    plan = slit.with_settings(samples=200, guide=guide, between="hold").controller(slit_tree).plan(slit.start)
    assert plan.times[0] == 0.0
    assert len(plan.times) == len(plan.tape) + 1
    for x in [plan.state, *np.array([[3.4, 2.55], [0.1, 0.1]])][: 3 if guide == "open-loop" else 1]:
        np.testing.assert_array_equal(plan.at(x, 0.0), plan.control)
    for i in (1, 5, 20, len(plan.tape) - 1):
        for t in (plan.times[i], 0.5 * (plan.times[i] + plan.times[i + 1])):
            np.testing.assert_array_equal(plan.at(plan.state, t), plan.tape[i])
    assert np.all(plan.at(plan.state, plan.times[-1] + 1.0) == 0.0)
    weights = plan.estimate.class_weights
    assert plan.favourite == max(weights, key=lambda name: weights[name]) == "0,0"


def test_steps_are_the_plans_of_a_loop_that_observes(slit, slit_tree: HomologyTree):
    one, other = (slit.with_settings(samples=50).controller(slit_tree) for _ in range(2))
    x = slit.start
    for k in range(3):
        u = one.step(x, DT)
        if k:
            other.observe(x[None], DT)
        np.testing.assert_array_equal(u, other.plan(x).control)
        x = x + DT * u
    assert one.run.clock.time == pytest.approx(2 * DT)
    one.begin(slit.start)
    one.step(slit.start, DT)
    assert one.run.clock.time == 0.0
    with pytest.raises(OptionError, match="dt is 0"):
        one.step(slit.start, 0.0)


def test_who_forgets_to_observe_is_warned(slit):
    mppi = slit.with_settings(method="mppi", samples=50).controller(None)
    mppi.plan(slit.start)
    mppi.plan(slit.start)  # the same question again
    with pytest.warns(RuntimeWarning, match=r"nothing was observed in between: call step\(x, dt\)"):
        mppi.plan(slit.start + 0.01)
    mppi.begin(slit.start + 0.02)
    mppi.plan(slit.start + 0.02)


def test_the_first_plan_of_a_drive_draws_until_enough_samples_are_effective(slit, slit_tree: HomologyTree):
    few = slit.with_settings(samples=4, noise=0.3)
    plain, until = (few.controller(slit_tree) for _ in range(2))
    plain.path_integral.sampling = replace(few.sampling, least=0.0)
    until.path_integral.sampling = replace(few.sampling, least=40.0)
    first, more = plain.plan(slit.start).estimate, until.plan(slit.start).estimate
    assert first.ess < 40.0 <= more.ess
    np.testing.assert_array_equal(more.parts[0].log_weight, first.parts[0].log_weight)  # the first round is the same
    until.observe(slit.start[None], DT)
    later = until.plan(slit.start).estimate
    assert later.ess >= 10.0
    assert len(later.parts) < len(more.parts)


def test_a_cheap_class_that_no_sample_survives_does_not_keep_others_out_of_plans_without_time(slit, slit_tree):
    """Under this noise open-loop samples die in the slit, the cheapest class, which alone there is time for."""
    narrow = slit.with_settings(noise=0.4, samples=60, guide="open-loop")
    controller = narrow.controller(slit_tree)
    survived = list[bool]()
    for _ in range(20):
        plan = controller.plan(slit.start, lambda: 0.0)
        survived.append(plan.fallback is None)
        controller.observe(slit.start[None], DT)
    assert survived[0]
    assert all(one or other for one, other in pairwise(survived))
    assert sum(survived) >= 15


def test_without_a_reference_at_the_start_there_is_no_plan_and_later_the_robot_brakes(slit):
    """A tree that is the goal alone has a reference only where the goal is in sight."""
    short_sighted = slit.with_settings(samples=50).controller(slit.empty_tree())
    with pytest.raises(NoReference, match=r"from \(1, 3.4\)"):
        short_sighted.plan(HIDDEN)
    short_sighted.begin(slit.start)
    assert short_sighted.plan(slit.start).fallback is None
    short_sighted.observe(HIDDEN[None], 0.25)
    plan = short_sighted.plan(HIDDEN)
    assert (plan.fallback, plan.stops, plan.estimate, plan.references, plan.favourite) == (
        "no reference", True, None, (), None,
    )  # fmt: skip
    np.testing.assert_array_equal(plan.at(HIDDEN, 0.3), np.zeros(2))
    off = np.array([0.02, -0.01])
    assert np.all(plan.at(HIDDEN + off, 0.3) * off < 0.0)  # back to where it was
    np.testing.assert_array_equal(plan.control, plan.at(HIDDEN, 0.0))


def test_without_a_survivor_the_robot_brakes_and_goes_on_when_one_survives(slit, slit_tree: HomologyTree):
    """In the middle of the slit under much noise none of a few samples survives that holds its tape."""
    controller = slit.with_settings(samples=2, noise=6.0, guide="open-loop").controller(slit_tree)
    x = np.array([3.4, 2.5])
    controller.begin(x)
    plan = controller.plan(x)
    assert plan.fallback == "no survivor"
    assert plan.favourite == plan.ids[0] == "0,0"
    np.testing.assert_allclose(plan.control, [0.0, 0.0], atol=1e-9)
    controller.observe(np.array([[5.0, 2.5]]), 0.1)
    assert controller.plan(np.array([5.0, 2.5])).fallback is None  # close to the goal


@pytest.mark.parametrize(("standing", "later"), [(1.0, None), (0.0, "no survivor")])
def test_guides_of_a_robot_that_has_stood_for_lack_of_them_may_take_longer(standing: float, later: str | None):
    house = prepare("house", robot="jackal").with_settings(samples=20)
    controller = house.controller(house.grown_tree())
    tuning = controller.settings.tuning._replace(standing=standing)
    controller.settings = replace(controller.settings, tuning=tuning)
    guidance = controller.path_integral.proposals.nominal
    guidance.tuning = guidance.tuning._replace(part_short=1)  # as many passes as a long path gets
    controller.begin(house.start)

    def plan() -> str | None:
        """Plan with hardly any time left, of which every look at the clock takes 2 ms."""
        left = (0.001 - 0.002 * looks for looks in count())
        return controller.plan(house.start, left.__next__).fallback

    assert plan() == "no survivor"
    controller.observe(house.start[None], 0.1)
    assert plan() == "no survivor"
    controller.observe(house.start[None], TUNING.stuck)
    assert plan() == later


def budget(share: float = 1.0) -> TimeBudget:
    """A budget of 0.1 s of which a share is left."""
    times = iter([0.1])
    return TimeBudget(lambda: next(times, share * 0.1))


@pytest.mark.parametrize("classes", [1, 3, 16])
def test_after_a_plan_that_fits_just_so_there_is_time_for_as_many_classes_and_else_for_fewer(classes: int):
    assert budget(1.0 - 0.999 * TUNING.before_samples).most_classes(classes) == classes
    assert budget(1.0 - 1.3 * TUNING.before_samples).most_classes(classes) == max(1, int(classes / 1.3))
    assert budget(-10.0).most_classes(classes) == 1


@pytest.mark.parametrize(
    ("where", "said"), [((3.4, 1.5), "already in the goal"), ((-1.0, 1.5), "outside the workspace")]
)
def test_a_plan_where_no_control_leads_on_is_refused(where: tuple[float, float], said: str):
    scene = Scene.from_boxes([], lower=(0, 0), upper=(4, 3), start=(0.6, 1.5), goal=(3.4, 1.5, 0.3), robot_radius=0.2)
    problem = Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=np.eye(2))
    made = Controller(
        problem, FreeSpace.of(scene), None, Sampling(samples=10), method="passive", rng=np.random.default_rng(0)
    )
    with pytest.raises(OptionError, match=said):
        made.plan(np.array(where))
