"""Refuse systems that scenes and rollouts cannot serve."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from itertools import chain

import numpy as np

from pirrht.errors import OptionError, one_line
from pirrht.systems.dynamics import Dynamics


def check(d: Dynamics) -> None:
    """Refuse a system that scenes and rollouts cannot serve: OptionError, with what would have worked."""
    for fault in chain(_faults(d), _input_faults(d) if d.input_form else (), _drift_faults(d)):
        raise OptionError(f"{type(d).__name__}: {fault}")


def _faults(d: Dynamics) -> Iterator[str]:
    """Find faults of states and blocks."""
    n, m, given = getattr(d, "n", 0), getattr(d, "m", 0), ", ".join(d.states)
    blocks = ("input_matrix", "input_noise") if d.input_form else ("control_block", "diffusion_block")
    needed = ("n", "m", "parameters", "drift", *blocks)
    missing = [what for what in needed if getattr(d, what, None) is None]
    if missing:
        yield f"{' and '.join(missing)} missing; a Dynamics declares {', '.join(needed)}"
    if "z" in d.states:
        yield 'its state "z" is a third position, but scenes are planar; keep to "x" and "y"'
    if n < 2:
        yield f"n is {n}; a robot in the plane has at least the 2 states x and y"
    if d.states[:2] != ("x", "y"):
        yield f'its states are ({given}); the first two must be "x" and "y"'
    if not len(set(d.states)) == len(d.states) == n:
        yield (
            f"n is {n}, but its states are ({given}); name each once, "
            'as in states = ("x", "y", "vx", "vy"); scenes are planar, so there is no third position'
        )
    if not 1 <= m <= n:
        yield f"m is {m}; of {n} states at least 1 and at most {n} are actuated"
    if d.input_form:
        return
    if d.input_noise is not None or d.stratonovich:
        which = "stratonovich" if d.input_noise is None else "input_noise"
        yield f"{which} belongs to the input form; declare an input_matrix, or leave it out"
    for what in blocks:
        block = getattr(d, what)
        if not callable(block) and not isinstance(block, np.ndarray):
            yield f"{what} is a {type(block).__name__}; it must be an array or a function"
        if not callable(block) and np.shape(block) != (m, m):
            yield f"{what} is {np.shape(block)}; with m = {m} it must be {m, m}"


def _drift_faults(d: Dynamics) -> Iterator[str]:
    """Try the drift at two states."""
    if inspect.ismethod(d.drift):
        yield "drift(x, p, out) cannot be called without self; make it a @staticmethod"
    rates = np.zeros((2, d.n))
    for x, out in zip((0.0, 0.3), rates, strict=True):
        try:
            with np.errstate(all="ignore"):  # a value that is no number is reported below
                d.drift(np.full(d.n, x), d.parameters, out)
        except TypeError as error:
            yield f"drift(x, p, out) cannot be called ({error}); make it a @staticmethod"
        except Exception as error:
            yield f"drift(x, p, out) fails at x = {[x] * d.n} ({one_line(error)}); fix it"
    if not np.isfinite(rates).all(axis=1).any():
        yield f"drift(x, p, out) writes {rates[1].tolist()} at x = {[0.3] * d.n}; fix it"


def _input_faults(d: Dynamics) -> Iterator[str]:
    """Find faults of an input form."""
    G, s, shape, fills = d.input_matrix, d.input_noise, (d.n, d.m), "input_matrix(x, p, out)"
    twice = [what for what in ("control_block", "diffusion_block") if getattr(d, what, None) is not None]
    if twice:
        yield f"both {twice[0]} and input_matrix are declared; leave one form out"
    if not callable(G) and not isinstance(G, np.ndarray):
        yield f"input_matrix is a {type(G).__name__}; it must be an array or a function"
    if isinstance(G, np.ndarray) and G.shape != shape:
        yield f"input_matrix is {G.shape}; with n = {d.n}, m = {d.m} it must be {shape}"
    if not isinstance(s, np.ndarray):
        yield f"input_noise is a {type(s).__name__}; it must be an array: s is constant"
        return
    if s.shape != (d.m, d.m):
        yield f"input_noise is {s.shape}; with m = {d.m} it must be {d.m, d.m}"
    if not (np.all(np.isfinite(s)) and abs(np.linalg.det(s)) > 0.0):
        yield f"input_noise is {s.tolist()}; it must have an inverse, so that noise acts on every input"
    if inspect.ismethod(G):
        yield f"{fills} does not fill an out of {shape} without self; make it a @staticmethod"
    if callable(G):
        try:
            G(np.zeros(d.n), d.parameters, np.zeros(shape))
        except (TypeError, ValueError, IndexError) as error:
            yield f"{fills} does not fill an out of {shape} ({error}); make it a @staticmethod of three arguments"
