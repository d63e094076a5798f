"""Checks of what a controller is given, before anything is planned."""

import reprlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from pirrht.control.settings import ControlSettings
from pirrht.errors import OptionError
from pirrht.estimation.sampling import Sampling
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.guidance import DDPGuidance
from pirrht.rollouts.backend import Backend


def refuse_misfits(sampling: Any, propose: Any, backend: Any, rng: Any) -> None:
    """Refuse arguments of a controller by an OptionError that says what each must be."""
    functions = isinstance(propose, Sequence) and all(map(callable, propose))
    for name, value, fits, rule in (
        ("sampling", sampling, isinstance(sampling, Sampling), "a Sampling"),
        ("propose", propose, functions, "a sequence of functions (x, default) that return a proposal or None"),
        ("backend", backend, backend is None or isinstance(backend, Backend),
         "None, or have the methods sample and replay of a Backend"),
        ("rng", rng, isinstance(rng, np.random.Generator), "a generator, such as np.random.default_rng(0)"),
    ):  # fmt: skip
        if not fits:
            raise OptionError(f"{name} is {reprlib.repr(value)}; it must be {rule}")


def validate(tree: HomologyTree | None, problem: Problem, sampling: Sampling, settings: ControlSettings) -> None:
    """Check that a tree serves a method, is of a problem's kind of system, and has times where obstacles move.

    An OptionError is raised if not, or if its references have no controls that samples could follow.
    """
    if tree is None:
        if settings.use.most != 0:
            raise OptionError(f"the method {settings.method!r} needs a tree")
        return
    steering, dynamics = type(tree.steering).__name__, type(problem.dynamics).__name__
    if problem.scene.movers and not tree.steering.timed:
        raise OptionError(
            f"{steering} knows no times, and obstacles move in the scene; grow the tree with InTime.of(problem)"
        )
    if len(tree.steering.vertex_of(tree.at(np.zeros(problem.dynamics.n), 0.0))) != tree.steering.n:
        raise OptionError(
            f"{steering} connects states of {tree.steering.n} numbers and {dynamics} has {problem.dynamics.n}; grow "
            f"the tree with a Steering for {dynamics}"
        )
    if not (tree.steering.drives or sampling.guide == "feedback" or DDPGuidance.suits(problem)):
        raise OptionError(
            f"{dynamics} has no steering of its own, and its references no controls that samples could follow: guide "
            'them by "feedback", not "open-loop"'
        )
