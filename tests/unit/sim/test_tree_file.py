"""A saved tree is the tree: it answers alike and grows on alike; any other file is refused with one line."""

import json
import zipfile
from contextlib import suppress
from io import BytesIO

import numpy as np
import pytest

import pirrht
from pirrht import HomologyTree, NoReference, OptionError, StraightLine
from sim import cli, tree_file
from sim.scenario import Scenario, prepare


def grown(scenario: Scenario, vertices: int) -> HomologyTree:
    return scenario.with_settings(vertices=vertices).grown_tree()


def packed(tree: HomologyTree) -> bytes:
    stream = BytesIO()
    tree_file.save(tree, stream)
    return stream.getvalue()


def read(content: bytes | BytesIO, scenario: Scenario) -> HomologyTree:
    return tree_file.load(
        BytesIO(content) if isinstance(content, bytes) else content, scenario.space, scenario.steering()
    )


def unpacked(content: bytes) -> dict[str, np.ndarray]:
    with np.load(BytesIO(content)) as file:
        return dict(file)


def repacked(arrays: dict[str, np.ndarray], **changes) -> BytesIO:
    """A file whose sums fit, whatever is in it."""
    stream, about = BytesIO(), json.loads(str(arrays["about"])) | changes
    np.savez(stream, **arrays | {"about": np.array(json.dumps(about))})
    stream.seek(0)
    return stream


def assert_equal(one: HomologyTree, other: HomologyTree, x: np.ndarray) -> None:
    """Of a tree and its copy all bytes, and what they answer at a state."""
    assert packed(one) == packed(other)
    assert len(one.references(x)) > 1
    for first, second in zip(one.references(x), other.references(x), strict=True):
        assert (first.winding, first.cost, first.length) == (second.winding, second.cost, second.length)
        for name in ("controls", "points"):
            np.testing.assert_array_equal(getattr(first.trajectory, name), getattr(second.trajectory, name))


@pytest.fixture(scope="module")
def saved(slit: Scenario) -> bytes:
    return packed(grown(slit, 200))


# -- round trip --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["slit", "clutter"])
def test_what_was_saved_answers_and_grows_on_as_if_it_had_never_been_written(name: str):
    scenario = prepare(name)
    tree = grown(scenario, 150)
    copy = read(packed(tree), scenario)
    assert_equal(tree, copy, scenario.start)
    for more in (151, 400):  # past the space for 256 vertices
        tree.grow(more)
        copy.grow(more)
        assert_equal(tree, copy, scenario.start)


@pytest.mark.slow
def test_roots_at_any_velocity_survive_and_nothing_else_is_left_open():
    scenario = prepare("slit", robot="hover", given={"vertices": 60})
    tree = scenario.grown_tree()
    copy, arrays = read(packed(tree), scenario), unpacked(packed(tree))
    assert np.isnan(copy.states[0, 2:]).all()
    assert_equal(tree, copy, scenario.start)
    for vertex, component in ((0, 0), (len(arrays["in_goal"]) - 1, 2)):
        states = arrays["states"].copy()
        states[vertex, component] = np.nan
        with pytest.raises(OptionError, match="states and costs are not numbers"):
            read(repacked({**arrays, "states": states}), scenario)


def test_equal_trees_are_equal_bytes_without_pickles_whatever_start_and_noise_are(slit: Scenario, saved: bytes):
    assert packed(grown(slit, 200)) == saved
    assert all(array.dtype != object for array in unpacked(saved).values())
    moved = slit.space.with_task(start=np.array([2.0, 1.0, 0.0]))
    old = repacked(unpacked(saved) | {"size": np.zeros(5)}, format=2, version="0.31.1", checksum="0")
    for file in (BytesIO(saved), old):
        assert packed(tree_file.load(file, moved, StraightLine())) == saved


def test_a_tree_with_another_source_of_randomness_is_not_saved(slit: Scenario):
    tree = HomologyTree(slit.space, StraightLine(), rng=np.random.Generator(np.random.MT19937(3)))
    with pytest.raises(OptionError, match="draws from MT19937"):
        packed(tree)


# -- command line ------------------------------------------------------------------------------------------------


def test_a_run_with_a_saved_tree_is_the_run_that_grows_it(tmp_path, capsys):
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
    assert (first["grow"], first["vertices"]) == (2, 150 + 4 * 2)
    assert cli.main(["estimate", "slit", "--at", "1", "2.5", "--tree", str(tree)]) == 0
    assert cli.main(["sweep", "slit", "--seeds", "0:2", "--max-time", "0.02", "--jobs", "1", "--tree", str(tree)]) == 0


@pytest.mark.parametrize(
    ("content", "arguments", "what"),
    [
        (None, "", "does not exist"),
        (b"not a tree", "", "is no tree of pirrht; make one with `pirrht plan`"),
        (b"", "", "is no tree of pirrht"),
        (b"\x80\x04K\x01.", "", "is no tree of pirrht"),
        ("saved", "--limit 0.7", "limit is 0.6 there and 0.7 here"),
        ("saved", "--classes 3", "classes is 16 there and 3 here"),
        ("saved", "--vertices 300", "--vertices and --tree"),
        ("saved", "--robot unicycle", "robot radius is 0.1 there"),
        ("saved", "--radius 0.05", "robot radius is 0.1 there and 0.05 here"),
        ("saved", "--goal 5 2.5 0.2", "there and [5.0, 2.5, 0.2] here"),
    ],
)
def test_a_tree_that_does_not_fit_ends_with_one_line(saved, tmp_path, refused, content, arguments, what: str):
    file = tmp_path / "tree.npz"
    if content is not None:
        file.write_bytes(saved if content == "saved" else content)
    refused(["run", "slit", "--tree", str(file), *arguments.split()], what)


# -- damage ------------------------------------------------------------------------------------------------------


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """With bits flipped, bytes replaced, a piece left out or doubled, or cut off."""
    kind, at, end = rng.integers(5), *np.sort(rng.integers(len(content), size=2)).tolist()
    if kind < 3:
        return (content[:end], content[:at] + content[end:], content[:end] + content[at:])[kind]
    changed = bytearray(content)
    for place in rng.integers(len(content), size=int(rng.integers(1, 9))):
        changed[place] = rng.integers(256) if kind == 3 else changed[place] ^ 1 << int(rng.integers(8))
    return bytes(changed)


def answer(file: bytes | BytesIO, scenario: Scenario) -> tuple[HomologyTree | None, str]:
    """The tree in a file, or why it is refused."""
    try:
        return read(file, scenario), ""
    except OptionError as error:
        return None, str(error)


@pytest.mark.parametrize("packing", ["compressed", "plain"])
def test_a_damaged_file_is_refused_with_one_line_or_is_the_tree(slit: Scenario, saved: bytes, packing: str):
    """Or what was hit does not matter, such as a time stamp."""
    whole = saved if packing == "compressed" else repacked(unpacked(saved)).getvalue()
    rng, refused = np.random.default_rng(len(packing)), 0
    for _ in range(240):
        tree, said = answer(damaged(whole, rng), slit)
        refused += tree is None
        assert tree is None or packed(tree) == saved
        assert "\n" not in said
    assert refused > 120


def test_a_tree_whose_sums_fit_a_wrong_number_is_refused_or_ends(slit: Scenario, saved: bytes):
    """What a hostile file has sums for is still a tree that answers and grows."""
    rng, refused = np.random.default_rng(0), 0
    for _ in range(160):
        arrays = unpacked(saved)
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
    assert refused > 40


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"format": 99, "version": "7.0"}, rf"pirrht 7.0 in format 99; this is {pirrht.__version__}"),
        ({"rng": {"bit_generator": "MT19937"}}, "damaged tree"),
        ({"draws": None}, "damaged tree"),
        ({"belongs": 3}, "grown for another task: workspace is None there"),
    ],
)
def test_a_record_that_is_none_is_refused(slit: Scenario, saved: bytes, changes, what: str):
    with pytest.raises(OptionError, match=what):
        read(repacked(unpacked(saved), **changes), slit)


def test_what_is_larger_than_a_tree_can_be_or_an_object_is_not_unpacked(slit: Scenario, saved: bytes, monkeypatch):
    header, declared = BytesIO(), BytesIO()  # 8 TB in front of 8 bytes
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(declared, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("cost.npy", header.getvalue() + bytes(8))
    for content in (header, declared, repacked(unpacked(saved) | {"tail": np.array([None], dtype=object)})):
        assert "is no tree of pirrht" in answer(content.getvalue(), slit)[1]
    assert answer(saved, slit)[0] is not None
    monkeypatch.setattr(tree_file, "MOST_BYTES", 1 << 10)
    assert "is no tree of pirrht" in answer(saved, slit)[1]
