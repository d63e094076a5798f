"""From a task to the objects of a run: tree, controller, plant and drive."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.control.mppi import Mppi
from pirrht.control.optimal import Optimal
from pirrht.control.policy import Policy
from pirrht.exact.desirability import Desirability
from pirrht.exact.domain import Progress, untold
from pirrht.tree.homology_tree import HomologyTree
from pirrht.tree.reference import Reference
from sim.drive import episode, realtime
from sim.drive.executor import Analytic, Executor, Plant
from sim.drive.odometer import Frame
from sim.scenario import controllers, exact, trees
from sim.scenario.task import Task

Driver = Controller | Mppi | Optimal


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Scenario(Task):
    """A scene with a robot, a problem and settings; everything random comes from `settings.seed`.

    Examples:
        >>> from sim.scenario import prepare
        >>> scenario = prepare("slit", given={"vertices": 50, "samples": 50, "max_time": 0.05})
        >>> scenario
        Scenario(puck in 'slit', pi-rrht, noise 0.1, seed 0)
        >>> tree = scenario.grown_tree()
        >>> frames = list(scenario.drive(scenario.plant(), scenario.driver(tree)))
        >>> frames[-1].outcome
        Outcome.TIMEOUT

    Raises:
        OptionError: plans under these settings would fit into no memory, or never end.
    """

    def __repr__(self) -> str:
        what = (
            f"{self.loaded.robot} in {self.loaded.scene.name!r}, {self.settings.method}, noise {self.settings.noise:g}"
        )
        return f"Scenario({what}, seed {self.settings.seed})"

    def empty_tree(self, limit: float | None = None) -> HomologyTree:
        """A tree that has its roots only; within another limit than the settings' if one is given."""
        return trees.empty(self, limit)

    def grown_tree(self, progress: Callable[[int], None] | None = None, at: Array | None = None) -> HomologyTree:
        """A tree of `settings.vertices` vertices, or the one that was saved as `settings.tree`.

        Where the limit leaves out a short way from the start, or from another state (n,), it is grown anew within a
        wider one, unless the limit was asked for.

        Raises:
            OptionError: that is no tree for this scene, robot and limit.
        """
        return trees.grown(self, progress, at)

    def references(self, tree: HomologyTree, *, waits: bool = False) -> list[Reference]:
        """The best path of every class from the start, cheapest first.

        Args:
            waits: whether there may be none among moving obstacles, since a drive waits for a way.

        Raises:
            NoReference: no class reaches the goal.
            SceneError: none does, and a body that moves comes to rest there.
        """
        return trees.references(self, tree, waits)

    def truth(self, progress: Progress = untold) -> Desirability:
        """The exact solution: in continuous time, or for steps of dt if exit is judged at their ends.

        Args:
            progress: called with the share that is done, where that takes long.

        Raises:
            OptionError: no grid solves this problem.
        """
        return exact.truth(self, progress)

    def optimal(self, truth: Desirability | None = None, progress: Progress = untold) -> Optimal:
        """The grid's feedback law, in continuous time; `truth` if it has been solved for before.

        Args:
            progress: called with the share that is done, where it has not and that takes long.

        Raises:
            OptionError: no grid solves this problem, or bodies are to be foretold, and the law knows how they move.
        """
        return exact.optimal(self, truth, progress)

    def refuse_foretold(self) -> None:
        """Refuse bodies whose motions are to be foretold, for the optimal law, which knows them.

        Raises:
            OptionError: they are.
        """
        exact.refuse_foretold(self)

    def mppi(self) -> Mppi:
        """MPPI, with at least as many samples as "pi-rrht" draws from the start."""
        return controllers.mppi(self)

    def controller(self, tree: HomologyTree | None) -> Controller | Mppi:
        """The receding-horizon controller over a grown tree; MPPI if that is the method."""
        return controllers.controller(self, tree)

    def driver(
        self,
        tree: HomologyTree | None = None,
        truth: Desirability | None = None,
        progress: Progress = untold,
    ) -> Driver:
        """Who decides under the settings' method.

        Args:
            tree: a grown one, of methods that need one.
            truth: of the method "optimal", the exact solution in continuous time if it is known already.
            progress: called with the share of it that is done, if it is not.
        """
        return self.optimal(truth, progress) if self.settings.method == "optimal" else self.controller(tree)

    def drive(self, plant: Plant, driver: Policy, growing: Callable[[int], None] | None = None) -> Generator[Frame]:
        """The drive from the start, as fast as it goes or in real time; one frame per control period.

        Args:
            growing: called with the number of vertices while the tree grows between two plans.

        Raises:
            NoReference: already the start has no reference.
        """
        s, start, rng = self.settings, self.start, self.plant_rng()
        if s.real_time:
            return realtime.run(plant, driver, start, rng, period=s.period, max_time=s.max_time, grow=s.grow)
        return episode.run(plant, driver, start, rng, max_time=s.max_time, grow=s.grow or 0, growing=growing)

    def plant(self) -> Plant:
        """The robot in MuJoCo, or its stochastic equation."""
        period = self.settings.period
        if self.settings.plant == "mujoco":
            return Executor(self.loaded, self.problem, period=period)
        step = float(self.loaded.model.opt.timestep)
        return Analytic(self.problem, self.space.collision.clearance, period=period, physics_step=step)

    def plant_rng(self) -> np.random.Generator:
        """The plant's noise; one increment per physics step whatever the method."""
        return np.random.default_rng(self.seeds()[2])
