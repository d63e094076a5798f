"""Steps of a noisy position have the covariance of their law: more samples are effective, and psi stays the same.

Statistical tests compare means over independent samples of a seed with exact values, in units of standard errors.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from batches import batch_of
from by_inputs import Driven
from corners import START, cheapest, controller, passive_noise
from guides import psi_around

from pirrht import Controller
from pirrht.proposals.guide import DDPGuide, LinearFeedback
from pirrht.systems.rover import Rover

SYSTEMS = {"rover": Rover, "own": lambda b: Driven(s=(b, 2.0 * b))}
PLACES = {"open": (0.0, 1.0, 0.5), "near": (0.45, -0.3, 0.5), "wall": (0.7, -0.3, 0.5)}


@cache
def system(name: str, b: float) -> Controller:
    return controller(SYSTEMS[name](b))


@pytest.mark.parametrize(("name", "times"), [("rover", 5.0), pytest.param("own", 2.0, marks=pytest.mark.slow)])
def test_around_corners_more_samples_are_effective_and_psi_is_the_same(name, times):
    """4000 samples of seed 7 with the covariance of the law, 4000 of seed 8 with that of the passive noise."""
    made = system(name, 0.03)
    guide = cheapest(made, START)
    (law, error, share), (passive, other, few) = (
        psi_around(made.path_integral, START, guide.times, [LinearFeedback(one)], 4000, seed)
        for one, seed in ((guide, 7), (passive_noise(guide), 8))
    )
    assert share > times * few
    assert 0.0 < error < 0.3
    assert abs(law - passive) < 3.0 * np.hypot(error, other)


@pytest.mark.parametrize("away", [0.02, 0.08, 0.15, 0.4])
def test_within_few_steps_of_the_goal_psi_is_the_same_and_nearly_all_samples_are_effective(away):
    """Seeds 7 and 8 of 2000 samples; steps that may enter the goal draw passive noise."""
    made = system("rover", 0.03)
    x = np.array([3.0 - 0.3 - away, -0.35, 0.1])
    guide = cheapest(made, x)
    (law, error, share), (passive, other, _) = (
        psi_around(made.path_integral, x, guide.times, [LinearFeedback(one)], 2000, seed)
        for one, seed in ((guide, 7), (passive_noise(guide), 8))
    )
    assert share > 0.9
    assert abs(law - passive) < 3.0 * np.hypot(error, other)


def some_steps(guide: DDPGuide, count: int, **change: np.ndarray) -> DDPGuide:
    """The first steps of a guide."""
    start = {name: getattr(guide, name)[:count] for name in ("modes", "gains", "share", "inverse", "volume")}
    ends = {name: getattr(guide, name)[: count + 1] for name in ("times", "states")}
    return replace(guide, length=count, **{**start, **ends, **change})


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", ["rover", pytest.param("own", marks=pytest.mark.slow)])
def test_likelihood_ratios_average_to_one_in_whole_and_in_split_steps(name, place):
    """E_Q[dQ_g / dQ] = 1 over four steps, for 20 000 samples of seed 3; next to the wall half of them end at it."""
    made, x = system(name, 0.3), np.array(PLACES[place])
    guide = cheapest(made, x)
    cut = some_steps(guide, 4, modes=0.6 * guide.modes[:4], gains=0.6 * guide.gains[:4])
    laws = {
        "passive": None, "cut": cut, "shifted": replace(cut, modes=cut.modes + 0.5),
        "steeper": replace(cut, gains=1.2 * cut.gains), "unshaped": passive_noise(cut),
    }  # fmt: skip
    names = list(laws)
    assert np.abs(cut.share[:, 0, 1]).max() > 0.005  # its modes are correlated
    for source, target in (("passive", "cut"), ("cut", "shifted"), ("cut", "steeper"), ("steeper", "cut")):
        counts = [20000 * (one == source) for one in names]
        batch = batch_of(
            made.path_integral, x, cut.times, np.zeros((len(names), 4, 2)), counts=counts, guides=list(laws.values())
        )
        ratio = made.path_integral.rollout(batch, 3).paths.log_ratio
        assert np.mean(ratio[:, names.index("cut")] != ratio[:, names.index("unshaped")]) > 0.1  # steps are shaped
        weight = np.exp(ratio[:, names.index(target)] - ratio[:, names.index(source)])
        error = weight.std() / np.sqrt(len(weight))
        assert 0.0 < error < 0.04
        assert abs(weight.mean() - 1.0) < 3.0 * error, (source, target)
