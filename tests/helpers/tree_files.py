"""Trees as bytes: made, taken apart and compared."""

from __future__ import annotations

import json
from io import BytesIO

import numpy as np

from pirrht.arrays import Array
from pirrht.planner.graph import class_at
from pirrht.planner.tree import HomologyTree
from sim import tree_file
from sim.scenario import Scenario

COUNTED = ("straight", "tail", "head", "first_out", "first_in", "next_out", "next_in", "edge_cost", "edge_key")


def grown(scenario: Scenario, vertices: int, **settings) -> HomologyTree:
    return scenario.with_settings(vertices=vertices, **settings).grown_tree()


def packed(tree: HomologyTree) -> bytes:
    stream = BytesIO()
    tree_file.save(tree, stream)
    return stream.getvalue()


def again(tree: HomologyTree) -> HomologyTree:
    return tree_file.load(BytesIO(packed(tree)), tree.space, tree.steering)


def unpacked(content: bytes) -> dict[str, np.ndarray]:
    with np.load(BytesIO(content)) as file:
        return {name: file[name] for name in file.files}


def unsigned(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays as version 0.2 wrote them, without a checksum and with more arrays."""
    about = {**json.loads(str(arrays["about"])), "format": 1, "version": "0.2.0"}
    del about["checksum"]
    return {**arrays, "about": np.array(json.dumps(about)), "size": np.zeros(5)}


def repacked(arrays: dict[str, np.ndarray]) -> BytesIO:
    stream = BytesIO()
    np.savez(stream, **arrays)
    stream.seek(0)
    return stream


def assert_equal_trees(one: HomologyTree, other: HomologyTree) -> None:
    assert one.size == other.size
    assert (one.draws, one.limit, one.classes) == (other.draws, other.limit, other.classes)
    assert one.rng.bit_generator.state == other.rng.bit_generator.state
    np.testing.assert_array_equal(one.graph.size, other.graph.size)
    np.testing.assert_array_equal(one.graph.pruned, other.graph.pruned)
    np.testing.assert_array_equal(one.graph.nodes[: one.size], other.graph.nodes[: one.size])
    V, E = one.size, int(one.graph.size[1])
    np.testing.assert_array_equal(one.states[:V], other.states[:V])
    np.testing.assert_array_equal(one.in_goal[:V], other.in_goal[:V])
    for name in COUNTED:
        count = V if name in ("straight", "first_out", "first_in") else E
        np.testing.assert_array_equal(getattr(one.graph, name)[:count], getattr(other.graph, name)[:count], name)
    for v in range(V):
        for slot in range(one.graph.nodes[v]):
            for name in ("cost", "key", "parent", "pairs"):
                assert getattr(one.graph, name)[v, slot] == getattr(other.graph, name)[v, slot]
            assert np.array_equal(class_at(one.graph, v, slot), class_at(other.graph, v, slot))


def assert_equal_references(one: HomologyTree, other: HomologyTree, x: Array) -> None:
    for first, second in zip(one.references(x), other.references(x), strict=True):
        assert first.winding == second.winding
        assert (first.cost, first.length) == (second.cost, second.length)
        np.testing.assert_array_equal(first.signature, second.signature)
        np.testing.assert_array_equal(first.trajectory.controls, second.trajectory.controls)
        np.testing.assert_array_equal(first.trajectory.points, second.trajectory.points)
