"""Normal and uniform numbers that depend only on (seed, sample, draw), never on the number of threads.

Each sample owns a SplitMix64 sequence (Steele, Lea and Flood, OOPSLA 2014) that starts at a mix of seed and sample
index; normals come from a 256-layer ziggurat (Marsaglia and Tsang, J. Stat. Software 2000).
"""

from __future__ import annotations

import numpy as np

from pirrht.jit import inlined, kernel
from pirrht.scene import Array

LAYERS = 256
TAIL = 3.6541528853610088  # where the lowest layer ends and the tail begins
AREA = 0.00492867323399  # area of each layer
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
UNIT = 1.0 / 9007199254740992.0  # 2^-53


def _layers() -> tuple[Array, Array]:
    """Right ends of the layers, x[0] > x[1] > ... > x[256] = 0, and the density there."""
    x = np.zeros(LAYERS + 1)
    x[0] = AREA / np.exp(-0.5 * TAIL**2)
    x[1] = TAIL
    for i in range(2, LAYERS):
        x[i] = np.sqrt(-2.0 * np.log(AREA / x[i - 1] + np.exp(-0.5 * x[i - 1] ** 2)))
    return x, np.exp(-0.5 * x**2)


EDGE, DENSITY = _layers()


@inlined
def bits_of(z):  # type: ignore[no-untyped-def]
    """The 64 random bits that belong to a state of a sequence."""
    z = (z ^ (z >> np.uint64(30))) * MIX_1
    z = (z ^ (z >> np.uint64(27))) * MIX_2
    return z ^ (z >> np.uint64(31))


@kernel
def stream(seed, sample):  # type: ignore[no-untyped-def]
    """Start of the sequence of one sample."""
    return bits_of(np.uint64(seed) ^ bits_of((np.uint64(sample) + np.uint64(1)) * GOLDEN))


@inlined
def twin(sample, first, mirrored):  # type: ignore[no-untyped-def]
    """The sample whose sequence a sample follows, and the sign of its normals: antithetic pairs from `first` on."""
    second = mirrored and (sample - first) % 2 == 1
    return (sample - 1, -1.0) if second else (sample, 1.0)


@inlined
def candidate(state):  # type: ignore[no-untyped-def]
    """Layer, size and sign of the normal number that a state draws; it stands below the layer's inner edge."""
    bits = bits_of(state)
    layer = np.int64(bits & np.uint64(255))
    sign = 1.0 - 2.0 * np.float64((bits >> np.uint64(8)) & np.uint64(1))
    return layer, np.float64(bits >> np.uint64(11)) * UNIT * EDGE[layer], sign


@inlined
def uniform(state):  # type: ignore[no-untyped-def]
    """The next state of a sequence and a number in [0, 1)."""
    state = state + GOLDEN
    return state, np.float64(bits_of(state) >> np.uint64(11)) * UNIT


@kernel
def _slow_normal(state, layer, x):  # type: ignore[no-untyped-def]
    """The rare outcomes of a ziggurat draw: accepted (flag 1) in the wedge or the tail, or not (flag 0)."""
    state, u = uniform(state)
    if layer > 0:
        height = DENSITY[layer] + u * (DENSITY[layer + 1] - DENSITY[layer])
        return state, x, height < np.exp(-0.5 * x * x)
    while True:
        state, v = uniform(state)
        beyond = -np.log(1.0 - u) / TAIL
        if -2.0 * np.log(1.0 - v) > beyond * beyond:
            return state, TAIL + beyond, True
        state, u = uniform(state)


@inlined
def normal(state):  # type: ignore[no-untyped-def]
    """The next state of a sequence and a standard normal number."""
    while True:
        state = state + GOLDEN
        layer, x, sign = candidate(state)
        if x < EDGE[layer + 1]:
            return state, sign * x
        state, x, accepted = _slow_normal(state, layer, x)
        if accepted:
            return state, sign * x


@kernel
def normal_again(state):  # type: ignore[no-untyped-def]
    """What `normal` returns if the draw that led to this state was not accepted at once."""
    layer, x, sign = candidate(state)
    state, x, accepted = _slow_normal(state, layer, x)
    if accepted:
        return state, sign * x
    return normal(state)
