"""Hold inputs and outputs of compiled rollouts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.rollouts.tuning import TUNING

if TYPE_CHECKING:  # records hold what geometry and topology build, and need neither
    from pirrht.geometry.world import World
    from pirrht.rollouts.ways import DesirabilityTubes
    from pirrht.topology.crossings import Cuts
    from pirrht.topology.homology import Homology
    from pirrht.topology.moving_crossings import RayTable

FINER = TUNING.law_rows


def law_width(n: int, modes: int) -> int:
    """Numbers per row of the law of a system with n states, under noise of so many modes per step (`LawRows`)."""
    return modes + modes * n + n + 2 * modes * modes + 2 + n


class Setup(NamedTuple):
    """Scene and problem as rollouts need them."""

    world: World  # what is free at (x, t); moving obstacles are predicted on the clock of plans
    cuts: Cuts
    parameters: Array  # (k,) p of the dynamics
    gain: Array  # (m, m) B_c^-1 G_c, if constant; in input form s^-1
    inverse: Array  # (m, m) G_c^-1 B_c, if constant; in input form s
    diffusion: Array  # (rows, m) B_c, if constant
    rate: float  # q, if constant [cost/s]
    bridge: bool  # exit rule: along the step, or at its end
    least_rate: float  # least q / lambda [1/s]
    marks: RayTable  # of the steps of a guide among moving obstacles


class Snapshot(NamedTuple):
    """The world as a plan takes it: one value, shared by all that plan with it."""

    setup: Setup
    homology: Homology  # classes of paths, in space and time where obstacles move


@dataclass(slots=True)
class PredictedWorld:
    """Holder of the snapshot that sampler, proposals and guides share; one assignment replaces it for all of them."""

    snapshot: Snapshot

    @property
    def setup(self) -> Setup:
        """Scene and problem as rollouts need them."""
        return self.snapshot.setup

    @property
    def homology(self) -> Homology:
        """Classes of paths, in space and time where obstacles move."""
        return self.snapshot.homology

    @property
    def moving(self) -> bool:
        """Check for moving obstacles, J > 0."""
        return bool(self.setup.world.moving.J > 0)


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
    law: Array  # (H, T FINER, law_width): `LawRows`
    law_length: NDArray[np.int64]  # (H,) rows that the law has, then `Dynamics.homing`; 0: no law
    marks: RayTable  # moving markers by which classes of paths differ
    law_weight: float = (
        1.0  # share of a law that tells how the control changes near the start, where walls push besides
    )
    counted: float = 1.0  # share of it that counts as it is at the start in the control now


class LawRows(NamedTuple):
    """Rows of one proposal's law, R = T FINER of them, as views into `ProposalTables.law`.

    At a state x the noise of a step dt is drawn from N((a + K (x - x_ref)) dt, L L' dt) instead of N(0, I dt), where
    no noise acts on the position. Kernels evaluate this density for every path, whichever proposal has drawn it.
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
    def of(cls, tables: ProposalTables, h: int, n: int, modes: int) -> LawRows:
        """Return the rows of proposal h for a system of n states under noise of so many modes per step."""
        law = tables.law[h]
        shapes = (modes,), (n, modes), (n,), (modes, modes), (modes, modes), (), (), (n,)
        ends = np.cumsum([math.prod(shape) for shape in shapes])
        starts = np.concatenate([[0], ends[:-1]])
        rows = zip(starts, ends, shapes, strict=True)
        return cls(*(law[:, start:end].reshape(len(law), *shape) for start, end, shape in rows))


class Origin(NamedTuple):
    """Start of the samples of a batch: with its number, all that a path depends on."""

    x: Array  # (n,) state they start from
    seed: np.uint64
    time: float = 0.0  # when they do, on the clock of moving obstacles [s]


class Chosen(NamedTuple):
    """Samples that are simulated again, and what they count in which group."""

    number: NDArray[np.int64]  # (c,) from 0 to S
    group: NDArray[np.int64]  # (c,)
    weight: Array  # (c,)


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


def empty_paths(S: int, H: int, m: int) -> Paths:
    """Allocate S paths under H references: `Paths` of zeros, (S,), (S, H) and (S, m), [cost] and [s] as there."""
    return Paths(
        work=np.zeros(S), log_ratio=np.zeros((S, H)), key=np.zeros(S, np.int64), outcome=np.zeros(S, np.int8),
        steps=np.zeros(S, np.int32), now=np.zeros((S, m)), span=np.zeros(S), start_control=np.zeros((S, m)),
        log_survival=np.zeros(S),
    )  # fmt: skip


class Kernels(NamedTuple):
    """Compiled rollouts of one kind of dynamics; all take (setup, tables, origin) first."""

    sample: Callable[..., None]  # (.., start, stop, paths): fills Paths for a range of samples
    replay: Callable[..., None]  # (.., number, states, applied, steps): states, controls and steps of chosen samples
    alone: int  # one thread is done with fewer samples than this before another one is awake
