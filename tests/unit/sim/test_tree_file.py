"""A saved tree is the tree: it answers alike and grows on alike."""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from tree_files import again, assert_equal_references, assert_equal_trees, grown, packed

from pirrht.errors import OptionError
from pirrht.planner.tree import HomologyTree
from pirrht.steering.straight_line import StraightLine
from sim import cli, tree_file
from sim.scenario import Scenario, prepare


@pytest.fixture(scope="module")
def clutter() -> Scenario:
    return prepare("clutter", given={"vertices": 150})


@pytest.fixture(scope="module")
def saved(slit: Scenario) -> bytes:
    return packed(grown(slit, 200))


# -- round trip --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["slit", "clutter"])
def test_what_was_saved_answers_and_grows_on_as_if_it_had_never_been_written(name: str, request):
    scenario = request.getfixturevalue(name)
    tree = grown(scenario, 150)
    copy = again(tree)
    assert_equal_trees(tree, copy)
    assert_equal_references(tree, copy, scenario.start)
    for more in (151, 400):  # past the space for 256 vertices
        tree.grow(more)
        copy.grow(more)
        assert_equal_trees(tree, copy)
    assert_equal_references(tree, copy, scenario.start)


@pytest.mark.parametrize("bits", [np.random.PCG64DXSM, np.random.MT19937, np.random.Philox, np.random.SFC64])
def test_every_source_of_randomness_goes_on_where_it_was(slit: Scenario, bits):
    tree = HomologyTree(slit.space, StraightLine(), rng=np.random.Generator(bits(3)))
    tree.grow(20)
    tree.rng.integers(5, dtype=np.int32)  # half of a word is left over
    copy = again(tree)
    np.testing.assert_array_equal(
        tree.rng.integers(1000, size=9, dtype=np.int32), copy.rng.integers(1000, size=9, dtype=np.int32)
    )
    np.testing.assert_array_equal(tree.rng.random(5), copy.rng.random(5))


def test_equal_trees_are_equal_bytes_and_hold_no_pickles(slit: Scenario, saved: bytes):
    assert packed(grown(slit, 200)) == saved
    with np.load(BytesIO(saved), allow_pickle=False) as file:
        assert all(file[name].dtype != object for name in file.files)


def test_loading_asks_neither_for_the_start_nor_for_the_noise(slit: Scenario, saved: bytes):
    """Both may differ between the runs that share a tree."""
    moved = slit.space.with_task(start=np.array([2.0, 1.0, 0.0]))
    tree_file.load(BytesIO(saved), moved, StraightLine())


# -- command line ------------------------------------------------------------------------------------------------


def test_a_run_with_a_saved_tree_is_the_run_that_grows_it(tmp_path: Path, capsys):
    tree, one, other = tmp_path / "tree.npz", tmp_path / "1.json", tmp_path / "2.json"
    common = ["--seed", "3", "--samples", "20"]
    assert cli.main(["plan", "slit", *common, "--vertices", "150", "-o", str(tree)]) == 0
    assert f"tree: {tree}" in capsys.readouterr().out
    words = ["run", "slit", *common, "--max-time", "0.05", "--grow", "2", "--json"]
    assert cli.main([*words, str(one), "--vertices", "150"]) == 1
    assert cli.main([*words, str(other), "--tree", str(tree)]) == 1
    first, second = (json.loads(file.read_text()) for file in (one, other))
    for record in (first, second):
        del record["step_ms"], record["deadline_misses"]
    assert first == second
    assert cli.main(["estimate", "slit", "--at", "1", "2.5", "--tree", str(tree)]) == 0
    assert cli.main(["sweep", "slit", "--seeds", "0:2", "--max-time", "0.02", "--jobs", "1", "--tree", str(tree)]) == 0


@pytest.mark.parametrize(
    ("content", "arguments", "what"),
    [
        (None, [], "does not exist"),
        (b"not a tree", [], "is no tree"),
        ("saved", ["--limit", "0.7"], "limit is 0.6 there and 0.7 here"),
        ("saved", ["--vertices", "300"], "--vertices and --tree"),
    ],
)
def test_a_tree_that_does_not_fit_ends_with_one_line(saved, tmp_path: Path, capsys, content, arguments, what: str):
    file = tmp_path / "tree.npz"
    if content is not None:
        file.write_bytes(saved if content == "saved" else content)
    assert cli.main(["run", "slit", "--tree", str(file), *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert what in error
    assert len(error.splitlines()) == 1


def test_an_old_tree_stays_until_the_new_one_is_whole(slit: Scenario, saved: bytes, tmp_path: Path, monkeypatch):
    file = tmp_path / "tree.npz"
    file.write_bytes(saved)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OptionError, match="No space left"):
        tree_file.save(grown(slit, 20), file)
    assert file.read_bytes() == saved
    assert [p.name for p in tmp_path.iterdir()] == ["tree.npz"]
