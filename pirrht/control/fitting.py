"""Whether a tree is one that a problem's references can come from."""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import NoReference, OptionError
from pirrht.problem import Problem
from pirrht.topology.in_time import TimedHomology
from pirrht.tree.homology_tree import HomologyTree


def check_fits(problem: Problem, tree: HomologyTree) -> None:
    """Refuse a tree of another kind of system, or of one without times where bodies move.

    Raises:
        OptionError: it says of which one the tree is, and of which it ought to be.
    """
    steering, dynamics = type(tree.steering).__name__, type(problem.dynamics).__name__
    if problem.scene.movers and not isinstance(tree.homology, TimedHomology):
        raise OptionError(
            f"{steering} knows no times, and bodies move in the scene; grow the tree with InTime.of(problem)"
        )
    zero = np.zeros(problem.dynamics.n)
    if len(tree.steering.vertex_of(tree.homology.asked(zero, 0.0))) != tree.steering.n:
        raise OptionError(
            f"{steering} connects states of {tree.steering.n} numbers and {dynamics} has {problem.dynamics.n}; grow "
            f"the tree with a Steering for {dynamics}"
        )


def check_drives(problem: Problem, tree: HomologyTree, *, guided: bool) -> None:
    """Refuse references without controls where samples would follow nothing but these.

    Args:
        guided: whether guides lead samples.

    Raises:
        OptionError: there is nothing to follow.
    """
    if not (tree.steering.drives or guided):
        raise OptionError(
            f"{type(problem.dynamics).__name__} has no steering of its own, and its references no controls that "
            'samples could follow: guide them by "feedback", not "open-loop"'
        )


def blame_speed(tree: HomologyTree | None, x: Array) -> None:
    """Where a state x (n,) without references would have some at rest, say so.

    Raises:
        NoReference: the speed is the reason.
    """
    if tree is not None and tree.too_fast(x):
        raise NoReference(x.tolist(), vertices=tree.size, limit=tree.limit, hasty=True) from None
