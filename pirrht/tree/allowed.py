"""The classes that the search may use, and what tells them: their whole turns around the markers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import njit, objmode

from pirrht.arrays import Array
from pirrht.compiled.addresses import load_float64, load_int16, load_int32, load_int64
from pirrht.compiled.jit import inlined, jitable, kernel
from pirrht.topology.turns import summed
from pirrht.tree.layout import NODE_PAIR_COUNT, node_at, vertex_at


@jitable
def within_limit(signature, limit):  # type: ignore[no-untyped-def]
    """The paper's allowed set: |1 - H_i| <= limit for every obstacle; the signature (M,) comes without the 1."""
    for k in range(signature.shape[0]):  # noqa: SIM110
        if abs(signature[k]) > limit:
            return False
    return True


@cache  # kernels are built once per predicate
def user_predicate(predicate: Callable[[Array], bool]) -> Callable[..., Any]:
    """Wrap any Python predicate on the paper's H (M,), leading 1 included, for use in the kernels."""

    @njit
    def allowed(signature, limit):  # type: ignore[no-untyped-def]
        with objmode(verdict="boolean"):
            verdict = bool(predicate(1.0 + signature))
        return verdict

    wrapped: Callable[..., Any] = allowed
    return wrapped


@inlined
def exceeds(at, v, source, slot, e, limit):  # type: ignore[no-untyped-def]
    """Whether the class that edge e makes of node `slot` of `source` breaks the limit around some marker at v.

    Most classes are refused here, before anything is written down.
    """
    straight, begin = at.straight + 8 * at.M * v, (source * at.K + slot) * at.C
    first, end = load_int64(at.edge_first, e), load_int64(at.edge_first, e + 1)
    count = load_int32(node_at(vertex_at(at, source), slot), NODE_PAIR_COUNT)
    for i in range(begin, begin + count):
        marker, total = load_int32(at.marker, i), np.int64(load_int16(at.turn, i))
        for j in range(first, end):
            if load_int32(at.edge_marker, j) == marker:
                total += load_int16(at.edge_turn, j)
        if total != 0 and abs(load_float64(straight, marker) + total) > limit:
            return True
    for j in range(first, end):
        marker, known = load_int32(at.edge_marker, j), False
        for i in range(begin, begin + count):
            known |= load_int32(at.marker, i) == marker
        if not known and abs(load_float64(straight, marker) + load_int16(at.edge_turn, j)) > limit:
            return True
    return False


@kernel
def joined(at, source, slot, edge_marker, edge_turn, first, end):  # type: ignore[no-untyped-def]
    """Pairs of node `slot` of vertex `source` and those of an edge, from `first` to `end` at two addresses, summed."""
    count, begin = load_int32(node_at(vertex_at(at, source), slot), NODE_PAIR_COUNT), (source * at.K + slot) * at.C
    most = count + end - first
    marker, turn = np.empty(most, np.int32), np.empty(most, np.int16)
    total = np.zeros(at.M, np.int16)
    for i in range(count):
        marker[i], turn[i] = load_int32(at.marker, begin + i), load_int16(at.turn, begin + i)
    for i in range(first, end):
        marker[count], turn[count] = load_int32(edge_marker, i), load_int16(edge_turn, i)
        count += 1
    return marker, turn, summed(total, marker, turn, 0, count)
