"""Symmetries of estimates, which problems are linearly solvable, traps of the paper, steps, pairs, backends."""

from dataclasses import replace

import numpy as np
import pytest
from batches import batch_of, led, still
from closed_forms import at_strip, in_strip
from discs import scene_of

from pirrht import (
    FreeSpace,
    NoSurvivingSample,
    OptionError,
    Outcome,
    PathIntegral,
    Problem,
    Sampling,
    SingleIntegrator,
    path_integral,
)
from pirrht.arrays import Array, IntArray
from pirrht.rollouts.tables import Chosen, Origin, Paths, ProposalTables, Setup, empty_paths


@pytest.mark.parametrize("guide", ["feedback", "open-loop"])
def test_a_reference_may_be_split_into_two_of_half_the_samples(guide):
    integral = in_strip(dt=0.05, samples=600, guide=guide)
    whole = at_strip(integral, 0.2, (1, -1), 3, counts=[600, 600])
    split = at_strip(integral, 0.2, (1, 1, -1), 3, counts=[200, 400, 600])
    np.testing.assert_allclose(split.rollouts.log_weight, whole.rollouts.log_weight, atol=1e-9)
    np.testing.assert_allclose(split.control, whole.control, atol=1e-9)


def test_without_the_likelihood_ratio_only_what_controls_cost_is_left_out():
    """With passive samples "biased" is what "balance" says; with samples that are driven, v lacks half of its cost."""
    said = {}
    for weights in ("balance", "biased"):
        for sides in ((), (1,)):
            integral = in_strip(dt=0.05, samples=4000, guide="open-loop", weights=weights)
            said[weights, sides] = at_strip(integral, 0.2, sides, 3).value
    assert said["biased", ()] == said["balance", ()]
    assert said["biased", (1,)] < 0.9 * said["balance", (1,)]


def test_a_rate_given_as_a_function_needs_its_least_value(slit):
    with pytest.raises(OptionError, match="q_min"):
        Problem(dynamics=SingleIntegrator(), scene=slit.problem.scene, R=np.eye(2), q=lambda x, p: 1.0)


@pytest.mark.parametrize("dt", [0.1, 0.01])
def test_the_first_increment_has_the_variance_of_its_step(dt):
    """Trap 1: it is sqrt(dt) Z_0, so the control carried is b Z_0 / sqrt(dt); 20000 samples, errors of 0.5 %."""
    paths = at_strip(in_strip(dt=dt, samples=20000, guide="open-loop"), 0.0, (), 0).rollouts.paths
    inside = paths.span == dt  # samples that leave in this step carry no noise from there on
    assert np.mean(inside) > 0.9
    now = paths.now[inside] / dt
    np.testing.assert_allclose(now.std(axis=0), 0.5 / np.sqrt(dt), rtol=0.02)
    np.testing.assert_allclose(now.mean(axis=0), 0.0, atol=4.0 * 0.5 / np.sqrt(dt * 20000))


@pytest.mark.parametrize("exit_rule", ["bridge", "endpoint"])
def test_the_tape_is_the_weighted_mean_of_what_samples_carried_before_their_exit(exit_rule):
    """Trap 7. With exit at step ends a path is the sum of what it carried, so its states are the oracle."""
    integral = in_strip(dt=0.1, samples=200, exit=exit_rule)
    estimate = at_strip(integral, 0.2, (1,), 5)
    rollouts = estimate.rollouts
    tape, alive = integral.replay.tape(estimate.parts)
    last = int(rollouts.paths.steps[estimate.weight > 1e-6].max())
    assert 1 < last < len(tape)
    assert np.all(tape[last:] == 0.0)
    assert np.all(alive[last:] == 0.0)
    assert np.all(tape[:last].any(axis=1))
    if exit_rule == "endpoint":
        states, steps = integral.replay.trace(rollouts, np.arange(rollouts.size))
        np.testing.assert_array_equal(steps, rollouts.paths.steps)
        under_way = np.arange(len(tape)) < steps[:, None]
        carried = under_way[..., None] * np.diff(states, axis=1) / 0.1
        np.testing.assert_allclose(tape, np.einsum("s,sti->ti", estimate.weight, carried), atol=1e-4)
        np.testing.assert_allclose(alive, estimate.weight @ under_way, atol=1e-4)


@pytest.mark.parametrize(
    ("speed", "T", "collisions", "timeouts"), [(0.0, 3, 0, 100), (20.0, 30, 100, 0)], ids=["stands", "rams"]
)
def test_no_surviving_sample_counts_how_they_ended(slit, speed, T, collisions, timeouts):
    integral = of(slit, samples=100)
    batch = batch_of(integral, slit.start, np.arange(T + 1) * 0.1, np.tile([0.0, speed], (1, T, 1)))
    with pytest.raises(NoSurvivingSample, match=f"{collisions} collided") as caught:
        integral.estimate(integral.rollout(batch, 0))
    assert (caught.value.collisions, caught.value.timeouts) == (collisions, timeouts)


def test_sampling_refuses_by_name():
    for wrong in (
        {"dt": 0.0}, {"dt": np.nan}, {"first": -1.0}, {"samples": 0}, {"exit": "no"}, {"weights": "no"},
        {"guide": "no"}, {"allocation": "no"}, {"target": 0.0}, {"budget": 100},
    ):  # fmt: skip
        with pytest.raises(OptionError, match=next(iter(wrong))):
            Sampling(**wrong)


def of(slit, **changes: object) -> PathIntegral:
    return path_integral(slit.problem, slit.space, replace(slit.sampling, **changes))


@pytest.mark.parametrize("steps", ["fitted", "uniform"])
def test_the_first_step_is_cut_finer_only_where_exits_are_judged_along_steps(slit, steps):
    cut = {"dt": 0.1, "first": 0.01, "steps": steps}
    np.testing.assert_allclose(of(slit, **cut).steps(0.5), [*(0.01 * np.arange(10)), 0.1, 0.2, 0.3, 0.4, 0.5])
    np.testing.assert_allclose(of(slit, **cut, exit="endpoint").steps(0.5), 0.1 * np.arange(6))


@pytest.mark.parametrize(("exit_rule", "alike"), [("endpoint", True), ("bridge", False)])
def test_with_exit_at_step_ends_fitted_steps_are_uniform_ones_and_along_steps_they_are_not(slit, exit_rule, alike):
    """Passive samples beside a wall, on the grids that a sampler makes itself."""
    noisy, outcomes = slit.with_settings(noise=0.3), []
    for steps in ("fitted", "uniform"):
        integral = of(noisy, guide="open-loop", steps=steps, exit=exit_rule)
        x, times = np.array([2.3, 2.63]), integral.steps(1.0)
        rollouts = led(integral, x, times, still(times), count=integral.sampling.samples, seed=3)
        outcomes.append(rollouts.paths.outcome)
    assert np.array_equal(*outcomes) == alike


PLANS = 60


def test_a_pair_starts_with_opposite_steps_and_what_is_left_over_stands_alone(slit):
    source = of(slit, guide="open-loop")
    batch = batch_of(source, slit.start, np.arange(61) * 0.1, np.zeros((2, 60, 2)), counts=[3, 4])
    states, _ = source.replay.trace(source.rollout(batch, 3), np.arange(7))
    steps = states[:, 1] - slit.start
    for a, b in ((0, 1), (3, 4), (5, 6)):  # the third sample has no partner
        np.testing.assert_allclose(steps[a], -steps[b], atol=1e-15)
    assert not np.allclose(np.abs(steps[2]), np.abs(steps[0]))


def test_pairs_leave_the_mean_of_psi_where_it_is_and_scatter_the_control_less(slit, slit_tree):
    """One meter before the goal; means over 60 plans, the difference of psi within 3 standard errors.

    The ratio of two scatters, 0.17, has a relative standard error of 9 % (two components each).
    """
    x, corners = slit.space.scene.goal.center - np.array([1.0, 0.0]), [slit.space.scene.goal.center[None, :]]
    times = of(slit).grid(1.0)
    psi, control = [], []
    for draws in ("antithetic", "independent"):
        source = of(slit, draws=draws, samples=200)
        batch = batch_of(source, x, times, np.zeros((1, len(times) - 1, 2)), corners=corners)
        found = [source.estimate(source.rollout(batch, seed)) for seed in range(PLANS)]
        psi.append([e.log_psi for e in found])
        control.append([e.control for e in found])
    pairs, alone = np.exp(np.array(psi) - np.max(psi))
    assert abs(pairs.mean() - alone.mean()) < 3.0 * np.sqrt((pairs.var(ddof=1) + alone.var(ddof=1)) / PLANS)
    paired, independent = np.std(control, axis=1).mean(axis=-1)
    assert paired < 0.5 * independent


class Euler:
    """Backend in NumPy: dx = u dt + B dw in an empty room, exits judged at the ends of steps (paper, III-A)."""

    def sample(self, setup: Setup, tables: ProposalTables, origin: Origin) -> Paths:
        """Simulate all S samples."""
        own, _, y, taken, outcome = self._simulated(setup, tables, origin)
        (S, T, m), dt = y.shape, np.diff(tables.times)
        paths, early = empty_paths(S, len(tables.control), m), np.arange(T) < tables.window
        paths.outcome[:], paths.steps[:], paths.work[:] = outcome, taken, setup.rate * tables.times[taken]
        under_way = np.arange(T) < taken[:, None]
        for g, a in enumerate(tables.drift):
            step = np.einsum("stm,tm->st", y, a) - 0.5 * dt * (a**2).sum(axis=1)
            paths.log_ratio[:, g] = (under_way * step).sum(axis=1)
        paths.start_control[:] = tables.drift[own, 0] @ setup.inverse.T
        counted = (under_way & early)[..., None]
        paths.span[:] = (counted[..., 0] * dt).sum(axis=1)
        noise = (counted * (y - tables.drift[own] * dt[:, None])).sum(axis=1)
        paths.now[:] = noise @ setup.inverse.T + paths.span[:, None] * paths.start_control
        return paths

    def trace(self, setup: Setup, tables: ProposalTables, origin: Origin, number: IntArray) -> tuple[Array, IntArray]:
        """Return states (c, T+1, n) and steps taken (c,)."""
        _, states, _, taken, _ = self._simulated(setup, tables, origin)
        return states[number], taken[number]

    def controls(
        self, setup: Setup, tables: ProposalTables, origin: Origin, chosen: Chosen, groups: int
    ) -> tuple[Array, Array]:
        """Return weighted controls (groups, T, m) and the weight under way (groups, T)."""
        _, _, y, taken, _ = self._simulated(setup, tables, origin)
        T, m = y.shape[1:]
        total, alive = np.zeros((groups, T, m)), np.zeros((groups, T))
        under_way = (np.arange(T) < taken[chosen.number][:, None]) * chosen.weight[:, None]
        np.add.at(alive, chosen.group, under_way)
        controls = y[chosen.number] @ setup.inverse.T / np.diff(tables.times)[:, None]
        np.add.at(total, chosen.group, under_way[..., None] * controls)
        return total, alive

    def _simulated(self, setup: Setup, tables: ProposalTables, origin: Origin):  # type: ignore[no-untyped-def]
        """Return references (S,), states (S, T+1, m), increments y = a dt + dw (S, T, m), steps (S,), outcomes (S,)."""
        S, dt, (_, T, m) = int(tables.first[-1]), np.diff(tables.times), tables.control.shape
        own = np.searchsorted(tables.first, np.arange(S), side="right") - 1
        noise = np.random.default_rng(int(origin.seed)).normal(size=(S, T, m)) * np.sqrt(dt)[:, None]
        y = tables.drift[own] * dt[:, None] + noise
        states = origin.x + np.concatenate([np.zeros((S, 1, m)), np.cumsum(y @ setup.diffusion.T, axis=1)], axis=1)
        px, py = states[:, 1:, 0], states[:, 1:, 1]
        room, (gx, gy) = setup.world.static, setup.world.goal
        hit = (px <= room.left) | (px >= room.right) | (py <= room.low) | (py >= room.high)
        arrived = ~hit & (np.hypot(px - gx, py - gy) <= setup.world.radius)
        ended = hit | arrived
        last = np.where(ended.any(axis=1), np.argmax(ended, axis=1), T - 1)
        outcome = np.select(
            [hit[np.arange(S), last], arrived[np.arange(S), last]], [Outcome.COLLISION, Outcome.GOAL], Outcome.TIMEOUT
        )
        return own, states, y, last + 1, outcome


PLACE, SAMPLES = np.array([1.6, 1.0]), 20_000
PAPER = {"exit": "endpoint", "steps": "uniform", "guide": "open-loop", "draws": "independent", "threads": 1}


def estimated(weights: str, backend: Euler | None, seed: int):
    """Estimate around two control sequences in a room whose walls end many paths; its open-loop control too."""
    scene = scene_of(start=PLACE, goal=(2.8, 1.0, 0.4), side=(4.0, 2.0), radius=0.2)
    problem = Problem(dynamics=SingleIntegrator(b=0.4), scene=scene, R=2.0 * np.eye(2), phi=4.0)
    sampling = Sampling(**PAPER, weights=weights)
    integral = path_integral(problem, FreeSpace.of(scene), sampling, backend=backend)
    times = integral.steps(3.0)
    tapes = np.array([np.tile(u, (len(times) - 1, 1)) for u in ((1.0, 0.0), (0.5, 0.3))])
    rollouts = integral.rollout(batch_of(integral, PLACE, times, tapes, counts=[SAMPLES // 4, 3 * SAMPLES // 4]), seed)
    estimate = integral.estimate(rollouts)
    states, steps = integral.replay.trace(rollouts, np.arange(3))
    assert states.shape == (3, len(times), 2)
    assert np.array_equal(steps, rollouts.paths.steps[:3])
    tape, alive = integral.replay.tape(estimate.parts)
    np.testing.assert_allclose(tape[0], estimate.control, atol=1e-3)
    assert alive[0] == pytest.approx(1.0, abs=1e-3)
    return estimate, tape[:5]


@pytest.mark.parametrize("weights", ["balance", "average"])
def test_compiled_rollouts_estimate_what_euler_steps_in_numpy_do(weights):
    """v and u within 4 standard errors of their difference; 20 000 samples each, seeds 1 and 2."""
    (one, early), (other, late) = estimated(weights, None, 1), estimated(weights, Euler(), 2)
    assert abs(one.value - other.value) < 4.0 * np.hypot(one.value_error, other.value_error)
    assert np.all(np.abs(one.control - other.control) < 4.0 * np.hypot(one.control_error, other.control_error))
    np.testing.assert_allclose(early, late, atol=0.15)
    assert one.survivors / SAMPLES == pytest.approx(other.survivors / SAMPLES, abs=0.03)
