"""The mass's estimator against the exact grid of a mass on a line, at random positions and velocities.

The line lies in the plane: its wall is the border x = 0, its goal x >= 1 a disc so large that its rim is straight where
samples come; the other borders are so far off that none comes there. Motion across the line is free, costs nothing and
ends nothing, so psi is that of the line but for the rim's bend: paths that are y off the middle enter y^2 / (2 WIDE)
later, which v feels by less than 0.0005 at b = 0.3.
"""

import argparse
from typing import Any

import numpy as np
from benchmarks.mass_on_line import MassOnLine, mass_on_line
from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.problem import Problem
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape
from pirrht.steering.double_integrator import MassSteering
from pirrht.steering.motion import running_cost
from pirrht.systems.double_integrator import DoubleIntegrator

WIDE = 200.0  # radius of the goal's disc [m]
ASIDE = 20.0  # borders beside the line are so far off [m]
R = 2.0
NOISES = (0.1, 0.2, 0.3)
STATES, SAMPLES = 20, 100_000
PLANS, PLAN, PERIOD = 10, 300, 0.05  # plans at each state, their samples, and their first step [s]
NEAR, SLOWEST, FASTEST = 0.1, -0.8, 1.2  # positions so far from both ends [m], velocities in between [m/s]
HEADER = ["b", "p", "v", "cost by grid", "its error", "cost by samples", "s.e.", "off by %", "in errors", "ESS"]
HEADER += ["u by grid", "u of plans", "its s.e.", "within 2 %"]


def random_line_states(count: int, seed: int) -> Array:
    """Positions [m] and velocities [m/s], (count, 2)."""
    rng = np.random.default_rng([seed, 61])
    return np.column_stack([rng.uniform(NEAR, 1.0 - NEAR, count), rng.uniform(SLOWEST, FASTEST, count)])


def sampler(b: float, **sampling: Any) -> PathIntegral:
    """That of a mass in the plane whose psi is that of the line."""
    scene = Scene(
        name="line", lower=np.array([0.0, -ASIDE]), upper=np.array([1.1 + WIDE, ASIDE]), obstacles=(),
        goal=Goal(center=np.array([1.0 + WIDE, 0.0]), radius=WIDE), start=np.array([0.5, 0.0, 0.0]), robot_radius=1.0,
    )  # fmt: skip
    problem = Problem(dynamics=DoubleIntegrator(b=b), scene=scene, R=R * np.eye(2))
    return path_integral(problem, FreeSpace.of(scene), Sampling(**sampling))


def sampled(integral: PathIntegral, p: float, v: float, count: int, seed: int, guide: bool = True) -> Estimate:
    """What samples around the guide of the way to the goal say at position p [m] and velocity v [m/s], or around it."""
    x, steering = np.array([p, 0.0, v, 0.0]), MassSteering.of(integral.problem)
    way = steering.trajectory(steering.connect(x, np.array([1.0, 0.0, np.nan, np.nan])))
    times = integral.grid(running_cost(integral.problem, x, way))
    lead: ProposalControl = Tape(times, way.tape(times))
    if guide:
        assert isinstance(integral.guidance, DDPGuidance)
        lead = LinearFeedback(integral.guidance.optima(integral.guidance.query(x, times, 0), way)[0])
    return integral.estimate(
        integral.rollout(Batch(state=x, times=times, proposals=(Proposal(lead=lead, count=count),)), seed)
    )


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    states = random_line_states(options.states or STATES, options.first_seed)
    found, count = [], options.plans or PLANS
    with tqdm(total=len(options.noises or NOISES) * len(states), desc="states", leave=False, disable=None) as bar:
        for b in options.noises or NOISES:
            truth, integral, small = mass_on_line(b=b), sampler(b), sampler(b, first=PERIOD, samples=PLAN)
            for k, (p, v) in enumerate(states.tolist()):
                one = record(truth, sampled(integral, p, v, options.samples or SAMPLES, k), b, p, v)
                plans = [sampled(small, p, v, PLAN, 1000 * k + j) for j in range(count)]
                found.append(one | control_record(truth.control(p, v), plans))
                bar.update()
    last = ["all", *[""] * (len(HEADER) - 2), f"{100 * np.mean([one['within'] for one in found]):.0f}"]
    return HEADER, [*(_text(one) for one in found), last], found


def record(truth: MassOnLine, said: Estimate, b: float, p: float, v: float) -> dict[str, float]:
    """What grid and samples say at a position p [m] and velocity v [m/s]."""
    value, error = truth.value(p, v), truth.error(p, v)
    off = said.value - value
    return {
        "noise": b, "p": p, "v": v, "grid": value, "grid_error": error, "samples": said.value,
        "samples_error": said.value_error, "share": off / value, "errors": off / np.hypot(error, said.value_error),
        "ess": said.ess,
    }  # fmt: skip


def control_record(u: float, plans: list[Estimate]) -> dict[str, float]:
    """What plans of default size say of the control along the line, which is u [m/s^2]."""
    said, error = np.array([[plan.control[0], plan.control_error[0]] for plan in plans]).T
    return {
        "u": u, "u_mean": float(said.mean()), "u_error": float(error.mean()),
        "within": float(np.mean(np.abs(said - u) <= 2.0 * error)),
    }  # fmt: skip


def _text(one: dict[str, float]) -> list[str]:
    return [
        f"{one['noise']:g}", f"{one['p']:.3f}", f"{one['v']:+.3f}", f"{one['grid']:.4f}", f"{one['grid_error']:.4f}",
        f"{one['samples']:.4f}", f"{one['samples_error']:.4f}", f"{100 * one['share']:+.3f}", f"{one['errors']:+.1f}",
        f"{one['ess']:.0f}", f"{one['u']:.4f}", f"{one['u_mean']:.4f}", f"{one['u_error']:.4f}",
        f"{100 * one['within']:.0f}",
    ]  # fmt: skip
