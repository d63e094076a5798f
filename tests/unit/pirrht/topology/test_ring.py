"""A second member of the interface of signatures: linking numbers with a ring, for a tree in space.

World and steering are doubles, since footprints are planar. Start and goal lie on one side of the
ring, so a path may pass it by, go through it and come back outside, or come back through it.
"""

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from pirrht import HomologyTree, NoReference, Steering
from pirrht.arrays import Array
from pirrht.geometry.space import BLOCKED, FREE
from pirrht.jit.jit import inlined, kernel
from pirrht.steering.motion import MotionKernels, MotionKind, Trajectory
from pirrht.topology.signature import Signature, SignatureKernels

SIDE, RADIUS = 4.0, 0.4
START, GOAL = np.array([0.8, 0.8, 2.0]), np.array([0.8, 3.2, 2.0])
RING = np.array([2.0, 2.0, 2.0])  # centre of a square ring in the plane x = 2
BEHIND = np.array([3.0, 2.0, 2.0])  # on the other side than start and goal
HOLE, WIDTH = 0.7, 0.25  # half of its opening, and half of the square of its bars


@kernel
def through(a, b, ring, half):
    """1 if the segment from a to b (3,) goes through the ring towards x, -1 if back."""
    if (a[0] > ring[0]) == (b[0] > ring[0]):
        return 0
    share = (ring[0] - a[0]) / (b[0] - a[0])
    y, z = a[1] + share * (b[1] - a[1]) - ring[1], a[2] + share * (b[2] - a[2]) - ring[2]
    if max(abs(y), abs(z)) > half:
        return 0
    return 1 if b[0] > a[0] else -1


@kernel
def _base(table, x, out):
    out[0] = through(x, table.goal, table.ring, table.half)


@kernel
def _turns(table, a, b, out):
    out[0] += through(a, b, table.ring, table.half)


@kernel
def _crossings(table, a, b, to_goal, marker, turn, count):
    whole = through(a, b, table.ring, table.half) + through(b, table.goal, table.ring, table.half)
    whole -= through(a, table.goal, table.ring, table.half)
    if whole != 0:
        marker[count], turn[count] = 0, whole
        count += 1
    return count


class Links(NamedTuple):
    goal: tuple[float, ...]
    ring: tuple[float, ...]
    half: float

    @property
    def kernels(self) -> SignatureKernels:
        return SignatureKernels(_base, _crossings, _turns)


LINKS = Links(tuple(GOAL.tolist()), tuple(RING.tolist()), HOLE + WIDTH)


class Ring(Signature):
    """Linking number with a ring: the base is the straight line to the goal, closed paths count passages."""

    markers, goal, table = RING[None], GOAL, LINKS
    most_base = 1.0

    def with_goal(self, goal: Array) -> "Ring":
        return self

    def with_moving(self, movers: Any, footprint: Any) -> "Ring":
        return self


class BoxWorld:
    """A cube of SIDE m with a square ring of four bars, for a point that goes to a ball."""

    def __init__(self) -> None:
        self.grain = None
        self.scene = SimpleNamespace(name="ring in space", goal=SimpleNamespace(center=GOAL, radius=RADIUS))
        bars = []
        for axis, sign in ((1, -1.0), (1, 1.0), (2, -1.0), (2, 1.0)):
            center, half = RING.copy(), np.full(3, HOLE + 2.0 * WIDTH)
            center[axis] += sign * (HOLE + WIDTH)
            half[0], half[axis] = WIDTH, WIDTH
            bars.append([center - half, center + half])
        self.boxes = np.array(bars)

    def free(self, x: Array, reads: tuple[int, ...] = (0, 1, 2)) -> bool:
        inside = np.all((self.boxes[:, 0] <= x) & (x <= self.boxes[:, 1]), axis=1)
        return bool(np.all((x >= 0.0) & (x <= SIDE)) and not inside.any())

    def in_goal(self, x: Array) -> bool:
        return bool(np.linalg.norm(x - GOAL) <= RADIUS)

    def passages(self) -> None:
        """There are none: all draws are uniform."""


class Surroundings(NamedTuple):
    boxes: Array  # (k, 2, 3)
    goal: Array  # (3,)
    links: Links
    weights: Any  # (1,)


class Segments(NamedTuple):
    """k straight segments, as `Motions`."""

    tails: Array  # (k, 3)
    heads: Array  # (k, 3)
    cost: Array  # (k,)

    def points(self, spacing: float) -> list[Array]:
        return [np.array(pair) for pair in zip(self.tails, self.heads, strict=True)]


@kernel
def _entry(motions, i, around):
    """Share of a segment after which it enters the ball, infinity if never."""
    a, b = motions.tails[i], motions.heads[i]
    d, f = b - a, a - around.goal
    A, B, C = np.dot(d, d), np.dot(f, d), np.dot(f, f) - RADIUS * RADIUS
    if C <= 0.0:
        return 0.0
    root = B * B - A * C
    if A == 0.0 or root < 0.0:
        return np.inf
    share = (-B - np.sqrt(root)) / A
    return share if 0.0 <= share <= 1.0 else np.inf


@inlined
def _between(motions, i, share, out):
    for k in range(3):
        out[k] = motions.tails[i, k] + share * (motions.heads[i, k] - motions.tails[i, k])
    return share <= 1.0


@kernel
def _cut(motions, i, share):
    _between(motions, i, share, motions.heads[i])
    motions.cost[i] *= share


@kernel
def _hits(a, b, box):
    low, high = 0.0, 1.0
    for k in range(3):
        d = b[k] - a[k]
        if abs(d) < 1e-12:
            if a[k] < box[0, k] or a[k] > box[1, k]:
                return False
            continue
        s, t = (box[0, k] - a[k]) / d, (box[1, k] - a[k]) / d
        low, high = max(low, min(s, t)), min(high, max(s, t))
    return low <= high


@kernel
def _certify(motions, i, around, patient):
    for j in range(around.boxes.shape[0]):
        if _hits(motions.tails[i], motions.heads[i], around.boxes[j]):
            return BLOCKED
    return FREE


@kernel
def _pairs(motions, i, around, to_goal, marker, turn, count):
    return _crossings(around.links, motions.tails[i], motions.heads[i], to_goal, marker, turn, count)


@kernel
def _most(motions):
    return 1


def _trajectory(steering: Any, path: Segments) -> Trajectory:
    length = np.linalg.norm(path.heads - path.tails, axis=1)
    velocity = (path.heads - path.tails) / np.maximum(length, 1e-300)[:, None]
    total = float(length.sum())
    return Trajectory(controls=velocity, durations=length, path=path, cost=float(path.cost.sum()), length=total)


KERNELS = MotionKernels(_entry, _cut, _certify, _pairs, _most, _between)
SEGMENTS = MotionKind(lambda around: KERNELS, lambda motions, i, space: True, _trajectory)


class StraightInSpace(Steering):
    """Straight lines at unit cost per meter."""

    n, symmetric, motion = 3, True, SEGMENTS

    def distance(self, tails: Array, heads: Array) -> Array:
        return np.linalg.norm(np.asarray(heads) - tails, axis=-1)

    def connect(self, tails: Array, heads: Array) -> Segments:
        tails, heads = np.array(np.atleast_2d(tails)), np.array(np.atleast_2d(heads))
        return Segments(tails, heads, self.distance(tails, heads))

    def sample(self, scene: Any, rng: np.random.Generator) -> Array:
        return rng.uniform(0.0, SIDE, 3)

    def draws(self, space, rng, count, origin=None, goal_share=0.0) -> Array:  # type: ignore[no-untyped-def]
        return rng.uniform(0.0, SIDE, (count, 3))

    def offers(self, passages: Any, space: Any, origin: Array | None = None) -> Array:
        return np.zeros((0, 3))

    def roots(self, goal: Array) -> Array:
        return goal[None]

    def homology(self, space: Any) -> Ring:
        return Ring()

    def reads(self, space: Any) -> tuple[int, ...]:
        return 0, 1, 2

    def surroundings(self, space: BoxWorld) -> Surroundings:
        return Surroundings(space.boxes, GOAL, LINKS, Ring().hash_weights)


@pytest.fixture(scope="module")
def tree() -> HomologyTree:
    found = HomologyTree(BoxWorld(), StraightInSpace(), limit=1.2, rng=np.random.default_rng(0))  # type: ignore[arg-type]
    found.grow(900)
    return found


def test_closed_paths_count_how_often_they_go_through_the_ring() -> None:
    ring, left, right, up = Ring(), RING - (BEHIND - RING), BEHIND, np.array([0.0, 0.0, 1.8])
    loop = np.array([left, right, right + up, left + up, left])
    assert ring.along(loop).tolist() == [1]
    assert ring.along(loop[::-1]).tolist() == [-1]
    assert ring.along(np.array([left, right, left])).tolist() == [0]
    assert ring.along(np.vstack([loop, loop[1:]])).tolist() == [2]
    assert ring.key((1,)) + ring.key((-1,)) == ring.key((0,)) == 0


def test_a_tree_in_space_finds_the_classes_on_both_sides_of_a_ring(tree: HomologyTree) -> None:
    references = tree.references(START, shortened=False)
    assert references[0].id == "0"
    assert {one.winding for one in references} == {(0,), (1,), (-1,)}
    ring = Ring()
    for one in references:
        points = np.vstack([one.path.tails, one.path.heads[-1:]])
        assert np.array_equal(points[0], START)
        assert np.linalg.norm(points[-1] - GOAL) == pytest.approx(RADIUS)
        assert tuple(ring.along(np.vstack([points, GOAL])).tolist()) == one.winding
        assert one.signature == pytest.approx(1.0 + ring.base(START) + one.winding)
        assert all(tree.space.free(a + s * (b - a)) for a, b in zip(points[:-1], points[1:], strict=True)
                   for s in np.linspace(0.0, 1.0, 50))  # fmt: skip
    assert references[0].cost <= references[1].cost <= references[2].cost


def test_a_limit_below_one_passage_leaves_the_ring_alone() -> None:
    one = HomologyTree(BoxWorld(), StraightInSpace(), limit=0.6, rng=np.random.default_rng(0))  # type: ignore[arg-type]
    with pytest.raises(NoReference):  # from behind the ring, the straight line leads through it
        one.references(BEHIND)
    one.grow(300)
    assert [reference.winding for reference in one.references(START, shortened=False)] == [(0,)]
