"""What is special about a system is answered once, and kernels follow from the answer."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from discs import scene_of

from pirrht import Problem, SingleIntegrator, Unicycle
from pirrht.geometry.disc import DISC
from pirrht.rollouts.cpu import kernels_for, kind_of
from pirrht.rollouts.point_block import blocks_for
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.dynamics import Dynamics, IsotropicNoise, no_drift
from pirrht.systems.rover import Rover
from pirrht.traits import Traits

SCENE = scene_of([], start=(0.5, 3.0), goal=(5.5, 3.0))


def wind(x, p, out):
    out[0], out[1] = 0.3, 0.0


def rate(x, p):
    return 1.0 + x[0] * x[0]


@dataclass(frozen=True, eq=False)
class Blown(IsotropicNoise):
    n, m, drift = 2, 2, staticmethod(wind)


@dataclass(frozen=True, eq=False)
class Narrow(IsotropicNoise):
    """A point with more noise along x than along y."""

    n, m, drift = 2, 2, staticmethod(no_drift)
    diffusion_block = np.diag([0.2, 0.1])  # type: ignore[assignment]
    control_block = np.diag([2.0, 1.0])  # type: ignore[assignment]


def traits(dynamics: Dynamics) -> Traits:
    noise = dynamics.input_noise
    R = np.eye(dynamics.m) if noise is None else np.linalg.inv(noise @ noise.T)
    return Traits.of(Problem(dynamics=dynamics, scene=SCENE, R=R))


def test_only_a_point_without_drift_whose_noise_is_equal_in_all_directions_climbs():
    points = {"plain": SingleIntegrator(b=0.1), "blown": Blown(b=0.1), "narrow": Narrow()}
    found = {name: traits(d) for name, d in points.items()}
    assert all(one.point and one.free_point and one.noisy_position for one in found.values())
    assert [name for name, one in found.items() if one.climbs(moving=False)] == ["plain"]
    assert not any(one.climbs(moving=True) for one in found.values())
    assert not any(traits(d).point for d in (Unicycle(b=0.1), DoubleIntegrator(b=0.1), Rover()))


def test_noise_is_on_the_position_in_input_form_and_of_a_point_and_else_behind_it():
    known = {type(d).__name__: traits(d) for d in (SingleIntegrator(), Unicycle(), DoubleIntegrator(), Rover())}
    assert [name for name, one in known.items() if one.noisy_position] == ["SingleIntegrator", "Rover"]
    assert [name for name, one in known.items() if one.input_form] == ["Rover"]
    assert [name for name, one in known.items() if one.can_brake] == ["SingleIntegrator", "DoubleIntegrator", "Rover"]
    assert all(one.constant_gain for one in known.values())
    assert not known["Rover"].constant_blocks


@pytest.mark.parametrize("varying", [False, True])
def test_kernels_of_a_point_simulate_in_blocks_unless_its_rate_varies_and_laws_are_for_others(varying):
    q = {"q": rate, "q_min": 1.0} if varying else {}
    problem = Problem(dynamics=SingleIntegrator(b=0.1), scene=SCENE, R=np.eye(2), **q)
    assert Traits.of(problem).in_blocks(moving=False) is not varying
    assert (kernels_for(problem, DISC) is blocks_for(None)) is not varying
    assert not kind_of(problem, DISC).takes_law
    assert kind_of(replace(problem, dynamics=Blown(b=0.1)), DISC).takes_law
