"""Laws fitted to samples: the regression is exact, effective samples rise around a corner, and psi stays the same."""

from functools import cache

import numpy as np

from pirrht import Controller, FreeSpace, HomologyTree, Problem, Sampling, Scene
from pirrht.proposals.fitted_law import LawFit, chosen, pooled
from pirrht.steering.dubins import Dubins
from pirrht.systems.unicycle import Unicycle

START = np.array([0.0, -0.35, 0.5])  # next to a box that the way to the goal bends around


def controller(threads: int | None = None) -> Controller:
    """A unicycle below the corner of a box."""
    scene = Scene.from_boxes(
        [[0.8, -1.0, 1.6, 0.0]], lower=(-1.0, -2.0), upper=(3.2, 1.6), start=(0.0, -0.35), goal=(2.4, -0.35, 0.3),
        robot_radius=0.2,
    )  # fmt: skip
    problem, space = Problem(dynamics=Unicycle(b=0.3), scene=scene, R=np.eye(1)), FreeSpace.of(scene)
    tree = HomologyTree(space, Dubins.of(problem), limit=0.8, rng=np.random.default_rng(0))
    tree.grow(200)
    made = Controller(problem, space, tree, Sampling(samples=300, threads=threads), rng=np.random.default_rng(1))
    made.begin(START)
    return made


@cache
def guide():
    """The guide of the likeliest class."""
    made = controller()
    made.plan(START)
    return next(iter(made.run.starts.optima.values()))[0]


def plenty(made: Controller):
    """What the next plan would have with twenty times the samples."""
    integral = made.path_integral
    assert made.tree is not None
    batch = made.batch(START, made.tree.references(START))
    return integral.estimate(integral.rollout(batch.counting([20 * n for n in batch.counts]), 5), classes=batch.named)


def paths(one, law: np.ndarray, count: int = 40) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Paths near the rows of a guide that apply a law (L, n+1, m) without noise."""
    L = len(law)
    off = 1e-3 * np.random.default_rng(2).standard_normal((count, L, one.dynamics.n))
    z = np.concatenate([np.ones((count, L, 1)), off], axis=2)
    states = np.concatenate([one.states[:L] + off, one.states[None, L : L + 1].repeat(count, axis=0)], axis=1)
    return states, np.einsum("clj,ljm->clm", z, law), np.full(count, L)


def test_a_law_that_paths_apply_is_found():
    one = guide()
    L, n, m = one.length, one.dynamics.n, one.dynamics.m
    change = np.random.default_rng(3).standard_normal((L, n + 1, m)) * [[1.0], [30.0], [30.0], [30.0]]
    own = np.concatenate([one.modes[:L, None, :m], np.swapaxes(one.gains[:L, :m], 1, 2)], axis=1)
    fit = LawFit.of(one, tuning=LawFit.of(one).tuning._replace(fit_rows=0, fit_prior=1e-6))
    fit.learn(paths(one, own + change), np.ones((40, 2)), one, timed=True)
    modes, gains = fit.followed.modes - one.modes, fit.followed.gains - one.gains
    np.testing.assert_allclose(modes[: L - 1, :m], change[: L - 1, 0], rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(np.swapaxes(gains, 1, 2)[: L - 1, :, :m], change[: L - 1, 1:], rtol=1e-3, atol=0.1)


def test_the_law_that_is_followed_is_that_of_all_that_was_learned():
    one = guide()
    fit, ones = LawFit.of(one), np.ones((one.length, one.dynamics.n + 1, one.dynamics.m))
    np.testing.assert_array_equal(fit.followed.modes, one.modes)
    fit.learn(paths(one, ones), np.ones((40, 2)), one, timed=True)
    assert not np.array_equal(fit.followed.modes, one.modes)


def test_what_is_known_stays_where_it_was_found_and_fades():
    one = guide()
    fit = LawFit.of(one)
    fit.learn(paths(one, np.ones((one.length, one.dynamics.n + 1, one.dynamics.m))), np.ones((40, 2)), one, timed=True)
    carried = fit.carried(one, 0.0, timed=False)
    np.testing.assert_allclose(carried.products, fit.products)
    np.testing.assert_allclose(carried.sums, fit.sums)
    known, step = fit.products[:, 0, 0].copy(), float(one.times[1])
    soon = fit.carried(one, 0.5 * step, timed=True)
    np.testing.assert_allclose(fit.carried(one, step, timed=True).products[:-1, 0, 0], known[1:])
    np.testing.assert_allclose(soon.products[1:-1, 0, 0], 0.5 * (known[1:-1] + known[2:]))
    fit.fade()
    np.testing.assert_allclose(fit.products[:, 0, 0], fit.tuning.fit_memory * known)


def test_equal_weights_change_nothing_and_every_sample_is_chosen_in_proportion():
    found, counts = chosen(np.zeros(50), np.zeros(50), 50)
    assert found.tolist() == list(range(50))
    np.testing.assert_allclose(counts, 1.0)
    few, counts = chosen(np.zeros(50), np.zeros(50), 10)
    assert len(few) == 10
    np.testing.assert_allclose(counts.sum(axis=0), 50.0)


def test_neighbouring_rows_share():
    np.testing.assert_allclose(pooled(np.array([0.0, 0.0, 3.0, 0.0, 0.0]), 2), [1.0, 2.0, 3.0, 2.0, 1.0])


def test_effective_samples_multiply_around_a_corner_and_psi_stays_the_same():
    made = controller()
    before = plenty(made)
    for _ in range(20):
        made.plan(START)
    after = plenty(made)
    assert after.ess > 3.0 * before.ess
    assert abs(after.value - before.value) < 3.0 * np.hypot(after.value_error, before.value_error)


def test_plans_do_not_depend_on_the_number_of_threads():
    one, two = controller(threads=1), controller(threads=2)
    for _ in range(3):
        np.testing.assert_array_equal(one.plan(START).control, two.plan(START).control)
    assert one.run.starts.fits
