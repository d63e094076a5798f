"""Interface of all policies."""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from numbers import Real

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control import map_update
from pirrht.control.map_update import Renewed
from pirrht.control.plan import Plan
from pirrht.control.prediction import ConstantVelocity
from pirrht.control.run_state import RunState
from pirrht.control.settings import TimeBudget
from pirrht.errors import OptionError, refuse_unless_positive
from pirrht.estimation.sampler import PathIntegral
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.mapping.believed import Believed
from pirrht.mapping.blind_side import BlindSide
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.topology.signature import Signature, class_id


class Policy(ABC):
    """A feedback law that replans during a run: `Controller`, `Mppi` or `Optimal`."""

    path_integral: PathIntegral  # sampler of the problem
    homology: Signature  # classes of references and runs
    tree: HomologyTree | None = None  # None: it needs none
    predict: ConstantVelocity | None = None  # None: motions are known
    run: RunState  # of the run under way
    believed: Believed | None = None  # what the last plan rests on; None: the scene is known
    blind: BlindSide | None = None  # where a governed robot turns to look; None: it need not

    @property
    def problem(self) -> Problem:
        """Problem that the samples are of."""
        return self.path_integral.problem

    @property
    def space(self) -> FreeSpace:
        """Free space of the scene, with its moving obstacles."""
        return self.path_integral.space

    @abstractmethod
    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,); samples are drawn until `left`, the time left for it [s], is up."""

    def step(self, x: Array, dt: float) -> Array:
        """Observe the last step, plan at x (n,) and return the control (m,) that will be held for the next dt [s].

        Raises:
            OptionError: dt is not positive.
            NoReference: no class reaches the goal from where the run begins.

        Examples:
            A loop of your own; `begin(x)` starts another run:

            >>> while not arrived:  # doctest: +SKIP
            ...     u = controller.step(robot.state, 0.02)
            ...     robot.drive(u, 0.02)
        """
        refuse_unless_positive(dt, "dt", "a control is held for a positive number of seconds")
        x = self.problem.dynamics.checked(x)
        if self.run.held is not None:
            self.observe(x[None], self.run.held)
        plan = self.plan(x)
        self.run.held = dt
        return plan.control

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the run so far; a new one starts at x (n,), at a time of the moving obstacles' clock [s].

        OptionError: x is no state, or the time no number.
        """
        if not (isinstance(time, Real) and np.isfinite(time)):
            raise OptionError(f"the time is {time!r}; a run begins at a number of seconds, such as 0")
        self.run = RunState.begin(self.homology, self.problem.dynamics.checked(x), float(time), self.space.scene.movers)
        if self.predict is not None:
            self.predict.begin()

    def observe(self, states: Array, duration: float, until: float | None = None) -> None:
        """Record the states (k, n) just driven through and the time it took [s], `until` a time [s]; None: now."""
        run = self.run
        states = np.atleast_2d(self.problem.dynamics.checked(states, many=True))
        run.passed(duration)
        run.clock.observed(until)
        run.route.path.observe(states, run.clock.known - run.route.since)

    def expect(self, states: Array, duration: float) -> None:
        """Plan for the end of states (k, n) driven through next, in `duration` [s]; observations replace them."""
        states = np.atleast_2d(self.problem.dynamics.checked(states, many=True))
        self.run.passed(duration)
        self.run.route.path.expect(states, self.run.now)

    def update(self, scene: Scene, vertices: int | None = None) -> None:
        """Continue among other static obstacles; the path driven so far still counts.

        A new tree keeps vertices of the last one that are still free. Obstacles keep their numbers, and so classes
        their names; turns about new obstacles, which come last, count from where the robot is, and one off its own
        marker is new. What is known of a class stays while its path is free. Nothing changes if the scene is unchanged,
        or is refused.

        Args:
            scene: with the same goal; its start does not matter.
            vertices: of the tree; None: as many as before.

        Raises:
            OptionError: the goal is another, obstacles move, or there is no scene or no such number of vertices.
            SceneError: obstacles cover all of the goal, or the workspace is too large for the robot.
        """
        self.adopt(self.renewed(scene, vertices))

    def renewed(self, scene: Scene, vertices: int | None = None) -> Renewed | None:
        """Examine another scene for `adopt`, and change nothing; None if it is unchanged. See `update`."""
        return map_update.renewed(self.problem, self.space, self.tree, scene, vertices)

    def adopt(self, new: Renewed | None) -> None:
        """Continue in a scene that `renewed` has examined; None: in the last one. OptionError: this policy has one."""
        raise OptionError(f"{type(self).__name__} knows one scene alone; make another for the new one")

    def driven_class(self) -> tuple[int, ...]:
        """Return the class (M,) of the driven path, completed by a straight line to the goal point [turns]."""
        return self.run.route.path.winding()

    def driven_id(self) -> str:
        """Return the name of the class of the driven path, as tables print it: "1,0" for `driven_class` (1, 0)."""
        return class_id(self.driven_class(), self.homology.named)

    def _state(self, x: Array) -> Array:
        """Return the state (n,) of a plan as numbers; warn if it is not that of the last, and nothing was observed.

        OptionError: it is no state, lies in the goal or outside the workspace.
        """
        x = self.problem.dynamics.checked(x)
        last = self.run.queried
        place = self.problem.dynamics.place(x)
        for lost, where in (
            (self.space.scene.goal.contains(place), "already in the goal"),
            (not self.space.scene.world.contains(place), "outside the workspace"),
        ):
            if lost:
                raise OptionError(f"a plan at {formatting.vector(place)} is {where}; no control leads on from there")
        if last is not None and not np.array_equal(x, last):
            before = self.problem.dynamics.place(last)
            warnings.warn(
                f"a plan at {formatting.vector(place)} after one at {formatting.vector(before)}, and nothing was "
                "observed in between: call step(x, dt) for each control, or observe(states, dt) after it; begin(x) if "
                "this is another run",
                RuntimeWarning, stacklevel=3,
            )  # fmt: skip
        self.run.queried = x
        return x

    def _update_prediction(self, x: Array, budget: TimeBudget) -> None:
        """Update the prediction of moving obstacles at x (n,), for the run, the samples and the tree."""
        if self.predict is None:
            return
        prediction = self.predict.at(x, self.run.clock.known, None if budget.left is None else budget.enough)
        if prediction is not self.run.route.prediction:
            self.run.route.predict(prediction, x, self.run.clock.time)
            self.path_integral.set_prediction(prediction.space.moving, prediction.homology)
            self.tree = self.tree and prediction.tree
