"""Why, in words: what classes cost and how many of their samples die and where."""

from dataclasses import replace

import numpy as np
import pytest
from drives import Drive

from sim.mjcf.names import called
from sim.recording.reasons import BORDER, Reason, fate, known, page, reasons, sentence, share, touched, words_of

WALLS = ("upper wall", "lower wall")


def explained(drive, plan):
    found = reasons(plan, drive.controller.path_integral, WALLS, words_of(plan, drive.controller.path_integral, WALLS))
    return {reason.name: reason for reason in found}


@pytest.fixture(scope="module")
def planned():
    drive = Drive()
    start = drive.scene.start[:2]
    drive.controller.begin(start)
    plan = drive.controller.plan(start)
    return drive, plan, explained(drive, plan)


def test_a_reason_has_the_cost_the_weight_and_the_value_of_its_class(planned):
    drive, plan, found = planned
    estimate, temperature = plan.estimate, drive.controller.path_integral.temperature
    assert list(found) == list(plan.ids)
    for reference, name in zip(plan.references, plan.ids, strict=True):
        assert found[name].cost == reference.cost
        assert found[name].weight == estimate.class_weights[name]
    together = -temperature * np.log(np.exp(-np.array([r.value for r in found.values()]) / temperature).sum())
    other = estimate.class_weights["other"]
    assert together == pytest.approx(estimate.value - temperature * np.log1p(-other), abs=1e-9)


def test_the_error_of_a_class_is_what_repeated_estimates_scatter_by():
    values, errors, weights, weight_errors, drive = [], [], [], [], Drive()
    start = drive.scene.start[:2]
    drive.controller.begin(start)
    for _ in range(40):
        one = explained(drive, drive.controller.plan(start))["0,1"]
        values.append(one.value)
        errors.append(one.error)
        weights.append(one.weight)
        weight_errors.append(one.weight_error)
    assert np.std(values) == pytest.approx(np.mean(errors), rel=0.5)
    assert np.std(weights) == pytest.approx(np.mean(weight_errors), rel=0.5)


def test_what_samples_hit_is_the_wall_beside_their_way(planned):
    _, _, found = planned
    assert found["0,1"].where in ("", "lower wall", BORDER)
    assert found["-1,0"].where in ("", "upper wall", BORDER)
    assert found["0,0"].dying > max(found["0,1"].dying, found["-1,0"].dying)  # it is narrow in there


def test_a_robot_touches_the_nearest_solid_or_the_border():
    drive = Drive()
    points = np.array([(3.0, 2.95), (3.0, 2.06), (3.0, 4.99), (0.01, 1.0)])
    assert touched(drive.space, WALLS, (), points, np.zeros(4)) == ["upper wall", "lower wall", BORDER, BORDER]


def test_names_that_are_missing_or_of_several_obstacles_give_way_to_the_number_on_the_map():
    assert called(["table", "", "post", "post", ""], {0: 1, 1: 2, 2: 3, 3: 4}) == [
        "table", "obstacle 2", "obstacle 3", "obstacle 4", "a wall",
    ]  # fmt: skip
    assert called(["front_desk", "front_desk", "post"], {0: 1, 1: 1, 2: 2}) == ["front_desk", "front_desk", "post"]


def reason(name, way, cost, weight, dying=0.0, late=0.0, where="", samples=90.0):
    return Reason(
        name=name, way=way, cost=cost, value=cost, error=0.1, weight=weight, weight_error=0.01 if samples else None,
        samples=samples, dying=dying, late=late, where=where,
    )  # fmt: skip


THROUGH = reason("0,0", "between upper and lower", 8.4, 0.02, dying=0.96, where="lower")
AROUND = reason("-1,0", "left of upper", 9.1, 0.98)


def test_the_sentence_is_the_one_a_person_would_say():
    assert sentence([THROUGH, AROUND], "-1,0") == (
        "Between upper and lower: shortest, 96 of 100 samples hit lower; "
        "left of upper: 0.7 more, all arrive. Most weight: class -1,0, 98 % ± 1 %."
    )


@pytest.mark.parametrize(
    ("weight", "samples", "said"),
    [
        (0.75, 90.0, "75 % ± 1 %"),
        (0.75, 1.1, "75 % by one sample"),
        (0.0, 0.0, "no sample"),
    ],
)
def test_a_weight_has_its_error_or_says_that_hardly_a_sample_arrives(planned, weight, samples, said):
    found = reason("0,1", "right of lower", 9.0, weight, dying=0.9999, where="lower", samples=samples)
    assert known(found) == said
    text = page(planned[1], [found], 0.0)
    assert f"| 0,1 | {said} |" in text
    assert f"nearly all samples hit lower. Most weight: class 0,1, {said}." in text
    assert "| over 99 % |" in text
    assert ("± 0.10 |" in text) == (samples > 10.0)
    law = page(planned[1], [replace(found, pooled=0.75)], 0.0)
    assert f"Most weight: class 0,1, 75 % by recent plans, {said} in this one." in law
    assert f"| 0,1 | {said} | 75 % |" in law


@pytest.mark.parametrize(
    ("dying", "late", "said"),
    [
        (0.0, 0.0, "all arrive"),
        (0.004, 0.0, "nearly all arrive"),
        (0.996, 0.0, "nearly all samples hit a wall"),
        (1.0, 0.0, "100 of 100 samples hit a wall"),
        (0.1, 0.2, "10 of 100 samples hit a wall and 20"),
    ],
)
def test_what_becomes_of_samples_adds_up(dying, late, said):
    assert fate(reason("0", "w", 1.0, 1.0, dying, late)).startswith(said)


@pytest.mark.parametrize(
    ("weight", "said"), [(1.0, "100 %"), (0.9999, "over 99 %"), (0.994, "99 %"), (0.001, "under 1 %"), (0.0, "0 %")]
)
def test_a_share_is_rounded_to_nothing_else_than_it_is(weight, said):
    assert share(weight) == said


def test_the_page_tells_of_a_fallback_and_of_too_few_samples(planned):
    _, plan, found = planned
    lost = replace(plan, estimate=None, fallback="no survivor", instead=plan.tape)
    assert page(lost, [], 1.25).startswith("**At 1.25 s: blocked, no sample survived; braking.**")
    mppi = replace(lost, law=None)
    assert page(mppi, [], 1.25).startswith("**At 1.25 s: blocked, no sample survived; the last controls go on.**")
    weak = replace(plan, estimate=replace(plan.estimate, ess=3.0))
    assert "Only 3.0 effective samples: a guess" in page(weak, list(found.values()), 0.0)
    assert "Exact value 8.50" in page(replace(lost, fallback=None, exact=8.5), [], 0.0)


@pytest.mark.parametrize(
    ("error", "said"), [(0.04, "4 %"), (0.004, "0.4 %"), (0.0004, "under 0.1 %"), (1e-16, "under 0.1 %")]
)
def test_an_error_too_small_to_matter_is_a_bound(error, said):
    found = reason("0,1", "right of lower", 9.0, 0.75, dying=0.0, where="", samples=90.0)
    assert known(replace(found, weight_error=error)) == f"75 % ± {said}"
