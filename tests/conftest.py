"""Fixtures that are slow to make and that no test changes."""

from __future__ import annotations

import pytest

from pirrht.tree.homology_tree import HomologyTree
from sim.scenario import Scenario, prepare


@pytest.fixture(scope="session")
def slit() -> Scenario:
    """The scene `slit` under its own settings."""
    return prepare("slit")


@pytest.fixture(scope="session")
def slit_tree(slit: Scenario) -> HomologyTree:
    """A tree of 1000 vertices in it; tests ask, and do not grow it."""
    return slit.grown_tree()
