"""Backends make the same of a batch: compiled kernels and plain Python, for tubes, laws, moving obstacles, rectangles.

Batches are those that a plan hands to its backend, with fewer samples. Both draw the same random numbers, and with
uniform steps nearly all paths are equal. Statistical tests state seeds, and compare in units of standard errors.
"""

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from batches import led
from discs import disc, scene_of
from moving import SCENES, walled
from spaces import guarded, window

from pirrht import (
    Controller,
    Dubins,
    Footprint,
    FreeSpace,
    HomologyTree,
    Outcome,
    Problem,
    Sampling,
    SingleIntegrator,
    StraightLine,
    Unicycle,
    path_integral,
)
from pirrht.estimation.estimate import Rollouts
from pirrht.estimation.weights import log_weights
from pirrht.jit.records import Held, without_addresses
from pirrht.proposals.proposal import Tape
from pirrht.rollouts.backend import Backend
from pirrht.rollouts.plain import Plain
from pirrht.rollouts.tables import LawRows, Paths, ProposalTables
from pirrht.steering.in_time import InTime
from pirrht.steering.pieces import SpaceLine, TrackedInSpace
from pirrht.steering.straight_line import Tracked
from pirrht.systems.ball import Ball
from pirrht.systems.drone import Drone
from pirrht.systems.rover import Rover

ENDS = {"start": (0.0, 0.0), "goal": (4.0, -0.6, 0.3), "lower": (-1.0, -3.0), "side": (6.0, 3.0), "radius": 0.15}
POST = scene_of([disc("post", 2.2, -0.2, 0.4)], **ENDS)
CART = replace(POST, footprint=Footprint.rectangle(0.4, 0.2))
CROSSING = replace(SCENES["crossing"](), footprint=Footprint.rectangle(0.6, 0.3))
POINT, CAR, ROVER = SingleIntegrator(b=0.2), Unicycle(b=0.3), Rover(b=0.1)
CASES = {
    "tube": (POST, POINT, StraightLine.of), "law of a car": (POST, CAR, Dubins.of),
    "law of a rover": (POST, ROVER, lambda problem: Tracked.of(problem, 1.0)),
    "rectangle of a car": (CART, CAR, Dubins.of),
    "rectangle of a rover": (CART, ROVER, lambda problem: Tracked.of(problem, 1.0)),
    "point among moving": (SCENES["crossing"](), POINT, InTime.of),
    "rover among moving": (SCENES["crossing"](), ROVER, InTime.of),
    "rectangle of a car among moving": (CROSSING, CAR, InTime.of),
    "rectangle of a rover among moving": (CROSSING, ROVER, InTime.of),
    "ball in space": (window(), Ball(b=0.2), SpaceLine.of),
    "drone in space": (window(), Drone(b=0.2), lambda problem: TrackedInSpace.of(problem, 1.0)),
    "ball among bodies in space": (guarded(), Ball(b=0.2), InTime.of),
    "drone among bodies in space": (guarded(), Drone(b=0.2), lambda problem: InTime.of(problem, pace=1.0)),
}  # fmt: skip
# Those that take long to compile.
RARE = (
    "rectangle of a car",
    "rectangle of a rover",
    "ball in space",
    "drone in space",
    *[name for name in CASES if "r among moving" in name or "among bodies" in name],
)
EVERY = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in RARE else []) for name in CASES]
)
BOTH = pytest.mark.parametrize("plain", [False, True], ids=["compiled", "plain"])


class Drawn(NamedTuple):
    problem: Problem
    rollouts: Rollouts
    backends: tuple[Backend, Backend]  # compiled, plain

    def with_samples(self, count: int) -> ProposalTables:
        return self.rollouts.tables._replace(first=count * np.arange(len(self.rollouts.tables.first)))


@cache
def drawn(name: str) -> Drawn:
    """What the second plan of a controller hands to its backend."""
    scene, dynamics, steering = CASES[name]
    R = {CAR: np.eye(1), ROVER: np.diag([2.0, 0.5])}.get(dynamics, 2.0 * np.eye(dynamics.m))
    problem, space = Problem(dynamics=dynamics, scene=scene, R=R), FreeSpace.of(scene)
    limit = 0.8 if scene.dimension == 2 else 1.0
    tree = HomologyTree(space, steering(problem), limit=limit, rng=np.random.default_rng(0))
    tree.grow(200)
    steps = "uniform" if dynamics.noisy_position else "fitted"  # others are never split
    sampling = Sampling(samples=20, steps=steps, threads=1)
    controller = Controller(problem, space, tree, sampling, rng=np.random.default_rng(1))
    x = dynamics.state_of(scene.start)
    controller.plan(x)
    return Drawn(problem, controller.plan(x).estimate.rollouts, (controller.path_integral.backend, Plain(problem)))


@EVERY
def test_plain_python_draws_the_paths_of_compiled_kernels(name):
    """5 samples around every proposal; rounding may flip an exit, or choose another row of a law."""
    problem, rollouts, backends = one = drawn(name)
    tables = one.with_samples(5)
    S = int(tables.first[-1])
    paths = [backend.sample(rollouts.setup, tables, rollouts.origin) for backend in backends]
    again = [backend.replay(rollouts.setup, tables, rollouts.origin, np.arange(S)[::-1]) for backend in backends]
    for sampled, (_, _, steps) in zip(paths, again, strict=True):
        np.testing.assert_array_equal(sampled.steps, steps[::-1])
    compiled, plain = paths
    same = compiled.steps == plain.steps
    assert np.mean(~same) < 0.02
    assert np.any(compiled.outcome == Outcome.GOAL)
    for field in Paths._fields:
        if field != "log_ratio":  # of proposals that count for nothing kernels leave it out
            apart = ~np.isclose(getattr(compiled, field), getattr(plain, field), rtol=1e-3, atol=1e-3)[same]
            assert apart.reshape(len(apart), -1).any(axis=1).mean() < 0.02, field
    before = np.arange(len(tables.times) - 1) < compiled.steps[::-1, None] - 1
    for k, width in ((0, 1), (1, 0)):  # states and controls before the step in which a path leaves
        kept = [found[k][:, width:][before & same[::-1, None]] for found in again]
        np.testing.assert_allclose(*kept, rtol=1e-3, atol=2e-3)
    weights = [log_weights(problem, "balance", each, tables.first) for each in paths]
    psi = [np.exp(each - weights[0].max()) for each in weights]
    assert psi[1].mean() == pytest.approx(psi[0].mean(), rel=0.02)


def pair(one: Drawn, count: int, steps: int = 4) -> ProposalTables:
    """Some steps around the first proposal, and around what adds a control to it and has other noise."""
    tables, rows = one.rollouts.tables, np.zeros(2, dtype=int)
    ways = tables.ways
    cut = {name: getattr(tables, name)[rows, :steps].copy() for name in ("control", "drift")}
    made = tables._replace(
        **cut, times=tables.times[: steps + 1], active=np.array([0, steps]), first=count * np.arange(3), window=1,
        law=tables.law[rows].copy(), law_length=tables.law_length[rows],
        ways=ways._replace(count=ways.count[rows], place=ways.place[rows], slope=ways.slope[rows]),
    )  # fmt: skip
    d = one.problem.dynamics
    made.control[1] = 0.4 * d.input_of(one.rollouts.origin.x, np.ones(d.m))
    if ways.count[0] > 0:
        made.ways.count[1] = 0
        made.control[1] += one.rollouts.paths.start_control[0]
    made.drift[:] = made.control @ one.rollouts.setup.gain.T
    if made.law_length[0] > 0:
        modes = d.m if d.noisy_position else 2 * d.m
        law = LawRows.of(made, 1, d.n, modes)
        law.deviation[:] *= 1.1
        law.inverse[:] /= 1.1
        law.log_det[:] += modes * np.log(1.1)
    return made


@BOTH
@EVERY
def test_likelihood_ratios_average_to_one(name, plain):
    """E_Q[dQ_g / dQ] = 1 over four steps, for 20 000 samples of compiled kernels and 400 of plain Python, seed 3."""
    one, count = drawn(name), 400 if plain else 20_000
    origin = one.rollouts.origin._replace(seed=np.uint64(3))
    ratio = one.backends[plain].sample(one.rollouts.setup, pair(one, count), origin).log_ratio
    for h, g in ((0, 1), (1, 0)):
        weight = np.exp(ratio[h * count : (h + 1) * count] @ (np.eye(2)[g] - np.eye(2)[h]))
        error = weight.std() / np.sqrt(count)
        assert 0.0 < error < (0.06 if plain else 0.01)
        assert abs(weight.mean() - 1.0) < 3.5 * error, (h, g)


@BOTH
def test_before_a_wall_at_constant_speed_psi_is_the_closed_form(plain):
    """psi = exp(-k z) at z before a wall on which it is 1; 8000 and 300 samples of seed 3, within 3 errors."""
    scene, rate_of = walled(0.4)
    problem = Problem(dynamics=SingleIntegrator(b=0.3), scene=scene, R=2.0 * np.eye(2), phi=0.0)
    integral = path_integral(
        problem, FreeSpace.of(scene), Sampling(threads=1), backend=Plain(problem) if plain else None
    )
    times, z = integral.steps(1.5), 0.15
    tape = Tape(times, np.tile((-0.4, 0.1), (len(times) - 1, 1)))
    found = integral.estimate(
        led(integral, np.array([2.8 + z, 1.5]), times, tape, count=300 if plain else 8000, seed=3, time=0.4)
    )
    rate = rate_of(0.3, integral.temperature)
    assert 0.0 < found.value_error / integral.temperature < 0.1
    assert abs(-found.log_psi - rate * z) < 3.0 * found.value_error / integral.temperature + 0.005


def leaves(plain: Any) -> list[Any]:
    return [leaf for one in plain.values() for leaf in leaves(one)] if isinstance(plain, dict) else [plain]


def copied(record: Any) -> Any:
    """Make a record again of copies of its arrays, at other addresses."""
    if isinstance(record, Held):
        return type(record).holding(*map(copied, record.contents.values()))
    if hasattr(record, "_fields"):
        return type(record)(*map(copied, record))
    return record.copy() if isinstance(record, np.ndarray) else record


@EVERY
def test_without_addresses_a_device_has_all_that_paths_depend_on(name):
    one = drawn(name)
    setup, tables = one.rollouts.setup, one.with_samples(5)
    given = leaves(without_addresses(setup)) + leaves(without_addresses(tables))
    held = {leaf.ctypes.data for leaf in given if isinstance(leaf, np.ndarray)}
    assert not held & {leaf for leaf in given if isinstance(leaf, int)}
    program = "PlanarTable" if one.problem.scene.dimension == 2 else "Links"
    assert without_addresses(tables)["classes"]["program"] == program
    again = copied(setup), copied(tables), one.rollouts.origin
    for field in Paths._fields:
        found = [getattr(one.backends[0].sample(*batch), field) for batch in ((setup, tables, again[2]), again)]
        np.testing.assert_array_equal(*found, err_msg=field)
