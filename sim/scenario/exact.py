"""The exact solution of a task, and the feedback law that it gives."""

from __future__ import annotations

from pirrht.control.optimal import Optimal
from pirrht.errors import OptionError
from pirrht.exact.desirability import Desirability, solver_for
from pirrht.exact.domain import Progress
from sim.scenario.task import Task


def truth(task: Task, progress: Progress) -> Desirability:
    """The exact solution: in continuous time, or for steps of dt if exit is judged at their ends.

    Raises:
        OptionError: no grid solves this problem.
    """
    dt = task.settings.dt if task.settings.exit == "endpoint" else None
    _refuse_unsolved(task, dt)
    return Desirability.of(task.problem, task.space, dt=dt, progress=progress)


def optimal(task: Task, known: Desirability | None, progress: Progress) -> Optimal:
    """The grid's feedback law, in continuous time.

    Raises:
        OptionError: no grid solves this problem, or bodies are to be foretold.
    """
    refuse_foretold(task)
    _refuse_unsolved(task, None)
    return Optimal(known or Desirability.of(task.problem, task.space, progress=progress), task.sampling)


def refuse_foretold(task: Task) -> None:
    """Refuse bodies whose motions are to be foretold, for the optimal law, which knows them.

    Raises:
        OptionError: they are.
    """
    if task.moving and task.settings.predict != "known":
        raise OptionError(f"the optimal law knows how bodies move; leave out --predict {task.settings.predict}")


def _refuse_unsolved(task: Task, dt: float | None) -> None:
    """Refuse by its public name a robot that no grid serves.

    Raises:
        OptionError: says which robots there are grids for.
    """
    try:
        solver_for(task.problem, task.space, dt)
    except OptionError:
        where, who = (" among moving bodies", "puck") if task.moving else ("", "puck or unicycle")
        raise OptionError(
            f"no grid solves the problem of a {task.system.called}{where}, so its exact value and optimal control "
            f"are not known: leave out --truth, choose another --method than optimal, or --robot {who}"
        ) from None
