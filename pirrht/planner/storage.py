"""Keep a growing tree's vertices, edges and nodes, and make room for more: all of the tree that changes."""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array
from pirrht.planner import graph as g
from pirrht.planner.graph import STATUS, Vertices
from pirrht.planner.nodes import SearchRules
from pirrht.planner.rewire import relax
from pirrht.planner.tuning import TUNING
from pirrht.steering.edges import Edges

MORE = {STATUS.nodes_full: (g.NODES, 1), STATUS.queue_full: (g.QUEUE, 0), STATUS.pairs_full: (g.NODE_PAIRS, 2)}


class Storage:
    """Vertices and graph of a tree; both are replaced by larger ones whenever they are full."""

    def __init__(self, vertices: Vertices, graph: g.Graph) -> None:
        self.vertices, self.places = vertices, g.Places.of(graph)

    @classmethod
    def empty(cls, n: int, M: int, classes: int) -> Storage:
        """Allocate room for states of n numbers, M obstacles and so many classes per vertex."""
        vertices = Vertices(np.zeros((TUNING.vertices, n)), np.zeros(TUNING.vertices, dtype=np.bool_))
        return cls(vertices, g.empty_graph(TUNING.vertices, TUNING.edges, classes, M))

    @property
    def size(self) -> int:
        """Number of vertices."""
        return int(self.places.graph.size[g.SIZE.vertices])

    def write(self, x: Array, root: bool) -> int:
        """Write a state (n,) where the next vertex will be; its index."""
        v = self.size
        if v >= len(self.vertices.states):
            self._double_vertices()
        self.vertices.states[v], self.vertices.in_goal[v] = x, root
        return v

    def reserve(self, vertices: int) -> None:
        """Make room for about so many vertices, their edges and pairs."""
        size = self.places.graph.size
        more = 1.5 * vertices / self.size  # a vertex of a larger tree has more neighbours
        while len(self.vertices.states) < vertices:
            self._double_vertices()
        self._make_room(int(more * size[g.SIZE.edges]), int(more * size[g.SIZE.pairs]))

    def make_room(self, *batches: Edges) -> None:
        """Make room for more edges."""
        self._make_room(sum(len(one.near) for one in batches), sum(len(one.turns.marker) for one in batches))

    def relax(self, rules: SearchRules) -> None:
        """Relax costs until no node improves."""
        while (status := relax(self.places, rules)) != STATUS.done:
            self._double(*MORE[status])

    def _make_room(self, edges: int, pairs: int) -> None:
        while self.places.graph.size[g.SIZE.edges] + edges > len(self.places.graph.tail):
            self._double(g.EDGES)
        while self.places.graph.size[g.SIZE.pairs] + pairs > len(self.places.graph.edge_marker):
            self._double(g.EDGE_PAIRS)

    def _double_vertices(self) -> None:
        self._double(g.VERTICES + g.NODES)
        states, in_goal = self.vertices
        self.vertices = Vertices(
            np.vstack([states, np.zeros_like(states)]), np.concatenate([in_goal, np.zeros_like(in_goal)])
        )

    def _double(self, names: tuple[str, ...], axis: int = 0) -> None:
        self.places = g.Places.of(g.doubled(self.places.graph, names, axis))
