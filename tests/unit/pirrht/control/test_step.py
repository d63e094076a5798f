"""A loop of one's own is step(x, dt): it observes, plans and decides; a plan elsewhere without an observation warns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pirrht.errors import OptionError
from sim.scenario import Scenario

DT = 0.05


def test_steps_are_the_plans_of_a_loop_that_observes(slit: Scenario, slit_tree):
    one, other = (slit.with_settings(samples=50).controller(slit_tree) for _ in range(2))
    x = slit.start
    for k in range(3):
        u = one.step(x, DT)
        if k:
            other.observe(x[None], DT)
        np.testing.assert_array_equal(u, other.plan(x).control)
        x = x + DT * u
    assert one.run.time == pytest.approx(2 * DT)
    one.begin(slit.start)
    one.step(slit.start, DT)
    assert one.run.time == 0.0


def test_who_forgets_to_observe_is_warned(slit: Scenario):
    mppi = slit.with_settings(samples=50).mppi()
    mppi.plan(slit.start)
    mppi.plan(slit.start)  # the same question again
    with pytest.warns(RuntimeWarning, match=r"nothing was observed in between: call step\(x, dt\)"):
        mppi.plan(slit.start + 0.01)
    mppi.begin(slit.start + 0.02)
    mppi.plan(slit.start + 0.02)


def test_a_step_takes_time(slit: Scenario):
    with pytest.raises(OptionError, match="dt is 0"):
        slit.mppi().step(slit.start, 0.0)


def test_the_first_plan_of_a_drive_draws_until_enough_samples_are_effective(slit: Scenario, slit_tree):
    few = slit.with_settings(samples=4, noise=0.3)
    plain, until = (few.controller(slit_tree) for _ in range(2))
    plain.path_integral.sampling = replace(few.sampling, least=0.0)
    until.path_integral.sampling = replace(few.sampling, least=40.0)
    first = plain.plan(slit.start).estimate
    more = until.plan(slit.start).estimate
    assert first is not None
    assert more is not None
    assert first.ess < 40.0 <= more.ess
    np.testing.assert_array_equal(more.parts[0].log_weight, first.parts[0].log_weight)  # the first round is the same
    until.observe(slit.start[None], DT)
    later = until.plan(slit.start).estimate
    assert later is not None
    assert len(later.parts) == 1
