"""A task: a scene, a problem and settings, for which trees, controllers and exact solutions are made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.steering.in_time import InTime
from pirrht.steering.steering import Steering
from pirrht.topology.homology import Homology
from sim.mjcf import Loaded
from sim.options import check_size
from sim.settings import Settings
from sim.systems import System, refuse

ENOUGH = 30.0  # effective samples that the first plan of a drive rests on, if it can be had


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Task:
    """A scene with a robot, its problem, its free space and settings; everything random comes from `settings.seed`.

    Raises:
        OptionError: plans under these settings would fit into no memory, or never end.
    """

    loaded: Loaded
    system: System
    settings: Settings
    problem: Problem
    space: FreeSpace
    margin: float = 0.0  # that plans leave around the robot [m]
    widens: bool = True  # whether the limit H_limit may give way; not one that was asked for

    def __post_init__(self) -> None:
        check_size(self)

    @property
    def start(self) -> Array:
        """Start state, (n,)."""
        return self.problem.dynamics.state_of(self.problem.scene.start)

    @property
    def moving(self) -> bool:
        """Return whether obstacles move in the scene."""
        return bool(self.loaded.scene.movers)

    @property
    def homology(self) -> Homology:
        """Homology by which classes of runs are told apart."""
        return self.in_time.homology(self.space) if self.moving else self.space.homology

    @property
    def in_time(self) -> InTime:
        """The steering in space and time."""
        return InTime.of(self.problem, self.settings.speed_limit, self._pace())

    def _pace(self) -> float | None:
        """The best speed of ways [m/s]: as declared, or else what its own steering makes of the way to the goal."""
        if self.system.pace is not None or self.system.steering is None or self.problem.dynamics.noisy_position:
            return self.system.pace
        steering: Steering = self.system.steered(self.problem)
        goal = np.asarray(steering.roots(self.problem.scene.goal.center))[:1]
        found = steering.trajectory(steering.connect(steering.vertex_of(self.start)[None], goal))
        return float(found.length / found.durations.sum())

    def steering(self) -> Steering:
        """The two-point optimum that fits the dynamics; ways in space and time where bodies move."""
        if self.moving:
            return self.in_time
        steering: Steering = self.system.steered(self.problem)
        return steering

    def seeds(self) -> tuple[np.random.SeedSequence, ...]:
        """Independent seeds of the tree, the sampler and the plant."""
        tree, sampler, plant = np.random.SeedSequence(self.settings.seed).spawn(3)
        if self.settings.plan_seed is not None:
            tree = np.random.SeedSequence(self.settings.plan_seed).spawn(3)[0]
        return tree, sampler, plant

    def with_settings(self, **changes: Any) -> Self:
        """Return the scene under other settings; the free space is kept.

        Raises:
            OptionError: the system has no such number, or a value cannot work.
        """
        refuse(self.system, {name: v for name, v in changes.items() if v != getattr(self.settings, name)})
        settings = replace(self.settings, **changes)
        problem = self.system.problem(self.loaded.scene, settings)
        return replace(self, settings=settings, problem=problem, widens=self.widens and "limit" not in changes)

    @property
    def sampling(self) -> Sampling:
        """Sampling of the settings."""
        s = self.settings
        first = s.period if s.period < s.dt else None
        return Sampling(
            dt=s.dt,
            first=first,
            samples=s.samples,
            exit=s.exit,
            steps=s.steps,
            weights=s.weights,
            guide=s.guide,
            allocation=s.allocation,
            draws=s.draws,
            target=s.target_error,
            least=ENOUGH if s.guide == "feedback" else 0.0,
            budget=s.budget,
            threads=s.threads,
        )

    def classes_at_start(self) -> int:
        """Classes with |1 - H_i| <= H_limit at the start, `settings.classes` at most."""
        homology, limit = self.homology, self.settings.limit
        straight = homology.base(homology.at(self.start, 0.0))
        most = self.settings.classes or Settings().classes
        number = np.floor(limit - straight) - np.ceil(-limit - straight) + 1
        return int(np.clip(np.prod(number), 1, most))
