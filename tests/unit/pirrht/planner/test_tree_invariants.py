"""The tree is what a search of its finished graph would give, whatever the order of discovery."""

from __future__ import annotations

import heapq

import numpy as np
import pytest
from discs import disc, scene_of
from numpy.typing import NDArray
from trees import grown

from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.planner.graph import Graph, class_at
from pirrht.planner.tree import HomologyTree
from pirrht.steering.dubins import Dubins
from pirrht.steering.steering import Steering
from pirrht.steering.straight_line import StraightLine
from pirrht.topology.crossings import Turns

Class = tuple[int, ...]

CASES = [
    (steering, classes)
    for steering in (StraightLine(), Dubins(rho=0.4))
    for classes in (1, 3, 8, 0)
    if classes or isinstance(steering, StraightLine)
]


def posts() -> Scene:
    """Five posts between start and goal, the goal in reach of many draws."""
    spots = [(1.6, 2.0), (2.9, 3.2), (3.0, 1.1), (4.2, 2.3), (1.5, 3.7)]
    obstacles = [disc(f"post{i}", *spot, 0.2) for i, spot in enumerate(spots)]
    return scene_of(obstacles, start=(0.5, 2.4), goal=(5.3, 2.5, 0.35), side=(6.0, 4.6))


@pytest.fixture(scope="module")
def space() -> FreeSpace:
    return FreeSpace.of(posts())


def nodes(tree: HomologyTree, vertex: int) -> dict[Class, float]:
    """Classes and costs that the tree keeps at a vertex."""
    gr = tree.graph
    return {tuple(class_at(gr, vertex, s)): float(gr.cost[vertex, s]) for s in range(gr.nodes[vertex])}


def added(gr: Graph, edge: int) -> NDArray[np.int64]:
    """Whole turns (M,) that prepending an edge adds."""
    return Turns(gr.edge_first, gr.edge_marker, gr.edge_turn).dense(edge, gr.straight.shape[1])


def searched(tree: HomologyTree) -> list[dict[Class, float]]:
    """Label-setting search of the finished graph: the K cheapest allowed classes settle at every vertex."""
    gr, size = tree.graph, tree.size
    entering: list[list[int]] = [[] for _ in range(size)]
    for e in range(int(gr.size[1])):
        entering[gr.head[e]].append(e)
    settled: list[dict[Class, float]] = [{} for _ in range(size)]
    none = (0,) * tree.space.homology.M
    queue: list[tuple[float, int, Class]] = [(0.0, v, none) for v in range(size) if tree.in_goal[v]]
    heapq.heapify(queue)
    while queue:
        cost, v, turns = heapq.heappop(queue)
        full = tree.classes and len(settled[v]) >= tree.classes
        if turns in settled[v] or full:
            continue
        settled[v][turns] = cost
        for e in entering[v]:
            u = int(gr.tail[e])
            longer = tuple(int(k) for k in np.array(turns) + added(gr, e))
            if not tree.in_goal[u] and np.all(np.abs(gr.straight[u] + longer) <= tree.limit):
                heapq.heappush(queue, (cost + float(gr.edge_cost[e]), u, longer))
    return settled


@pytest.mark.parametrize(("steering", "classes"), CASES)
def test_the_grown_tree_equals_a_search_of_its_graph(space: FreeSpace, steering: Steering, classes: int) -> None:
    tree = grown(space, steering, 150, seed=4, classes=classes)
    expected = searched(tree)
    for v in range(tree.size):
        kept = nodes(tree, v)
        assert kept.keys() == expected[v].keys()
        for turns, cost in kept.items():
            assert cost == pytest.approx(expected[v][turns], abs=1e-9)
    if 0 < classes < 8:
        assert tree.graph.pruned[0] > 0
    assert tree.node_count > tree.size or classes == 1
