"""Write classes down as (obstacle, turn) pairs, since most paths turn about a few of many obstacles."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.jit.jit import borrowing


class Turns(NamedTuple):
    """Whole turns of k curves; those of curve i are the pairs first[i] to first[i+1]."""

    first: NDArray[np.int64]  # (k+1,)
    marker: NDArray[np.int32]  # (pairs,) index in all signatures
    turn: NDArray[np.int16]  # (pairs,) [turns]

    def dense(self, i: int, M: int) -> NDArray[np.int64]:
        """The integers of curve i for all markers, (M,) [turns]."""
        part = slice(self.first[i], self.first[i + 1])
        return spread(self.marker[part], self.turn[part], M)


def spread(marker: NDArray[np.int32], turn: NDArray[np.int16], M: int) -> NDArray[np.int64]:
    """Pairs, 2 x (pairs,), as integers for all markers, (M,) [turns]."""
    whole = np.zeros(M, dtype=np.int64)
    np.add.at(whole, marker, turn)
    return whole


@borrowing
def summed(total, marker, turn, begin, count):  # type: ignore[no-untyped-def]
    """Sum pairs begin to count of one marker into one, in place, and drop zeros; the new count.

    Pairs are marker, turn (l,) [turns]; `total` (M,) are zeros, and zeros again afterwards.
    """
    for i in range(begin, count):
        total[marker[i]] += turn[i]
    kept = begin
    for i in range(begin, count):
        k = marker[i]
        if total[k] != 0:
            marker[kept], turn[kept] = k, total[k]
            total[k] = 0
            kept += 1
    return kept


@borrowing
def key_of_pairs(marker, turn, begin, count, weights):  # type: ignore[no-untyped-def]
    """Additive key of pairs begin to count of marker, turn (l,) [turns], by weights (M,)."""
    key = np.int64(0)
    for i in range(begin, count):
        key += turn[i] * weights[marker[i]]
    return key
