"""Small scenes whose psi is known on a grid, for tests of what samples and ways say about them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from discs import block, disc, scene_of

from pirrht import Desirability, Estimate, FreeSpace, PathIntegral, Problem, Scene, SingleIntegrator
from pirrht.arrays import Array
from pirrht.proposals.desirability_tube import DesirabilityAscent
from pirrht.proposals.proposal import Batch, Proposal, Tape


@dataclass(frozen=True, eq=False)
class Solved:
    """A problem, a state in it, references from there, and the truth."""

    problem: Problem
    space: FreeSpace
    x: Array  # (2,) [m]
    lines: tuple[Array, ...]  # (H,) corners (k, 2) of references after x, the goal point as the last [m]

    @classmethod
    def of(cls, scene: Scene, b: float, phi: float, *lines: list[tuple[float, float]]) -> Solved:
        """From corners between start and goal."""
        corners = tuple(np.vstack([np.reshape(line, (-1, 2)), scene.goal.center]) for line in lines)
        return cls(problem_in(scene, b, phi), FreeSpace.of(scene), scene.start[:2].copy(), corners)

    @property
    def truth(self) -> Desirability:
        """The solution on a grid."""
        return _solved(self)

    def batch(self, integral: PathIntegral, *counts: int) -> Batch:
        """Samples around the references, on their ways, or along tapes of speed 1 where those are held."""
        rows = list(zip(self.lines, counts, strict=False))
        times = integral.grid(2.0 * max(length(self.x, line) for line, _ in rows))
        leading = integral.proposals
        leads = [
            leading.climbing(self.x, line) if leading.climbs else Tape(times, tape(self.x, line, times))
            for line, _ in rows
        ]
        proposals = tuple(Proposal(lead=lead, count=n) for lead, (_, n) in zip(leads, rows, strict=True))
        return Batch(state=self.x, times=times, proposals=proposals)


@cache
def _solved(known: Solved) -> Desirability:
    return Desirability.of(known.problem, known.space)


def problem_in(scene: Scene, b: float, phi: float = np.inf) -> Problem:
    """A point that is to reach the goal; k = 1 / b^2."""
    return Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2.0 * np.eye(2), phi=phi)


def length(x: Array, line: Array) -> float:
    """Of a line from x over corners (k, 2) [m]."""
    return float(np.hypot(*np.diff(np.vstack([x, line]), axis=0).T).sum())


def tape(x: Array, line: Array, times: Array) -> Array:
    """Velocities (T, 2) of one meter per second along a line, zero from its end on."""
    whole = np.vstack([x, line])
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(whole, axis=0).T))])
    places = np.stack([np.interp(times, ends, whole[:, i]) for i in range(2)], axis=1)
    return np.diff(places, axis=0) / np.diff(times)[:, None]


def slope(integral: PathIntegral, lead: DesirabilityAscent, x: Array) -> Array:
    """grad log psi (2,) [1/m] that a way says at x (2,), walls included: its control is b^2 times that."""
    B = integral.problem.dynamics.B_c(x)
    return np.linalg.solve(B @ B.T, lead(x, 0.0) + lead.push(x))


def shares(known: Solved, found: list[Estimate]) -> Array:
    """psi by the grid's."""
    return np.exp([e.log_psi - known.truth.log_psi(known.x) for e in found])


def error_of(values: Array) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values)))


def is_the_grids(values: Array) -> bool:
    """Within 3 standard errors and 1 %: the clearance field never tells too much, so obstacles are a little wider."""
    return bool(abs(values.mean() - 1.0) < 3.0 * error_of(values) + 0.01)


@cache
def around_post(b: float, phi: float = np.inf) -> Solved:
    """A disc between start and goal, a little off the line between them; references on both sides of it."""
    below, above = ([(1.35, y), (1.65, y)] for y in (1.175, 2.025))
    scene = scene_of([disc("post", 1.5, 1.6, 0.3)], start=(0.6, 1.5), goal=(2.4, 1.5), side=3.0)
    return Solved.of(scene, b, phi, below, above)


@cache
def around_corner(b: float, phi: float = np.inf) -> Solved:
    """A block that leaves one way around its corner, to a goal behind it."""
    scene = scene_of([block("block", 2.0, 0.65, (0.5, 0.65))], start=(0.9, 0.8), goal=(2.3, 2.0), side=3.0)
    return Solved.of(scene, b, phi, [(1.398, 1.402)])


@cache
def in_channel(b: float, width: float, phi: float = np.inf, length: float = 6.0, ahead: float = 5.0) -> Solved:
    """A straight channel between two blocks, as wide as the point can move in it, with a goal on its middle."""
    radius, half = 0.05, (0.5 * length, 0.25)
    walls = [block(f"wall{i}", half[0], 1.0 + side * (0.5 * width + radius + half[1]), half)
             for i, side in enumerate((-1.0, 1.0))]  # fmt: skip
    scene = scene_of(walls, start=(0.5, 1.0), goal=(0.5 + ahead, 1.0), side=(length, 2.0), radius=radius)
    return Solved.of(scene, b, phi, [])
