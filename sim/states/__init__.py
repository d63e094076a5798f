"""States of robots: what the simulator must know of them, with one member for each kind of space.

`StateAdapter` is the interface, `plane` its member for robots on the ground, `space` that for robots in space. Another
member is a new file and a line in `ADAPTERS`.
"""

from collections.abc import Sequence
from typing import NamedTuple

from sim.states.adapter import Component, Joints, StateAdapter
from sim.states.plane import Plane
from sim.states.space import Space

__all__ = ["ADAPTERS", "Component", "Joints", "StateAdapter", "adapter_of", "forms_of"]

ADAPTERS: tuple[type[StateAdapter], ...] = (Plane, Space)  # names of the first are those of tables and messages


def adapter_of(states: Sequence[str]) -> StateAdapter:
    """Return the adapter of a system's states, by their names; ValueError, in words for a person: none fits."""
    kind = max((one for one in ADAPTERS if one.fits(states)), key=lambda one: one.dimension, default=None)
    if kind is None:
        *_, last = forms = [one.first_words() for one in ADAPTERS]
        raise ValueError(", ".join(forms[:-1]) + (", or " if forms[:-1] else "") + last)
    return kind(states)


class Forms(NamedTuple):
    """Forms of an option whose numbers depend on the kind of robot."""

    metavar: str
    text: str  # all of them
    counts: frozenset[int]  # of numbers


def forms_of(what: str) -> Forms:
    """Return the forms that adapters name in this attribute."""
    forms = [getattr(one, what) for one in ADAPTERS]
    counts = {len(form) for form in forms} | {sum("[" not in one for one in form) for form in forms}
    return Forms(" ".join((*forms[0][:2], "...")), f"{', or '.join(map(' '.join, forms))} in space", frozenset(counts))
