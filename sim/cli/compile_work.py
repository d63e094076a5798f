"""What has to be compiled for a system, and about how long that takes: notes beside the kernels say what is there."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from pirrht.compiled import cache
from pirrht.compiled.cache import identity
from pirrht.problem import Problem
from pirrht.rollouts.point.block import is_point
from sim.systems import System

# How long it takes where nothing else runs [s]: motions of a system's own, and its guides and samples; among bodies
# that move any system's ways in space and time, and guides and samples.
MOTIONS, GUIDES = 10, 40
WAYS, AMONG = 40, 65


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """What the kernels of one system are: a point's, where nothing moves, are those that every command needs."""

    called: str  # the robot's public name
    key: str | None  # of all numeric functions that kernels close over; None: they cannot be kept
    point: bool
    moves: bool  # whether its references are motions of its own
    among: bool  # whether bodies move in the scene

    @classmethod
    def of(cls, system: System, problem: Problem) -> Work:
        """That of a system in a problem."""
        among = bool(problem.scene.movers)
        point = is_point(problem.dynamics) and not among
        return cls(
            called=f"{system.called} among bodies that move" if among else system.called,
            key=_key(system, problem),
            point=point,
            moves=among or (not point and system.steering is not None),
            among=among,
        )

    def seconds(self, sampling: bool) -> int:
        """What is left to do, beside what a point needs [s]."""
        motions, guides = (WAYS, AMONG) if self.among else (MOTIONS, GUIDES)
        plans = motions * (self.moves and not self.noted("plan"))
        return plans + guides * (sampling and not self.point and not self.noted("sample"))

    def done(self, *what: str) -> None:
        """Note that kernels for "plan" or "sample" have been compiled."""
        for one in what if self.key is not None else ():
            cache.note(self._note(one))

    def noted(self, what: str) -> bool:
        """Whether kernels for "plan" or "sample" are noted to be there."""
        return self.key is not None and cache.noted(self._note(what))

    def _note(self, what: str) -> str:
        """The name of a note: among bodies that move the ways of all systems are the same."""
        return f"{what}-{'among' if self.among and what == 'plan' else self.key}"


def _key(system: System, problem: Problem) -> str | None:
    d, names = (
        problem.dynamics,
        [system.name if system.robots else "", str(problem.dynamics.n), str(problem.dynamics.m)],
    )
    for function in _functions(problem):
        name = identity(function)
        if name is None:
            return None
        names.append(name)
    names.append(str(d.stratonovich))
    if problem.scene.movers:
        names.append("among")
    return hashlib.sha256("\n".join(names).encode()).hexdigest()[:24]


def _functions(problem: Problem) -> Iterator[Callable[..., Any]]:
    """What somebody's system is made of, as far as kernels close over it."""
    d = problem.dynamics
    blocks = [None, None] if d.input_form else [d.control_block, d.diffusion_block]
    for one in (d.drift, *blocks, d.input_matrix, d.homing, problem.q):
        if callable(one):
            yield one
