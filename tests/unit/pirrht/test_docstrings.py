"""Docstrings of the main entry points: examples run, and `help` tells shapes and units of every field."""

from __future__ import annotations

import doctest
import inspect
import re
from dataclasses import fields

import pytest

import pirrht
from sim.scenario import Scenario

EXAMPLES = [pirrht, pirrht.Problem, pirrht.Goal, pirrht.Scene, pirrht.Sampling, pirrht.HomologyTree, pirrht.Controller]
TOLD = [pirrht.Problem, pirrht.Scene, pirrht.Goal, pirrht.Obstacle, pirrht.Sampling, pirrht.Estimate, pirrht.Plan]
UNIT = re.compile(r"\[[^]]+\]")


@pytest.mark.parametrize("entry", [*EXAMPLES, Scenario], ids=lambda entry: entry.__name__)
def test_the_example_in_a_docstring_gives_what_it_says(entry):
    said = inspect.getdoc(entry)
    example = doctest.DocTestParser().get_doctest(said, {}, entry.__name__, None, None)
    assert example.examples
    results = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example)
    assert results.attempted > 0
    assert results.failed == 0


def attributes(entry: type) -> dict[str, str]:
    """What a docstring's section on attributes says of each."""
    section = re.search(r"\nAttributes:\n(.*?)(\n\n|\Z)", inspect.getdoc(entry) + "\n\n", re.S)
    assert section
    found = re.findall(r"^    (\w+): (.*?)(?=^    \w+: |\Z)", section[1] + "\n", re.S | re.M)
    return dict(found)


@pytest.mark.parametrize("entry", TOLD, ids=lambda entry: entry.__name__)
def test_help_tells_every_field_and_no_other(entry):
    assert list(attributes(entry)) == [field.name for field in fields(entry)]


@pytest.mark.parametrize("entry", TOLD, ids=lambda entry: entry.__name__)
def test_help_tells_the_shape_and_unit_of_every_array(entry):
    told = attributes(entry)
    plain = {"rotation", "weight", "proposal_weights", "faces", "state"}  # axes, shares and indices have no unit
    for field in fields(entry):
        if re.search(r"\bArray\b|NDArray", str(field.type)):
            assert re.search(r"\((\w|\+)+,( \w+)*\)|\(\w+, \w+\)", told[field.name]), field.name
            assert UNIT.search(told[field.name]) or field.name in plain, field.name


@pytest.mark.parametrize("name", ["q", "phi", "temperature"])
def test_help_tells_the_units_of_costs(name):
    assert re.search(r"\[cost(/s)?\]", attributes(pirrht.Problem)[name])
