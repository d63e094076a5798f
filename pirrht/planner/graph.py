"""The graph on the state space and the tree that it projects into the H-augmented space, as arrays and as memory.

Every vertex keeps its K cheapest allowed classes ("nodes"). A node stores its class, its cost and the edge to its
parent; the parent's class follows from the edge. Classes and edges keep their integers as (marker, turn) pairs, of
which there are few.

Searches must neither count references to arrays nor wait for memory, so they read and write by address.
What a search needs of an edge, or of a vertex and its first nodes, lies together in a record: it asks for them at
random, and whatever lies apart is fetched apart. The dtypes say where in a record a field lies; kernels read there.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.jit.jit import inlined, load_int32, load_int64
from pirrht.planner.tuning import TUNING
from pirrht.topology.pairs import spread

ROOT = -1  # in place of the edge to a parent


class Status(NamedTuple):
    """Answers of kernels: done, or what they need first."""

    done: int = 0
    nodes_full: int = 1  # these three must be given more room before costs are right
    queue_full: int = 2
    pairs_full: int = 3
    new: int = 4  # a node has been added
    ask: int = 5  # the next draw takes FCL or more room


class Size(NamedTuple):
    """Entries of `Graph.size`."""

    vertices: int = 0
    edges: int = 1
    queue: int = 2
    refill: int = 3
    pairs: int = 4


STATUS = Status()
SIZE = Size()


class Vertices(NamedTuple):
    """States of vertices, with room to grow."""

    states: Array  # (V, n), x and y first [m]
    in_goal: NDArray[np.bool_]  # (V,) whether it is a root: it lies in the goal


class Graph(NamedTuple):
    """Plain arrays with room to grow; the first `size` entries count. Kernels change them in place."""

    size: NDArray[np.int64]  # (5,) vertices, edges, queue entries, vertices to refill, pairs of edges
    pruned: NDArray[np.int64]  # (1,) classes refused or dropped because K cheaper ones were known
    states: Array  # (V, n) as `Vertices`
    in_goal: NDArray[np.bool_]  # (V,)
    straight: Array  # (V, M) H of the straight line to the goal point [turns]
    first_out: NDArray[np.int32]  # (V,) first edge that leaves a vertex, -1 if none
    first_in: NDArray[np.int32]  # (V,) first edge that enters it
    tail: NDArray[np.int32]  # (E,) vertices an edge leads from and to
    head: NDArray[np.int32]  # (E,)
    next_out: NDArray[np.int32]  # (E,) next edge with the same tail, and with the same head
    next_in: NDArray[np.int32]  # (E,)
    edge_cost: Array  # (E,) [cost]
    edge_first: NDArray[np.int64]  # (E+1,) first pair of each edge: whole turns that prepending it adds
    edge_marker: NDArray[np.int32]  # (P,)
    edge_turn: NDArray[np.int16]  # (P,) [turns]
    edge_key: NDArray[np.int64]  # (E,) those turns as an additive key
    nodes: NDArray[np.int32]  # (V,) number of nodes at a vertex
    cost: Array  # (V, K) to the goal [cost]
    key: NDArray[np.int64]  # (V, K) additive key of the class
    pairs: NDArray[np.int32]  # (V, K) number of pairs of the class itself
    marker: NDArray[np.int32]  # (V, K, C)
    turn: NDArray[np.int16]  # (V, K, C) [turns]
    parent: NDArray[np.int32]  # (V, K) edge to the parent, ROOT at a root
    queue_cost: Array  # (Q,) binary heap of nodes to propagate [cost]
    queue_vertex: NDArray[np.int32]  # (Q,)
    queue_key: NDArray[np.int64]  # (Q,)
    refill: NDArray[np.int32]  # (V,) vertices that lost nodes and must ask their successors again
    waiting: NDArray[np.bool_]  # (V,) whether a vertex is in that list


VERTEX = np.dtype([("nodes", "i4"), ("first_out", "i4"), ("first_in", "i4"), ("spare", "i4")])  # its nodes after
EDGE = np.dtype(
    [("next_in", "i4"), ("tail", "i4"), ("edge_cost", "f8"), ("edge_key", "i8"), ("next_out", "i4"), ("head", "i4")]
)
NODE = np.dtype([("cost", "f8"), ("key", "i8"), ("parent", "i4"), ("pairs", "i4")])


def _index(record: np.dtype[np.void], *names: str) -> tuple[int, ...]:
    """Offsets of fields of a record, counted in fields of their own size."""
    fields = record.fields
    assert fields is not None
    return tuple(fields[name][1] // fields[name][0].itemsize for name in names)


COUNT, FIRST_OUT, FIRST_IN = _index(VERTEX, "nodes", "first_out", "first_in")
NEXT_IN, TAIL, NEXT_OUT, HEAD = _index(EDGE, "next_in", "tail", "next_out", "head")
EDGE_COST, EDGE_KEY = _index(EDGE, "edge_cost", "edge_key")
COST, KEY, PARENT, NODE_PAIR_COUNT = _index(NODE, "cost", "key", "parent", "pairs")
VERTEX_BYTES, EDGE_BYTES, NODE_BYTES = VERTEX.itemsize, EDGE.itemsize, NODE.itemsize


class Addresses(NamedTuple):
    """Addresses of a graph's arrays that kernels read and write (up to `waiting`), and their sizes."""

    size: int
    pruned: int
    straight: int
    nodes: int  # records of a vertex and its nodes
    next_in: int  # EDGE records
    edge_first: int
    edge_marker: int
    edge_turn: int
    marker: int
    turn: int
    queue_cost: int
    queue_vertex: int
    queue_key: int
    refill: int
    waiting: int
    M: int  # markers
    stride: int  # bytes from one vertex to the next
    K: int  # nodes that there is room for at each
    C: int  # pairs that there is room for in each of these
    queue_room: int
    edge_room: int
    pair_room: int


class Capacity(NamedTuple):
    """Numbers of entries that there is room for, as in the shapes of a `Graph`."""

    V: int  # vertices
    E: int  # edges
    P: int  # pairs of these
    K: int  # nodes of a vertex
    C: int  # pairs of a node
    Q: int  # nodes in the queue


class Places(Addresses):
    """`Addresses` together with the graph that they point into."""

    graph: Graph

    @classmethod
    def of(cls, graph: Graph) -> "Places":
        """The places of the arrays of a graph, valid until it is given more room."""
        parts = [getattr(graph, name) for name in cls._fields if name in Graph._fields]

        M = graph.straight.shape[1]
        stride = graph.nodes.strides[0]
        _, K, C = graph.marker.shape

        sizes = len(graph.queue_cost), len(graph.tail), len(graph.edge_marker)
        places = cls._make([*(part.ctypes.data for part in parts), M, stride, K, C, *sizes])
        places.graph = graph
        return places


def _records(count: int, dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Zeros that begin where a line does: a processor fetches 64 bytes at once."""
    raw = np.zeros(count * dtype.itemsize + 64, np.uint8)
    begin = -raw.ctypes.data % 64
    return raw[begin : begin + count * dtype.itemsize].view(dtype)


def empty_graph(capacity: Capacity, n: int, M: int) -> Graph:
    """Allocate a graph without vertices, for states of n numbers and M markers."""
    V, E, P, K, C, Q = capacity
    edge = _records(E, EDGE)
    vertex = _records(V, np.dtype([*VERTEX.descr, ("node", NODE, (K,))]))
    edge["next_in"] = edge["next_out"] = vertex["first_out"] = vertex["first_in"] = -1
    vertex["node"]["parent"] = ROOT
    return Graph(
        size=np.zeros(5, np.int64), pruned=np.zeros(1, np.int64),
        states=np.zeros((V, n)), in_goal=np.zeros(V, np.bool_), straight=np.zeros((V, M)),
        edge_first=np.zeros(E + 1, np.int64), edge_marker=np.zeros(P, np.int32), edge_turn=np.zeros(P, np.int16),
        marker=np.zeros((V, K, C), np.int32), turn=np.zeros((V, K, C), np.int16),
        queue_cost=np.zeros(Q), queue_vertex=np.zeros(Q, np.int32), queue_key=np.zeros(Q, np.int64),
        refill=np.zeros(V, np.int32), waiting=np.zeros(V, np.bool_),
        **{name: edge[name] for name in EDGE.names or ()},
        **{name: vertex[name] for name in ("nodes", "first_out", "first_in")},
        **{name: vertex["node"][name] for name in NODE.names or ()},
    )  # fmt: skip


class Storage:
    """Vertices, edges and nodes of a tree; the graph is replaced by a larger one whenever it is full."""

    def __init__(self, n: int, M: int, classes: int) -> None:
        """Allocate room for states of n numbers, M markers and so many classes per vertex; 0: as many as come."""
        E = TUNING.edges
        self.capacity = Capacity(V=TUNING.vertices, E=E, P=E, K=classes or 8, C=min(M, TUNING.pairs), Q=1024)
        self.places = Places.of(empty_graph(self.capacity, n, M))

    @property
    def vertices(self) -> Vertices:
        """States of the vertices."""
        return Vertices(self.places.graph.states, self.places.graph.in_goal)

    def write(self, x: Array, root: bool) -> int:
        """Write a state (n,) where the next vertex will be; its index."""
        v = int(self.places.graph.size[SIZE.vertices])
        self.make_room(V=v + 1)
        self.places.graph.states[v], self.places.graph.in_goal[v] = x, root
        return v

    def double(self, status: int) -> None:
        """Make room for more of what is full by a status."""
        name = {STATUS.nodes_full: "K", STATUS.queue_full: "Q", STATUS.pairs_full: "C"}[status]
        self.make_room(**{name: getattr(self.capacity, name) + 1})

    def make_room(self, **least: int) -> None:
        """Double what is less than so many, by names of a `Capacity`."""
        counts, old = self.capacity._asdict(), self.places.graph
        for name, count in least.items():
            while counts[name] < count:
                counts[name] *= 2
        if (larger := Capacity(**counts)) != self.capacity:
            graph = empty_graph(larger, old.states.shape[1], old.straight.shape[1])
            for name in Graph._fields:
                array = getattr(old, name)
                getattr(graph, name)[tuple(slice(0, length) for length in array.shape)] = array
            self.capacity, self.places = larger, Places.of(graph)


@inlined
def edge_at(at, e):  # type: ignore[no-untyped-def]
    """Address of edge e, an EDGE record."""
    return at.next_in + EDGE_BYTES * e


@inlined
def vertex_at(at, v):  # type: ignore[no-untyped-def]
    """Address of vertex v, a VERTEX record with its nodes after it."""
    return at.nodes + at.stride * v


@inlined
def node_at(vertex, slot):  # type: ignore[no-untyped-def]
    """Address of a node, a NODE record, of the vertex at an address."""
    return vertex + VERTEX_BYTES + NODE_BYTES * slot


@inlined
def slot_of(vertex, key):  # type: ignore[no-untyped-def]
    """Slot of the class of a key at the vertex at an address, -1 if it has none."""
    for slot in range(load_int32(vertex, COUNT)):
        if load_int64(node_at(vertex, slot), KEY) == key:
            return slot
    return -1


@inlined
def is_root(vertex):  # type: ignore[no-untyped-def]
    """Return whether the vertex at an address lies in the goal."""
    return load_int32(vertex, COUNT) > 0 and load_int32(node_at(vertex, 0), PARENT) == ROOT


def class_at(graph: Graph, vertex: int, slot: int) -> NDArray[np.int64]:
    """The integers (M,) [turns] of a node's class, against the straight line from its vertex."""
    count = graph.pairs[vertex, slot]
    return spread(graph.marker[vertex, slot, :count], graph.turn[vertex, slot, :count], graph.straight.shape[1])
