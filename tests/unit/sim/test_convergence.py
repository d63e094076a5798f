"""Lengths of the best path per class while the tree grows (the paper's Fig. 3a)."""

import numpy as np
import pytest

from pirrht.errors import OptionError
from sim.scenario import prepare
from sim.scenario.convergence import grow


@pytest.fixture(scope="module")
def slit():
    return prepare("slit")


@pytest.fixture(scope="module")
def watched(slit):
    tree = slit.empty_tree()
    return tree, grow(tree, slit.start, 600, every=25)


def test_lengths_never_rise_and_approach_the_exact_ones_of_the_slit(watched):
    _, convergence = watched
    with np.errstate(invalid="ignore"):  # inf - inf before a class is found
        assert not np.any(np.diff(convergence.lengths, axis=0) > 0)
    exact = {"0,0": 4.2, "-1,0": 4.33873, "0,1": 4.33873}
    last = dict(zip(convergence.ids, convergence.lengths[-1], strict=True))
    for name, length in exact.items():
        assert length <= last[name] < 1.05 * length  # not shortened


def test_the_last_note_is_what_the_tree_itself_says(watched, slit):
    tree, convergence = watched
    raw = {r.id: r.length for r in tree.references(slit.start, shortened=False)}
    last = dict(zip(convergence.ids, convergence.lengths[-1], strict=True))
    for name, length in raw.items():
        assert last[name] <= length * (1 + 1e-12)
    assert min(last.values()) == pytest.approx(min(raw.values()), rel=0.02)


def test_watching_does_not_change_the_tree(watched, slit):
    tree, convergence = watched
    unwatched = slit.empty_tree()
    unwatched.grow(600)
    assert np.array_equal(unwatched.states[:600], tree.states[:600])
    assert convergence.vertices[-1] == 600
    assert convergence.iterations[-1] == tree.draws


def test_every_note_needs_at_least_one_vertex_in_between(slit):
    with pytest.raises(OptionError, match="every is 0"):
        grow(slit.empty_tree(), slit.start, 10, every=0)
