"""A tree file that does not belong, or is damaged, is refused with one line."""

from __future__ import annotations

import json
import zipfile
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from tree_files import grown, packed, repacked, unpacked, unsigned

import pirrht
from pirrht.errors import NoReference, OptionError
from pirrht.planner.chain import keys_of
from pirrht.planner.tree import HomologyTree
from pirrht.planner.tuning import TUNING
from pirrht.steering.straight_line import StraightLine
from pirrht.topology.crossings import Turns
from sim import tree_file
from sim.scenario import Scenario, prepare


@pytest.fixture(scope="module")
def saved(slit: Scenario) -> bytes:
    return packed(grown(slit, 200))


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"robot": "unicycle"}, "robot radius is 0.1 there"),
        ({"radius": 0.05}, "robot radius is 0.1 there and 0.05 here"),
        ({"goal": [5.0, 2.5, 0.2]}, r"goal is \[5.5, 2.5, .* there and \[5.0, 2.5, 0.2\] here"),
        ({"given": {"limit": 0.7}}, "limit is 0.6 there and 0.7 here"),
        ({"given": {"classes": 3}}, "classes is 16 there and 3 here"),
    ],
)
def test_a_tree_of_another_task_is_refused_by_what_differs(saved: bytes, tmp_path: Path, options, what: str):
    file = tmp_path / "tree.npz"
    file.write_bytes(saved)
    scenario = prepare("slit", **{**options, "given": {**options.get("given", {}), "tree": str(file)}})
    with pytest.raises(OptionError, match=what) as refusal:
        scenario.grown_tree()
    assert "\n" not in str(refusal.value)


def test_another_format_is_refused_by_name(slit: Scenario, saved: bytes):
    arrays = unpacked(saved)
    about = json.loads(str(arrays["about"])) | {"format": 99, "version": "7.0"}
    with pytest.raises(OptionError, match=rf"pirrht 7.0 in format 99; this is {pirrht.__version__}"):
        tree_file.load(repacked({**arrays, "about": np.array(json.dumps(about))}), slit.space, StraightLine())


def test_a_tree_without_a_checksum_opens_as_it_did(slit: Scenario, saved: bytes):
    tree = tree_file.load(repacked(unsigned(unpacked(saved))), slit.space, StraightLine())
    assert packed(tree) == saved


@pytest.mark.parametrize("content", [b"a text\n", b"", b"\x80\x04K\x01."])
def test_a_file_of_another_kind_is_refused_with_the_way_to_a_tree(slit: Scenario, tmp_path: Path, content: bytes):
    file = tmp_path / "bad.npz"
    file.write_bytes(content)
    with pytest.raises(OptionError, match=r"bad\.npz is no tree of pirrht; make one with `pirrht plan`$"):
        tree_file.load(file, slit.space, StraightLine())


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """With bits flipped, bytes replaced, a piece left out or doubled, or cut off."""
    kind, at, end = rng.integers(5), *np.sort(rng.integers(len(content), size=2)).tolist()
    if kind == 0:
        return content[:end]
    if kind == 1:
        return content[:at] + content[end:]
    if kind == 2:
        return content[:end] + content[at:]
    changed = bytearray(content)
    for place in rng.integers(len(content), size=int(rng.integers(1, 9))):
        changed[place] = rng.integers(256) if kind == 3 else changed[place] ^ 1 << int(rng.integers(8))
    return bytes(changed)


def answer(file: BytesIO, scenario: Scenario) -> tuple[HomologyTree | None, str]:
    """The tree in a file, or why it is refused."""
    try:
        return tree_file.load(file, scenario.space, StraightLine()), ""
    except OptionError as error:
        return None, str(error)


@pytest.mark.parametrize("packing", ["compressed", "plain", "unsigned"])
@pytest.mark.parametrize("part", range(4))
def test_a_damaged_file_is_refused_with_one_line_or_is_the_tree(slit: Scenario, saved: bytes, packing: str, part: int):
    """Or what was hit does not matter, such as a time stamp."""
    arrays = unsigned(unpacked(saved)) if packing == "unsigned" else unpacked(saved)
    whole = saved if packing == "compressed" else repacked(arrays).getvalue()
    rng = np.random.default_rng([part, len(packing)])
    refused = 0
    for _ in range(60):
        tree, said = answer(BytesIO(damaged(whole, rng)), slit)
        refused += tree is None
        assert tree is None or packed(tree) == saved
        assert "\n" not in said
    assert refused > 30


@pytest.mark.parametrize("part", range(4))
def test_a_tree_whose_sums_fit_a_wrong_number_is_refused_or_ends(slit: Scenario, saved: bytes, part: int):
    """Old trees have no checksum: what passes the zip's own sums is still a tree that answers and grows."""
    rng, refused = np.random.default_rng(part), 0
    for _ in range(40):
        arrays = unsigned(unpacked(saved))
        name = sorted(arrays.keys() - {"about"})[rng.integers(len(arrays) - 1)]
        raw = arrays[name].reshape(-1).view(np.uint8)
        raw[rng.integers(len(raw))] ^= 1 << int(rng.integers(8))
        tree, said = answer(repacked(arrays), slit)
        refused += tree is None
        assert "\n" not in said
        if tree is not None:
            tree.grow(tree.size + 5)
            with suppress(NoReference):
                assert tree.references(slit.start)
    assert refused > 10


def test_a_circle_among_parents_is_refused(slit: Scenario, saved: bytes):
    arrays = unsigned(unpacked(saved))
    below = int(np.argmax((arrays["parent"][:, 0] >= 0) & ~arrays["in_goal"][arrays["head"][arrays["parent"][:, 0]]]))
    edge = int(arrays["parent"][below, 0])
    above = int(arrays["head"][edge])
    back = int(np.flatnonzero((arrays["tail"] == above) & (arrays["head"] == below))[0])
    arrays["edge_cost"][[edge, back]] = 0.0
    arrays["cost"][below, 0] = arrays["cost"][above, 0]
    turns = Turns(arrays["edge_first"], arrays["edge_marker"], arrays["edge_turn"])
    key = keys_of(turns, slit.space.homology.hash_weights)[back]
    slot = int(np.flatnonzero(arrays["key"][above] == arrays["key"][below, 0] + key)[0])
    arrays["parent"][above, slot] = back
    with pytest.raises(OptionError, match="damaged tree"):
        tree_file.load(repacked(arrays), slit.space, StraightLine())


def test_what_is_declared_larger_than_the_file_can_be_is_not_made_room_for(slit: Scenario):
    """A header of 8 TB in front of 8 bytes."""
    header, bomb = BytesIO(), BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("cost.npy", header.getvalue() + bytes(8))
    with pytest.raises(OptionError, match="is no tree"):
        tree_file.load(bomb, slit.space, StraightLine())


def test_what_unpacks_to_more_than_a_tree_can_have_is_not_unpacked(slit: Scenario, monkeypatch):
    bomb = BytesIO()
    np.savez_compressed(bomb, cost=np.zeros(1 << 18))
    assert len(bomb.getvalue()) < 1 << 12
    assert not tree_file.read_arrays(bomb)["cost"].any()
    monkeypatch.setattr(tree_file, "TUNING", TUNING._replace(file_bytes=1 << 20))
    with pytest.raises(OptionError, match="is no tree of pirrht"):
        tree_file.load(bomb, slit.space, StraightLine())
    with pytest.raises(ValueError, match="it unpacks to"):
        tree_file.read_arrays(bomb)


def test_objects_are_not_unpickled(slit: Scenario, saved: bytes):
    arrays = unpacked(saved) | {"tail": np.array([print, None], dtype=object)}
    with pytest.raises(OptionError, match="is no tree"):
        tree_file.load(repacked(arrays), slit.space, StraightLine())
