"""psi of a rectangle that turns against plain simulation, and samples against psi."""

import numpy as np

from pirrht import (
    Controller,
    Desirability,
    Dubins,
    Footprint,
    FreeSpace,
    Problem,
    Sampling,
    Scene,
    Unicycle,
    grown_tree,
)
from pirrht.geometry.polygon import clearances

V, B = 1.0, 0.8
RECTANGLE = Footprint.rectangle(0.6, 0.2)
STATES = [(0.9, 1.05, 0.1), (1.0, 1.0, 0.3)]


def gap() -> tuple[Problem, FreeSpace]:
    """A wall with a gap 0.4 m wide, which the rectangle fits through lengthwise."""
    room = {"lower": (0, 0), "upper": (2.4, 2.0), "start": (0.6, 1.0, 0.0), "goal": (1.9, 1.0, 0.25)}
    scene = Scene.from_boxes([[1.2, -0.5, 1.3, 0.85], [1.2, 1.25, 1.3, 2.5]], footprint=RECTANGLE, **room)
    return Problem(scene=scene, dynamics=Unicycle(V=V, rho=1.0, b=B), R=np.eye(1), q=1.0), FreeSpace.of(scene)


def simulated(problem: Problem, space: FreeSpace, x: np.ndarray, every: int, count: int = 8000) -> tuple[float, float]:
    """psi and its standard error without control; contacts are looked for after so `every` steps of 1 ms."""
    rng, dt = np.random.default_rng(every), 1e-3
    states, alive, weight = np.tile(x, (count, 1)), np.arange(count), np.zeros(count)
    for k in range(5000):
        turn = rng.standard_normal(len(alive)) * B * np.sqrt(dt)
        heading = states[alive, 2] + 0.5 * turn
        states[alive] += np.column_stack((V * dt * np.cos(heading), V * dt * np.sin(heading), turn))
        arrived = problem.scene.goal.contains(states[alive, :2])
        weight[alive[arrived]] = np.exp(-(k + 1) * dt / problem.temperature)
        alive = alive[~arrived]
        if k % every == 0:
            quick = np.empty(len(alive))
            clearances(space.static, states[alive], quick)
            doubt = np.flatnonzero(quick <= 0.0)
            quick[doubt] = space.collision.clearance(states[alive[doubt]])
            alive = alive[quick > 0.0]
    return float(weight.mean()), float(weight.std() / np.sqrt(count))


def test_the_grid_agrees_with_simulation_and_samples_agree_with_the_grid():
    problem, space = gap()
    truth = Desirability.of(problem, space)
    tree = grown_tree(space, Dubins.of(problem), np.array([0.6, 1.0, 0.0]), vertices=600)
    for x in map(np.array, STATES):
        (often, error), (seldom, _) = simulated(problem, space, x, 1), simulated(problem, space, x, 4)
        v = 2.0 * -np.log(often) + np.log(seldom)  # the bias of steps is as their root
        assert abs(problem.temperature * v - truth.value(x)) < 4.0 * 2.3 * problem.temperature * error / often
        controller = Controller(problem, space, tree, Sampling(samples=4000), rng=np.random.default_rng(0))
        estimate = controller.plan(x).estimate
        assert estimate is not None
        assert abs(estimate.value - truth.value(x)) < 0.03 + 4.0 * estimate.value_error
