"""Check the arrays of a tree's file: kernels follow indices without looking twice.

A few kilobytes of zeros unpack to gigabytes, so sizes are examined first. Then arrays are checked to be a relaxed tree:
a circle among parents would have no end.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from pirrht.planner import graph as g
from pirrht.planner.tuning import TUNING
from pirrht.topology.signature import Signature

Arrays = dict[str, np.ndarray[Any, Any]]

BROKEN = (zipfile.BadZipFile, zlib.error, EOFError)


def read_arrays(stream: BinaryIO) -> Arrays:
    """Read the arrays of an npz file by name.

    Raises:
        OSError, zipfile.BadZipFile, zlib.error, EOFError: it cannot be read, or is not as it was written.
        ValueError, RuntimeError, MemoryError: it is a file of another kind, or declares more than a tree has.
    """
    if not zipfile.is_zipfile(stream):
        raise ValueError("it is no zip file")
    with zipfile.ZipFile(stream) as archive:
        total = sum(member.file_size for member in archive.infolist())  # more is not unpacked
    if total > TUNING.file_bytes:
        raise ValueError(f"it unpacks to {total / 2**30:.3g} GB, and a tree has {TUNING.file_bytes / 2**30:g} at most")
    stream.seek(0)
    with np.load(stream, allow_pickle=False) as content:
        return dict(content)


def checksum(arrays: Mapping[str, np.ndarray[Any, Any]], about: Mapping[str, Any]) -> str:
    """SHA-256 of arrays, their names, kinds and shapes, and of a JSON record next to them."""
    known = hashlib.sha256(json.dumps(about, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        known.update(f"\0{name}\0{array.dtype.str}\0{array.shape}\0".encode())
        known.update(array.tobytes())
    return known.hexdigest()


def check(arrays: Arrays, homology: Signature, left_open: NDArray[np.bool_], classes: int) -> None:
    """Refuse arrays that are no settled tree in this space.

    Args:
        arrays: those of a `Graph` less its queues, `states` (V, n) and `in_goal` (V,).
        left_open: which numbers of a state roots may leave open, as not a number, (n,).
        classes: the most classes of a vertex, 0 for all.

    Raises:
        ValueError, KeyError: names the array, or says what does not fit together.
    """
    _check_shapes(arrays, homology.M, len(left_open), classes)
    _check_ranges(arrays, homology.M)
    _check_numbers(arrays, left_open)
    for first, following, end in (("first_out", "next_out", "tail"), ("first_in", "next_in", "head")):
        _check_lists(arrays[first], arrays[following], arrays[end])
    _check_classes(arrays, homology)
    _check_parents(arrays)


def _check_shapes(arrays: Arrays, M: int, n: int, classes: int) -> None:
    size = arrays["size"]
    if size.shape != (5,) or size.dtype != np.int64:
        raise ValueError("size is not what it should be")
    V, E, waiting, refill, P = (int(v) for v in size)
    if arrays["marker"].ndim != 3:
        raise ValueError("marker is not what it should be")
    K, C = arrays["marker"].shape[1:]
    if V < 1 or min(E, P) < 0 or K < 1 or classes not in (0, K) or (waiting, refill) != (0, 0):
        raise ValueError("its sizes are not possible")
    model = g.empty_graph(1, 1, 1, M)
    shapes = {name: (V, K, C)[: np.ndim(getattr(model, name))] for name in g.NODES}
    shapes |= dict.fromkeys(g.EDGES, (E,)) | dict.fromkeys(g.EDGE_PAIRS, (P,))
    shapes |= dict.fromkeys(("first_out", "first_in", "nodes", "in_goal"), (V,))
    shapes |= {"straight": (V, M), "edge_first": (E + 1,), "pruned": (1,), "states": (V, n)}
    kinds = {name: getattr(model, name).dtype for name in shapes if hasattr(model, name)}
    kinds |= {"states": np.dtype(np.float64), "in_goal": np.dtype(np.bool_)}
    if arrays.keys() - shapes.keys() != {"size"}:
        raise ValueError("it holds what no tree has")
    for name, shape in shapes.items():
        array = arrays[name]
        if array.shape != shape or array.dtype != kinds[name]:
            raise ValueError(f"{name} has the shape {array.shape} of {array.dtype}")


def _known(arrays: Arrays) -> NDArray[np.bool_]:
    """Mask of the nodes (V, K) that exist."""
    known: NDArray[np.bool_] = np.arange(arrays["cost"].shape[1]) < arrays["nodes"][:, None]
    return known


def _paired(arrays: Arrays) -> NDArray[np.bool_]:
    """Mask of the pairs (V, K, C) that exist."""
    paired: NDArray[np.bool_] = np.arange(arrays["marker"].shape[2]) < arrays["pairs"][:, :, None]
    return paired & _known(arrays)[:, :, None]


def _check_ranges(arrays: Arrays, M: int) -> None:
    V, E, _, _, P = (int(v) for v in arrays["size"])
    K, C = arrays["marker"].shape[1:]
    if np.any((arrays["nodes"] < 0) | (arrays["nodes"] > K)):
        raise ValueError("nodes points out of its range")
    known = _known(arrays)
    if np.any((arrays["pairs"][known] < 0) | (arrays["pairs"][known] > C)):
        raise ValueError("pairs points out of its range")
    ranges: dict[str, tuple[NDArray[Any], int, int]] = {
        **{name: (arrays[name], 0, V) for name in ("tail", "head")},
        **{name: (arrays[name], -1, E) for name in ("first_out", "first_in", "next_out", "next_in")},
        "parent": (arrays["parent"][known], -1, E),
        "marker": (arrays["marker"][_paired(arrays)], 0, M),
        "edge_marker": (arrays["edge_marker"], 0, M),
        "edge_first": (np.diff(arrays["edge_first"]), 0, P + 1),
        "pruned": (arrays["pruned"], 0, np.iinfo(np.int64).max),
    }
    for name, (values, low, high) in ranges.items():
        if np.any((values < low) | (values >= high)):
            raise ValueError(f"{name} points out of its range")
    if arrays["edge_first"][0] != 0 or arrays["edge_first"][-1] != P:
        raise ValueError("edge_first and its pairs do not fit together")


def _check_numbers(arrays: Arrays, left_open: NDArray[np.bool_]) -> None:
    states = np.where(np.isnan(arrays["states"]) & arrays["in_goal"][:, None] & left_open, 0.0, arrays["states"])
    for name, numbers in (("states", states), *((name, arrays[name]) for name in ("straight", "edge_cost"))):
        if not np.all(np.isfinite(numbers)):
            raise ValueError(f"{name} is not finite")
    if np.any(arrays["edge_cost"] < 0.0) or not np.all(arrays["cost"][_known(arrays)] >= 0.0):
        raise ValueError("a cost is negative")


def _check_lists(first: NDArray[Any], following: NDArray[Any], end: NDArray[Any]) -> None:
    """The edges of a vertex are a chain from its newest (V,) to its oldest: each later than its `following` (E,)."""
    newest, edges = np.flatnonzero(first >= 0), np.flatnonzero(following >= 0)
    reached = np.concatenate([first[newest], following[edges]])
    belongs = np.concatenate([newest, end[edges]])
    if np.any(following >= np.arange(len(following))) or np.any(end[reached] != belongs):
        raise ValueError("its chains of edges do not fit together")
    if np.any(np.bincount(reached, minlength=len(following)) != 1):
        raise ValueError("its chains of edges leave some out")


def _check_classes(arrays: Arrays, homology: Signature) -> None:
    """Keys are those of the pairs, of edges and of nodes."""
    weights, first = homology.hash_weights, arrays["edge_first"]
    with np.errstate(over="ignore"):
        terms = arrays["edge_turn"].astype(np.int64) * weights[arrays["edge_marker"]]
        sums = np.concatenate([np.zeros(1, np.int64), np.cumsum(terms, dtype=np.int64)])
        edges = sums[first[1:]] - sums[first[:-1]]
        paired, terms = _paired(arrays), np.zeros(arrays["marker"].shape, np.int64)
        terms[paired] = arrays["turn"][paired].astype(np.int64) * weights[arrays["marker"][paired]]
        nodes = terms.sum(axis=2, dtype=np.int64)
    known = _known(arrays)
    if np.any(edges != arrays["edge_key"]) or np.any(nodes[known] != arrays["key"][known]):
        raise ValueError("its classes and their keys do not fit together")
    keys = np.where(known, arrays["key"], 0)
    order = np.argsort(keys, axis=1, kind="stable")
    keys, known = np.take_along_axis(keys, order, 1), np.take_along_axis(known, order, 1)
    if np.any((keys[:, 1:] == keys[:, :-1]) & known[:, 1:] & known[:, :-1]):
        raise ValueError("a class is there twice")


def _check_parents(arrays: Arrays) -> None:
    """Every node costs its parent plus its edge, and roots are in the goal."""
    vertex, slot = np.nonzero(_known(arrays))
    K, edge, cost = arrays["cost"].shape[1], arrays["parent"][vertex, slot], arrays["cost"][vertex, slot]
    root = edge == g.ROOT
    if np.any(root != arrays["in_goal"][vertex]) or np.any(cost[root] != 0.0):
        raise ValueError("its roots and the goal do not fit together")
    vertex, slot, edge, cost = vertex[~root], slot[~root], edge[~root], cost[~root]
    head = arrays["head"][edge]
    with np.errstate(over="ignore"):
        key = arrays["key"][vertex, slot] - arrays["edge_key"][edge]
    matches = (arrays["key"][head] == key[:, None]) & _known(arrays)[head]
    if np.any(arrays["tail"][edge] != vertex) or not np.all(matches.any(axis=1)):
        raise ValueError("a parent is missing")
    above = matches.argmax(axis=1)
    expected = arrays["cost"][head, above] + arrays["edge_cost"][edge]
    if not np.all(np.abs(cost - expected) <= TUNING.cost_rounding * (1.0 + expected)):
        raise ValueError("its costs and parents do not fit together")
    _check_ends(vertex * K + slot, head * K + above, arrays["cost"].size)


def _check_ends(node: NDArray[np.int64], parent: NDArray[np.int64], count: int) -> None:
    """From every node its parents, `parent` (k,) of `node` (k,) among so many, lead to a root."""
    above = np.arange(count)
    above[node] = parent
    for _ in range(count.bit_length()):  # twice as far each time
        above = above[above]
    if np.any(np.isin(above[node], node)):
        raise ValueError("a circle among its parents")
