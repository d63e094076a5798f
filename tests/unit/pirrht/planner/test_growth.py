"""The tree is what a search of its finished graph gives, draws in passages first, and grows by counts."""

import heapq
from functools import cache
from typing import Any

import numpy as np
import pytest
from discs import block, disc, scattered, scene_of
from numpy.typing import NDArray
from trees import grown

from pirrht import Dubins, FreeSpace, HomologyTree, OptionError, Steering, StraightLine
from pirrht.planner.expand import PassageSampler
from pirrht.planner.graph import ROOT, Graph, class_at
from pirrht.topology.pairs import Turns
from sim.cli import main
from sim.drive import episode
from sim.scenario import Scenario, prepare


@cache
def scenario_of(robot: str) -> Scenario:
    """A point in `slit`, or a car in `clutter`."""
    given = {"vertices": 60, "samples": 20, "noise": 0.2} if robot == "small" else {"vertices": 60}
    return prepare("slit" if robot == "small" else "clutter", given=given)


def assert_equal_trees(one: HomologyTree, other: HomologyTree) -> None:
    assert (one.size, one.node_count, one.draws) == (other.size, other.node_count, other.draws)
    np.testing.assert_array_equal(one.states[: one.size], other.states[: other.size])
    for x in one.states[: one.size : 7]:
        assert one.lengths(x) == other.lengths(x)


@pytest.mark.parametrize("robot", ["small", "car"])
def test_growing_k_times_is_growing_once(robot: str):
    scenario = scenario_of(robot)
    once, often = scenario.grown_tree(), scenario.grown_tree()
    once.grow(once.size + 60)
    for _ in range(12):
        often.grow(often.size + 5)
    assert_equal_trees(once, often)


@pytest.mark.parametrize("vertices", [-1, 2.5, None, "9", float("nan")])
def test_what_is_no_number_of_vertices_is_refused(vertices: Any):
    tree = scenario_of("small").empty_tree()
    with pytest.raises(OptionError, match=r"^vertices is .*; it must be a whole number of 0 or more$"):
        tree.grow(vertices)


@pytest.mark.parametrize("robot", ["small", "car"])
def test_draws_dealt_with_together_make_the_tree_that_they_make_one_by_one(robot: str):
    scenario = scenario_of(robot)
    together, one_by_one = scenario.empty_tree(), scenario.empty_tree()
    draws = together.steering.draws(together.space, together.rng, 300, goal_share=0.05)
    together.extend_by(draws)
    for x in draws:
        one_by_one.extend(x)
    assert_equal_trees(together, one_by_one)
    for v in range(together.size):
        count = int(together.graph.nodes[v])
        for name in ("cost", "key", "parent"):
            one, other = getattr(together.graph, name), getattr(one_by_one.graph, name)
            np.testing.assert_array_equal(one[v, :count], other[v, :count])
    assert together.graph.pruned[0] == one_by_one.graph.pruned[0]


def test_equal_seeds_grow_and_drive_alike():
    def drive() -> list[episode.Frame]:
        small = scenario_of("small")
        controller = small.controller(small.grown_tree())
        return list(episode.run(small.plant(), controller, small.start, small.plant_rng(), max_time=0.2, grow=4))

    one, other = drive(), drive()
    assert [frame.vertices for frame in one] == [60 + 4 * k for k in range(len(one))]
    for first, second in zip(one, other, strict=True):
        assert first.vertices == second.vertices
        np.testing.assert_array_equal(first.advance.states, second.advance.states)
        assert [r.cost for r in first.plan.references] == [r.cost for r in second.plan.references]


def test_what_cannot_grow_is_refused(capsys):
    assert main(["run", "slit", "--grow", "-1"]) == 2
    assert main(["run", "slit", "--grow", "5", "--method", "passive"]) == 2
    message = capsys.readouterr().err
    assert "--grow is -1" in message
    assert "--method passive has no tree" in message


FEW = 300  # vertices


@cache
def double_slit() -> FreeSpace:
    """A wall from border to border with two slits of 1.25 robot diameters."""
    blocks = [block("below", 5.0, 2.0, (0.25, 2.0)), block("middle", 5.0, 5.0, (0.25, 0.75)),
              block("above", 5.0, 8.0, (0.25, 2.0))]  # fmt: skip
    return FreeSpace.of(scene_of(blocks, start=(0.5, 5.0), goal=(9.5, 5.0), side=10.0))


def has_vertex(tree: HomologyTree) -> np.ndarray:
    """Which passages have a vertex in their middle, (P,)."""
    vertices = {tuple(x) for x in tree.states[: tree.size, :2].tolist()}
    return np.array([tuple(place) in vertices for place in tree.passages.place.tolist()])


@pytest.mark.parametrize("seed", range(8))
def test_few_vertices_find_both_slits_whatever_the_seed(seed: int):
    tree = grown(double_slit(), StraightLine(), FEW, seed=seed)
    assert len(tree.lengths(np.array([0.5, 5.0]))) == 2
    assert has_vertex(tree).all()


@pytest.mark.parametrize("seed", range(4))
def test_every_open_passage_gets_a_vertex(seed: int):
    tree = grown(FreeSpace.of(scattered(seed)), StraightLine(), FEW, seed=seed)
    assert tree.passages.count > 3
    assert has_vertex(tree).all()


def test_a_tree_that_is_given_passages_offers_them_and_begins_again_where_the_robot_is():
    space = double_slit()
    own, given = grown(space, StraightLine(), 0), grown(space, StraightLine(), 0)
    given.passages = own.passages
    for tree in (own, given):
        tree.grow(FEW // 2)
        tree.aim(np.array([0.5, 5.0]))
        tree.grow(FEW)
    assert given.passages is own.passages
    assert has_vertex(given).all()
    np.testing.assert_array_equal(given.states[:FEW], own.states[:FEW])


def test_at_least_every_second_draw_is_uniform_and_none_is_offered_twice_in_a_period():
    states = np.random.default_rng(0).random((100, 2))
    offers = PassageSampler(states)
    for first in (0, 64, 5):
        many = offers.together(first)
        drawn = [offers.at(first + k) for k in range(many)]
        offered = [tuple(x) for x in drawn if x is not None]
        assert len(offered) <= (many + 1) // 2
        assert len(offered) == len(set(offered))
    assert {tuple(x) for k in range(offers.together(0)) if (x := offers.at(k)) is not None} == set(map(tuple, states))


Class = tuple[int, ...]

CASES = [*((StraightLine(), classes) for classes in (1, 3, 8, 0)), *((Dubins(rho=0.4), k) for k in (1, 3, 8))]


@cache
def posts(steering: Steering, classes: int) -> HomologyTree:
    """A tree among five posts between start and goal, the goal in reach of many draws."""
    spots = [(1.6, 2.0), (2.9, 3.2), (3.0, 1.1), (4.2, 2.3), (1.5, 3.7)]
    obstacles = [disc(f"post{i}", *spot, 0.2) for i, spot in enumerate(spots)]
    scene = scene_of(obstacles, start=(0.5, 2.4), goal=(5.3, 2.5, 0.35), side=(6.0, 4.6))
    return grown(FreeSpace.of(scene), steering, 150, seed=4, classes=classes)


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
        if turns in settled[v] or (tree.classes and len(settled[v]) >= tree.classes):
            continue
        settled[v][turns] = cost
        for e in entering[v]:
            u = int(gr.tail[e])
            longer = tuple(int(k) for k in np.array(turns) + added(gr, e))
            if not tree.in_goal[u] and np.all(np.abs(gr.straight[u] + longer) <= tree.limit):
                heapq.heappush(queue, (cost + float(gr.edge_cost[e]), u, longer))
    return settled


@pytest.mark.parametrize(("steering", "classes"), CASES)
def test_the_grown_tree_equals_a_search_of_its_graph(steering: Steering, classes: int) -> None:
    tree = posts(steering, classes)
    expected = searched(tree)
    for v in range(tree.size):
        kept = nodes(tree, v)
        assert kept.keys() == expected[v].keys()
        for turns, cost in kept.items():
            assert cost == pytest.approx(expected[v][turns], abs=1e-9)
    if 0 < classes < 8:
        assert tree.graph.pruned[0] > 0
    assert tree.node_count > tree.size or classes == 1


@pytest.mark.parametrize(("steering", "classes"), CASES)
def test_every_node_costs_its_parent_plus_its_edge(steering: Steering, classes: int) -> None:
    tree = posts(steering, classes)
    gr = tree.graph
    for v in range(tree.size):
        for slot in range(int(gr.nodes[v])):
            e, turns = gr.parent[v, slot], class_at(gr, v, slot)
            parent = 0.0 if e == ROOT else nodes(tree, int(gr.head[e]))[tuple(turns - added(gr, e))] + gr.edge_cost[e]
            assert (e == ROOT) == tree.in_goal[v]
            assert e == ROOT or gr.tail[e] == v
            assert gr.cost[v, slot] == pytest.approx(parent, abs=1e-9)
            assert gr.key[v, slot] == tree.space.homology.key(turns)
