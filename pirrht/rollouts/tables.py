"""Hold inputs and outputs of compiled rollouts, and read the tubes whose desirability samples climb.

A tube has cross-sections along a reference; their nodes know the slope of log psi of its class
(`proposals.desirability_tube`) and the lengths over which psi falls to zero towards the walls on both sides. Between
nodes and cross-sections these are interpolated; behind the last one psi is that of a disc in the open.
"""

import itertools
import math
from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.jit.jit import inlined, kernel, load_float32, part
from pirrht.jit.streams import HALF, ONE, ZERO
from pirrht.jit.vectors import blended
from pirrht.rollouts.tuning import TUNING

if TYPE_CHECKING:  # records hold what geometry and topology build, and need neither
    from pirrht.geometry.world import World
    from pirrht.topology.signature import Signature, Table

FINER = TUNING.law_rows


class Setup(NamedTuple):
    """Scene and problem as rollouts need them."""

    world: "World"  # what is free at (x, t); moving obstacles are predicted on the clock of plans
    parameters: Array  # (k,) p of the dynamics
    gain: Array  # (m, m) B_c^-1 G_c, if constant; in input form s^-1
    inverse: Array  # (m, m) G_c^-1 B_c, if constant; in input form s
    diffusion: Array  # (rows, m) B_c, if constant
    rate: float  # q, if constant [cost/s]
    bridge: bool  # exit rule: along the step, or at its end
    least_rate: float  # least q / lambda [1/s]


@dataclass(slots=True)
class PredictedWorld:
    """Holder of the snapshot that sampler, proposals and guides share; one assignment replaces it for all of them."""

    snapshot: "tuple[Setup, Signature]"

    @property
    def setup(self) -> Setup:
        """Scene and problem as rollouts need them."""
        return self.snapshot[0]

    @property
    def homology(self) -> "Signature":
        """Classes of paths, in space and time where obstacles move."""
        return self.snapshot[1]

    @property
    def moving(self) -> bool:
        """Check for moving obstacles, J > 0."""
        return bool(self.setup.world.moving.J > 0)


PLACE, KNOWN = 6, 4  # columns of cross-sections and of nodes (`DesirabilityTubes`)
NUMBERS = KNOWN + 2  # of `slope_of`


class DesirabilityTubes(NamedTuple):
    """Tubes around H references, of at most C cross-sections with J nodes each, as plain arrays for kernels."""

    count: NDArray[np.int64]  # type: ignore[assignment]  # (H,) cross-sections, the first at the start; 0: no tube
    # (H, C, 6): point on the reference [m], unit normal in the direction of travel, offset of the first node to the
    # left [m], nodes per meter [1/m]
    place: NDArray[np.float32]
    # In space nodes are points of a grid, J in a row; the first two rows of `place` have the first point [m], points
    # per meter [1/m] and the points along each axis.
    # (H, C, J, 4): grad log psi without the part of the walls [1/m]; reach of walls to the left and right [m]
    slope: NDArray[np.float32]
    decay: float  # k, of psi per meter in the open [1/m]


def no_tubes(H: int, C: int, J: int, decay: float) -> DesirabilityTubes:
    """Allocate H tubes of at most C cross-sections with J nodes, (H, C, 6) and (H, C, J, 4); none yet."""
    return DesirabilityTubes(
        np.zeros(H, np.int64), np.zeros((H, C, PLACE), np.float32), np.zeros((H, C, J, KNOWN), np.float32), decay
    )


class ProposalTables(NamedTuple):
    """Proposal controls around H references, one row each: a control sequence, a tube or a law; kernels read it."""

    control: Array  # (H, T, m) control sequences; zero for references with a tube or a law
    drift: Array  # (H, T, m) a = B_c^-1 G_c u, the same in noise units, where the gain is constant
    times: Array  # (T+1,) ends of the steps, from 0 [s]
    active: NDArray[np.int64]  # (H,) number of steps before a row of `control` is zero for good
    first: NDArray[np.int64]  # (H+1,) first sample drawn around each reference; the last entry is S
    ways: DesirabilityTubes  # whose desirability is climbed, instead of a control sequence
    wall_offset: float  # walls push within about this distance [m]; 0: they do not
    set_back: float  # how far behind walls psi vanishes, since exits are judged at the ends of steps only [m]
    least: float  # steps of the grid are split down to this near walls and goal [s]; infinite: they are not
    weighed: bool  # samples are weighed by the probability that they meet no wall within a step, not ended by it
    window: int  # leading steps over which the control now is averaged
    mirrored: bool  # the noise of every second sample is minus that of the one before it
    law: Array  # (H, T FINER, width): `LawRows`
    law_length: NDArray[np.int64]  # (H,) rows that the law has, then `Dynamics.homing`; 0: no law
    classes: "Table"  # of the signature of paths
    marks: Any  # `Signature.rays` of the steps, by which classes differ among moving obstacles
    law_weight: float = 1.0  # share of a law that tells how the control changes near the start, where walls push too


class LawRows(NamedTuple):
    """Rows of one proposal's law, R = T FINER of them, as views into `ProposalTables.law`.

    At a state x the noise of a step dt is drawn from N((a + K (x - x_ref)) dt, L L' dt) instead of N(0, I dt); L is
    left out where a step may end at a crossing (`rollouts.step.shapes_for`). Kernels evaluate this density for every
    path, whichever proposal has drawn it.
    """

    mean: Array  # (R, modes) a [1/sqrt(s)]
    gains: Array  # (R, n, modes) K'
    state: Array  # (R, n) x_ref
    deviation: Array  # (R, modes, modes) L'
    inverse: Array  # (R, modes, modes) L'^-1
    log_det: Array  # (R,) log det L
    steepest: Array  # (R,) greatest component of the mean [1/sqrt(s)]
    metric: Array  # (R, n) weights of squares that tell the nearest x_ref

    @classmethod
    def of(cls, tables: ProposalTables, h: int, n: int, modes: int) -> "LawRows":
        """Return the rows of proposal h for n states and so many modes per step; OptionError: there are no laws."""
        if tables.law.shape[2] == 0:
            raise OptionError(
                "samples of a point among static obstacles follow no law; write a control sequence or a tube"
            )

        law = tables.law[h]
        at = law_columns(n, modes)
        rows = zip(at[:-1], at[1:], law_shapes(n, modes), strict=True)
        return cls(*(law[:, start:end].reshape(len(law), *shape) for start, end, shape in rows))


LawColumns: Any = namedtuple("LawColumns", (*LawRows._fields, "width"))  # type: ignore[misc]


def law_shapes(n: int, modes: int) -> LawRows:
    """Return the shapes of `LawRows` in one row, for n states under noise of so many modes per step."""
    shapes: Any = (modes,), (n, modes), (n,), (modes, modes), (modes, modes), (), (), (n,)
    return LawRows._make(shapes)


def law_columns(n: int, modes: int) -> Any:
    """Return in which column of a law each of `LawRows` begins, and the `width` of a row, as fields."""
    return LawColumns(*itertools.accumulate(map(math.prod, law_shapes(n, modes)), initial=0))


class Origin(NamedTuple):
    """Start of the samples of a batch: with its number, all that a path depends on."""

    x: Array  # (n,) state they start from
    seed: np.uint64
    time: float = 0.0  # when they do, on the clock of moving obstacles [s]


class Paths(NamedTuple):
    """Results of S sampled paths; kernels write into it."""

    work: Array  # (S,) integral of q up to the exit [cost]
    log_ratio: Array  # (S, H) log dQ_g/dP of each path under each reference [nats]
    key: NDArray[np.int64]  # (S,) class of the path itself, as an additive key
    outcome: NDArray[np.int8]  # (S,) Outcome
    steps: NDArray[np.int32]  # (S,) steps taken, the exit's included
    now: Array  # (S, m) control now, integrated over the first `window` steps: noise, and the guide at the start
    span: Array  # (S,) time of these steps until the exit [s]
    start_control: Array  # (S, m) the proposal control at the start, without wall drift
    log_survival: Array  # (S,) log probability that no wall was met within the steps, where that is weighed [nats]
    exposure: Array  # (S,) chance that a path comes nearer to a wall than b times a small length, over it [1/sqrt(s)]


def empty_paths(S: int, H: int, m: int) -> Paths:
    """Allocate S paths under H references: `Paths` of zeros, (S,), (S, H) and (S, m), [cost] and [s] as there."""
    return Paths(
        work=np.zeros(S), log_ratio=np.zeros((S, H)), key=np.zeros(S, np.int64), outcome=np.zeros(S, np.int8),
        steps=np.zeros(S, np.int32), now=np.zeros((S, m)), span=np.zeros(S), start_control=np.zeros((S, m)),
        log_survival=np.zeros(S), exposure=np.zeros(S),
    )  # fmt: skip


class Kernels(NamedTuple):
    """Compiled rollouts of one kind of dynamics; all take (setup, tables, origin) first."""

    sample: Callable[..., None]  # (.., start, stop, paths): fills Paths for a range of samples
    replay: Callable[..., None]  # (.., number, states, applied, steps): states, controls and steps of chosen samples
    alone: int  # one thread is done with fewer samples than this before another one is awake


@inlined
def push_of(c, offset):  # type: ignore[no-untyped-def]
    """1 / (b (exp(c/b) - 1)) to third order [1/m]: the slope of log(1 - exp(-c/b)), psi near a wall of offset b."""
    s = c / (offset + np.float32(1e-9))
    third = np.float32(1.0 / 6.0)
    fourth = np.float32(1.0 / 24.0)

    return ONE / (c * (ONE + s * (HALF + s * (third + s * fourth))))


@inlined
def _passed(place, s, x, y):  # type: ignore[no-untyped-def]
    """Return how far (x, y) [m] has passed cross-section s [m]."""
    k = PLACE * s
    dx = x - load_float32(place, k)
    dy = y - load_float32(place, k + 1)

    return dx * load_float32(place, k + 2) + dy * load_float32(place, k + 3)


@inlined
def _nodes(place, s, x, y, J):  # type: ignore[no-untyped-def]
    """Return the number of the node before (x, y) [m] on cross-section s, and the share of the way to the next one."""
    k = PLACE * s
    dx = x - load_float32(place, k)
    dy = y - load_float32(place, k + 1)
    node = dy * load_float32(place, k + 2) - dx * load_float32(place, k + 3) - load_float32(place, k + 4)
    node = min(max(node * load_float32(place, k + 5), ZERO), np.float32(J - 1))
    j = min(np.int64(node), J - 2)
    return s * J + j, node - np.float32(j)


@inlined
def tube_of(tubes, g):  # type: ignore[no-untyped-def]
    """Return a tube as `tube_at` takes it: addresses of its sections and nodes, last section, and J."""
    _, C, J, _ = tubes.slope.shape
    place = tubes.place.ctypes.data + 4 * PLACE * g * C
    return place, tubes.slope.ctypes.data + 4 * KNOWN * g * C * J, tubes.count[g] - 1, J


@part
def tube_at(tube, s, decay, goal, x, y, out, at, each):  # type: ignore[no-untyped-def]
    """Write the NUMBERS of `slope_of` at (x, y) [m] to out[at + each * i]; return the cross-section passed.

    Args, in order: `tube_of`, the cross-section to search from, k [1/m] and the goal's centre [m], which count behind
        the last one, and the rest.
    """
    place, slope, last, J = tube
    # Neighbours on both sides are compared without a branch, which noise would make unpredictable.
    back = (s > 0) & (_passed(place, s, x, y) < ZERO)
    onward = (s < last) & (_passed(place, min(s + 1, last), x, y) >= ZERO)
    s += -1 if back else (1 if onward else 0)
    more = min(s + 1, last)
    ahead = -_passed(place, more, x, y)
    while (s < last) & (ahead <= ZERO):
        s, more = more, min(more + 1, last)
        ahead = -_passed(place, more, x, y)
    if s == last:
        dx = np.float32(goal[0]) - x
        dy = np.float32(goal[1]) - y
        per = ONE / math.sqrt(dx * dx + dy * dy + np.float32(1e-9))
        rate = (np.float32(decay) + HALF * per) * per
        reach = np.float32(TUNING.wall_reach / decay)

        out[at] = rate * dx
        out[at + each] = rate * dy
        out[at + 2 * each] = reach
        out[at + 3 * each] = reach

        out[at + 4 * each], out[at + 5 * each] = dx, dy
        return s
    past = _passed(place, s, x, y)
    along = min(max(past / (past + ahead + np.float32(1e-9)), ZERO), ONE)
    i, one = _nodes(place, s, x, y, J)
    j, other = _nodes(place, more, x, y, J)
    out[at], out[at + each], out[at + 2 * each], out[at + 3 * each] = blended(
        slope + 4 * KNOWN * i, slope + 4 * KNOWN * j, one, other, along
    )

    k = PLACE * more + 2
    out[at + 4 * each] = load_float32(place, k)
    out[at + 5 * each] = load_float32(place, k + 1)

    return s


@part
def slope_of(f, at, each, walls):  # type: ignore[no-untyped-def]
    """Return grad log psi [1/m] from the numbers f[at + each * i], without branches; single precision suffices.

    These are a row of `DesirabilityTubes.slope`, interpolated, and the direction of travel. walls: `two_walls`, none
    closer than they may push.
    """
    gx = f[at]
    gy = f[at + each]
    left = f[at + 2 * each]
    right = f[at + 3 * each]
    tx = f[at + 4 * each]
    ty = f[at + 5 * each]

    c, nx, ny, d, mx, my = walls
    first = nx * ty - ny * tx > ZERO  # the wall is to the left
    second = mx * ty - my * tx > ZERO
    near = left if first else right
    far = ZERO if first == second else (left if second else right)
    one = push_of(c, near)
    other = push_of(d, far)

    return gx + one * nx + other * mx, gy + one * ny + other * my


@kernel
def slope_along(tubes, g, goal, x, y, walls, out):  # type: ignore[no-untyped-def]
    """Write grad log psi [1/m] at (x, y) [m] in tube g to out (2,); goal's centre [m] and walls as of `slope_of`."""
    x, y = np.float32(x), np.float32(y)
    numbers = np.empty(NUMBERS, np.float32)
    tube_at(tube_of(tubes, g), 0, tubes.decay, goal, x, y, numbers, 0, 1)
    c, (nx, ny), d, (mx, my) = walls
    out[0], out[1] = slope_of(numbers, 0, 1, (c, nx, ny, d, mx, my))


@part
def grid_slope(tube, x, y, z):  # type: ignore[no-untyped-def]
    """Return grad log psi without wall drift [1/m] at a place in a grid in space [m], trilinear between points."""
    place, slope, _, _ = tube
    per = load_float32(place, 3)
    nx = np.int64(load_float32(place, PLACE))
    ny = np.int64(load_float32(place, PLACE + 1))
    nz = np.int64(load_float32(place, PLACE + 2))
    u = min(max(np.float32((x - load_float32(place, 0)) * per), ZERO), np.float32(nx - 1))
    v = min(max(np.float32((y - load_float32(place, 1)) * per), ZERO), np.float32(ny - 1))
    w = min(max(np.float32((z - load_float32(place, 2)) * per), ZERO), np.float32(nz - 1))
    i = min(np.int64(u), nx - 2)
    j = min(np.int64(v), ny - 2)
    k = min(np.int64(w), nz - 2)
    u -= np.float32(i)
    v -= np.float32(j)
    w -= np.float32(k)

    gx, gy, gz = ZERO, ZERO, ZERO
    for corner in range(8):
        a = corner >> 2
        b = corner >> 1 & 1
        c = corner & 1
        share = (u if a == 1 else ONE - u) * (v if b == 1 else ONE - v) * (w if c == 1 else ONE - w)
        at = slope + 4 * KNOWN * (((i + a) * ny + j + b) * nz + k + c)
        gx += share * load_float32(at, 0)
        gy += share * load_float32(at, 1)
        gz += share * load_float32(at, 2)
    return gx, gy, gz
