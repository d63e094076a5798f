"""Without a way a robot brakes within what is free, waits there and gives way to what comes."""

import numpy as np
import pytest
from discs import disc, scene_of
from moving import moved

from pirrht import Dynamics, FreeSpace, Problem, Scene, SingleIntegrator, Unicycle
from pirrht.control.blocked import Brake, BrakeSettings
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.rover import Rover
from pirrht.systems.second_order_car import SecondOrderCar

RADIUS, WITHIN = 0.2, 0.2
MOVING = {
    SingleIntegrator: np.array([2.0, 1.5]),
    DoubleIntegrator: np.array([2.0, 1.5, 0.8, -0.4]),
    Rover: np.array([2.0, 1.5, 0.5]),
    SecondOrderCar: np.array([2.0, 1.5, 0.5, 0.9]),
}


def room(*movers) -> Scene:
    """4 m by 3 m without anything that stands."""
    return scene_of(start=(0.6, 1.5), goal=(3.6, 1.5, 0.3), side=(4.0, 3.0), radius=RADIUS, movers=movers)


def brake_of(dynamics: Dynamics, scene: Scene) -> tuple[Brake, FreeSpace]:
    R = np.diag([2.0, 0.5]) if isinstance(dynamics, Rover) else np.eye(dynamics.m)
    return Brake(problem=Problem(dynamics=dynamics, scene=scene, R=R)), FreeSpace.of(scene)


def driven(dynamics: Dynamics, law, x: np.ndarray, seconds: float, seed: int | None = None) -> np.ndarray:
    """States (k, n) every 2 ms under a law; with a seed under noise."""
    rng, states = np.random.default_rng(seed), [x]
    for i in range(round(seconds / 0.002)):
        dw = np.zeros(dynamics.m) if seed is None else rng.normal(size=dynamics.m) * np.sqrt(0.002)
        states.append(dynamics.step(states[-1], law(states[-1], 0.002 * i), dw, 0.002))
    return np.array(states)


@pytest.mark.parametrize("kind", MOVING)
def test_every_robot_that_can_stop_comes_to_rest_ahead_of_it_and_does_not_swing_back(kind):
    dynamics, x = kind(), MOVING[kind]
    brake, space = brake_of(dynamics, room())
    assert brake.stops
    states = driven(dynamics, brake.halt(x, space, 0.0).law, x, 3.0)
    way = states[:, :2] - x[:2]
    assert np.all(np.diff(way @ (way[-1] / max(np.hypot(*way[-1]), 1e-12))) > -1e-9)
    np.testing.assert_allclose(states[-1, :2], x[:2] + dynamics.f(x)[:2] * WITHIN, atol=0.01)
    assert np.hypot(*(states[-1] - states[-2])[:2]) < 1e-6


def test_who_is_walked_towards_gives_way_in_time():
    rows = [(0.0, 3.2, 1.5, 0.0), (2.0, 1.2, 1.5, 0.0), (9.0, 1.2, 2.9, 0.0)]
    dynamics, x = SingleIntegrator(), np.array([2.0, 1.5])
    brake, space = brake_of(dynamics, room(moved("person", rows, disc("person", 0.0, 0.0, 0.25))))
    assert space.moving.distance(x, 1.2) < 0.0  # who stays is run over
    halt = brake.halt(x, space, 0.0)
    assert halt.free == np.inf
    assert halt.clearance >= BrakeSettings().clearance
    places = driven(dynamics, halt.law, x, 3.0)[:, :2]
    assert min(space.moving.distance(place, 0.002 * i) for i, place in enumerate(places)) > 0.05


def test_a_robot_that_cannot_stop_turns_away_from_the_wall():
    dynamics = Unicycle()
    brake, space = brake_of(dynamics, room())
    assert not brake.stops
    x = np.array([2.2, 1.5, 0.0])  # 1.6 m to the border ahead, of which straight on takes as many seconds
    halt = brake.halt(x, space, 0.0)
    assert halt.free == np.inf
    assert abs(halt.law(x, 0.0)[0]) > 0.0
    assert space.collision.clearance(driven(dynamics, halt.law, x, 2.9)[:, :2]).min() > 0.0
