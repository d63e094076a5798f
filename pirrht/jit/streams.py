"""Random numbers of samples: normal and uniform ones, and first crossings of Brownian bridges.

They depend only on (seed, sample, draw), never on the number of threads. Each sample owns a SplitMix64 sequence
(Steele, Lea and Flood, OOPSLA 2014) that starts at a mix of seed and sample index. Of each 64 bits come two normals
(Box and Muller, Ann. Math. Stat. 1958), in single precision and without tables or branches, so that whole vectors of
them are drawn at once. It suffices: with 31 bits the radius stands for all but 2^-32 of the law, up to 6.66 deviations.

A bridge crosses a flat wall at distances c0 and c1 with probability exp(-2 c0 c1 / variance); the time of the first
crossing is then drawn exactly.

In a kernel a literal is double and makes all that meets it double, so constants of loops over lanes are named here.
"""

import math

import numpy as np

from pirrht.jit.jit import inlined, kernel

ZERO, HALF, ONE, TWO = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0))
GOLDEN, MIX_1, MIX_2 = (np.uint64(v) for v in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))
UNIT = 1.0 / 9007199254740992.0  # 2^-53

UPPER = np.uint64(32)
SIGN = np.uint32(0x80000000)
BIT = np.uint32(1)

# Of the uniforms that become radii:
STEP = np.float32(2.0**-31)
FIRST = np.float32(2.0**-32)
EIGHTH = np.float32(math.pi / 4.0 * 2.0**-31)  # of a turn, per bit of an angle

# Parts of a number's bits:
ROOT_HALF = np.uint32(0x3F3504F3)
MANTISSA = np.uint32(0x7FFFFF)
PLACES = np.int32(23)

LN_2 = np.float32(math.log(2.0))
# Series to their first term below 2^-24: the area tangent up to (1 - sqrt(1/2)) / (1 + sqrt(1/2)), turns up to pi/4.
A1, A2, A3, A4 = (np.float32(1.0 / (2 * k + 1)) for k in range(1, 5))
S1, S2, S3, S4 = (np.float32((-1.0) ** k / math.factorial(2 * k + 1)) for k in range(1, 5))
C1, C2, C3, C4 = (np.float32((-1.0) ** k / math.factorial(2 * k)) for k in range(1, 5))
FAR = 12.0  # exponents beyond this are taken as certain survival
CLOSEST = np.float32(0.3)  # deviations of a bridge, below which `exposure` takes distances as that
SIDEWAYS = 0.02  # share of noise along a line that counts as towards a wall next to it at least, since lines turn
MIN_VARIANCE = 1e-12  # variances are kept above this, where noise does not act towards a wall
LOWEST = np.float32(-87.0)
PER_LN_2 = np.float32(1.0 / math.log(2.0))

# Their sum is log 2 beyond single precision:
LN_2_HIGH = np.float32(0.693359375)
LN_2_LOW = np.float32(-2.12194440e-4)

E2, E3, E4, E5, E6 = (np.float32(1.0 / math.factorial(k)) for k in range(2, 7))
SHIFT = np.uint32(23)
BIAS = np.int32(127)


@inlined
def exponential(x):  # type: ignore[no-untyped-def]
    """exp(x) of a float32 x <= 0, float32, within 3e-7 of itself; exp(-87) stands for all below it."""
    x = max(x, LOWEST)
    n = np.int32(x * PER_LN_2 - HALF)  # towards zero: the nearest whole number
    r = (x - np.float32(n) * LN_2_HIGH) - np.float32(n) * LN_2_LOW
    series = ONE + r * (ONE + r * (E2 + r * (E3 + r * (E4 + r * (E5 + r * E6)))))
    return series * np.uint32(np.uint32(n + BIAS) << SHIFT).view(np.float32)


@inlined
def bits_of(z):  # type: ignore[no-untyped-def]
    """The 64 random bits, uint64, that belong to a state of a sequence, uint64."""
    z = (z ^ (z >> np.uint64(30))) * MIX_1
    z = (z ^ (z >> np.uint64(27))) * MIX_2
    return z ^ (z >> np.uint64(31))


@kernel
def stream(seed, sample):  # type: ignore[no-untyped-def]
    """Start of the sequence of one sample, the state uint64 that its first draw goes on from."""
    return bits_of(np.uint64(seed) ^ bits_of((np.uint64(sample) + np.uint64(1)) * GOLDEN))


@inlined
def antithetic(sample, first, mirrored):  # type: ignore[no-untyped-def]
    """The sample whose sequence a sample follows, and the sign of its normals: antithetic pairs from `first` on."""
    return (sample - 1, -1.0) if mirrored and (sample - first) % 2 == 1 else (sample, 1.0)


@inlined
def halves(state):  # type: ignore[no-untyped-def]
    """The random bits of a state, uint64, as two numbers of 32, uint32, the high ones first."""
    bits = bits_of(state)
    return np.uint32(bits >> UPPER), np.uint32(bits)


@inlined
def logarithm(u):  # type: ignore[no-untyped-def]
    """Natural logarithm of a positive normal float32, float32 [nats]."""
    bits = np.uint32(np.float32(u).view(np.uint32) - ROOT_HALF)
    exponent = np.float32(np.int32(bits) >> PLACES)
    m = np.uint32((bits & MANTISSA) + ROOT_HALF).view(np.float32)  # within a factor sqrt(2) of 1
    s = (m - ONE) / (m + ONE)
    w = s * s
    return exponent * LN_2 + TWO * s * (ONE + w * (A1 + w * (A2 + w * (A3 + w * A4))))


@inlined
def normals_of(high, low):  # type: ignore[no-untyped-def]
    """Two independent standard normal numbers, float32, from two times 32 random bits, uint32."""
    u = np.float32(np.int32(high >> BIT)) * STEP + FIRST
    radius = math.sqrt(-TWO * logarithm(u))
    angle = np.float32(np.int32(low << np.uint32(2))) * EIGHTH  # within an eighth of a turn of one of four axes
    w = angle * angle
    across = angle * (ONE + w * (S1 + w * (S2 + w * (S3 + w * S4))))
    along = ONE + w * (C1 + w * (C2 + w * (C3 + w * C4)))
    along = np.uint32(np.float32(along).view(np.uint32) | (low & SIGN)).view(np.float32)
    upright = (low & (SIGN >> BIT)) != 0
    return radius * (across if upright else along), radius * (along if upright else across)


@inlined
def normals(state):  # type: ignore[no-untyped-def]
    """The next state of a sequence and two independent standard normal numbers, float32."""
    state = state + GOLDEN
    high, low = halves(state)
    one, other = normals_of(high, low)
    return state, one, other


@inlined
def fill_normals(state, count, out):  # type: ignore[no-untyped-def]
    """The next state after as many calls of `normals`, drawn many abreast and written to out (2 count,) or more."""
    for k in range(count):
        high, low = halves(state + GOLDEN * np.uint64(k + 1))
        out[2 * k], out[2 * k + 1] = normals_of(high, low)
    return state + GOLDEN * np.uint64(count)


@inlined
def uniform(state):  # type: ignore[no-untyped-def]
    """The next state of a sequence and a uniform number in [0, 1), float64."""
    state = state + GOLDEN
    return state, np.float64(bits_of(state) >> np.uint64(11)) * UNIT


@kernel
def first_crossing(c0, c1, deviation, state):  # type: ignore[no-untyped-def]
    """Draw the share of the step at which a bridge from distance c0 > 0 to c1 [m] first meets the wall, if it does.

    In the clock s = t / (1 - t) the bridge is a Brownian motion with drift, so s is inverse Gaussian (drawn as by
    Michael, Schucany and Haas, The American Statistician 1976); c1 < 0 counts as its mirror image. The deviation [m]
    is that of the whole step. Returns: next state of the sequence, share.
    """
    shape = (c0 / deviation) ** 2
    state, z, _ = normals(state)
    state, u = uniform(state)
    slope = abs(c1) / c0  # one over the mean of s
    half = 0.5 * z * z / shape
    s = 1.0 / (slope + half + math.sqrt(half * (half + 2.0 * slope)))
    if slope > 0.0 and u * (1.0 + slope * s) > 1.0:
        s = 1.0 / (slope * slope * s)
    return state, s / (1.0 + s)


@inlined
def survival(c0, c1, variance):  # type: ignore[no-untyped-def]
    """Return the probability that a bridge between two positive distances misses the wall."""
    if c1 <= 0.0:
        return 0.0
    exponent = 2.0 * c0 * c1 / variance
    return 1.0 if exponent > FAR else 1.0 - math.exp(-exponent)


@inlined
def exposure(c0, c1, deviation, span):  # type: ignore[no-untyped-def]
    """Return how fast the chance grows that a bridge which misses a wall comes within b s of it, s being small.

    Args: distances from the wall before and after [m], float32; b, the deviation of a second [m/sqrt(s)]; its time [s].
    Returns: 2 (c0 + c1) / (b span) / (exp(2 c0 c1 / (b^2 span)) - 1) [1/sqrt(s)]. Ends closer to the wall than
        a part of the bridge's deviation count as that close: this takes off little of the mean, and all of its tail.
    """
    spread = deviation * math.sqrt(span)
    least = CLOSEST * spread
    near = max(c0, least) / spread
    far = max(c1, least) / spread

    if TWO * near * far > FAR:
        return ZERO
    missed = exponential(-TWO * near * far)
    return TWO * (near + far) * missed / ((ONE - missed) * math.sqrt(span))
