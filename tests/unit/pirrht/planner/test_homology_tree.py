"""What the tree finds in the slit is known exactly, and its limits mean what they say."""

from itertools import pairwise

import numpy as np
import pytest
from discs import scene_of
from trees import grown

from pirrht import FreeSpace, HomologyTree, OptionError, Reference, Steering, StraightLine
from pirrht.planner.graph import class_at
from pirrht.topology.signature import class_id

EXACT = {"0,0": 8.4, "-1,0": 8.67746, "0,1": 8.67746}  # cost of the taut paths, from their geometry


def tree_in(space: FreeSpace, *, vertices: int = 300, limit: float = 0.6, **options) -> HomologyTree:
    return grown(space, StraightLine(), vertices, limit=limit, **options)


def by_class(references: list[Reference]) -> dict[str, Reference]:
    return {reference.id: reference for reference in references}


def test_the_slit_has_three_classes(slit, slit_tree: HomologyTree):
    references = slit_tree.references(slit.start)
    assert by_class(references).keys() == EXACT.keys()
    assert references[0].id == "0,0"
    assert [r.cost for r in references] == sorted(r.cost for r in references)
    for reference in references:
        assert np.all(np.abs(1.0 - reference.signature) <= slit.settings.limit)
        signature = slit.space.homology.signature(slit.start, reference.winding)
        np.testing.assert_allclose(reference.signature, signature, atol=1e-12)


def test_taut_paths_cost_what_their_geometry_says(slit, slit_tree: HomologyTree):
    for name, reference in by_class(slit_tree.references(slit.start)).items():
        assert reference.cost == pytest.approx(EXACT[name], rel=0.005)
        assert reference.cost > EXACT[name] - 1e-6
        assert reference.cost == pytest.approx(2.0 * reference.length)


def test_asking_leaves_the_tree_unchanged(slit):
    tree = tree_in(slit.space, limit=0.6)
    before = [np.array(part) for part in tree.graph]
    states, draws, where = tree.states.copy(), tree.draws, tree.rng.bit_generator.state
    for x in ([1.0, 2.5], [2.0, 4.0], [5.0, 1.0]):
        tree.references(np.array(x))
        tree.references(np.array(x), shortened=False)
    for old, new in zip(before, tree.graph, strict=True):
        np.testing.assert_array_equal(old, new)
    np.testing.assert_array_equal(tree.states, states)
    assert (tree.draws, tree.rng.bit_generator.state) == (draws, where)


def test_growing_more_never_raises_the_best_cost_of_a_class(slit):
    tree = tree_in(slit.space, limit=0.6, vertices=100)
    best: dict[tuple[int, ...], float] = {}
    for vertices in range(100, 601, 50):
        tree.grow(vertices)
        # The k nearest change with growth; what a vertex has keeps getting better.
        gr = tree.graph
        now = {(v, *class_at(gr, v, s)): float(gr.cost[v, s]) for v in range(100) for s in range(gr.nodes[v])}
        for node, cost in best.items():
            assert now[node] <= cost + 1e-9
        best = now
    assert best


@pytest.mark.parametrize("x", [[1.0, 2.5], [0.3, 4.5], [3.4, 2.5], [5.0, 4.7], [2.4, 2.5]])
def test_references_are_free_end_on_the_goal_and_have_the_class_they_claim(slit, slit_tree, x):
    x = np.array(x)
    homology, checker, goal = slit.space.homology, slit_tree.checker, slit.problem.scene.goal
    references = slit_tree.references(x)
    assert len({reference.id for reference in references}) == len(references) > 0
    for reference in references:
        points = np.vstack(reference.path.points(0.02))
        np.testing.assert_allclose(points[0], x)
        assert np.hypot(*(points[-1] - goal.center)) == pytest.approx(goal.radius, abs=1e-9)
        assert homology.winding(points) == reference.winding
        assert class_id(reference.winding) == reference.id
        dense = np.concatenate([np.linspace(a, b, 1500) for a, b in pairwise(points)])
        assert np.all(slit.space.collision.clearance(dense) > 0)
        assert np.hypot(*np.diff(points, axis=0).T).sum() == pytest.approx(reference.length)
        assert np.all(checker.inspect(reference.path, np.ones(len(reference.path.cost), dtype=np.bool_)).free)


def test_the_limit_holds_at_every_vertex_and_removes_the_fourth_winding(slit):
    """A path around both walls that turns back through the slit ends allowed, but is not allowed on its way."""
    wide = by_class(tree_in(slit.space, limit=1.6, vertices=600, classes=0).references(slit.start))
    narrow = by_class(tree_in(slit.space, limit=0.6, vertices=600, classes=0).references(slit.start))
    assert narrow.keys() == EXACT.keys() < wide.keys()
    assert "-1,1" in wide  # its signature at the start is 0.46, 1.54: within 0.6, were it not for the way there
    assert np.all(np.abs(1.0 - wide["-1,1"].signature) <= 0.6)
    for name in EXACT:
        assert wide[name].cost == pytest.approx(narrow[name].cost, rel=0.01)


def test_what_cannot_limit_is_refused(slit):
    for wrong in ({"limit": 0.0}, {"limit": -1.0}, {"limit": np.nan}, {"classes": -1}):
        with pytest.raises(OptionError, match=next(iter(wrong))):
            HomologyTree(slit.space, StraightLine(), rng=np.random.default_rng(0), **wrong)


def test_without_obstacles_there_is_one_straight_class():
    scene = scene_of(start=(1.0, 0.0001), goal=(4.0, 4.0, 0.2), side=5.0)
    (reference,) = tree_in(FreeSpace.of(scene), vertices=50).references(np.array([1.0, 1.0]))
    assert reference.id == "-"
    assert reference.length == pytest.approx(np.hypot(3, 3) - 0.2)


def test_states_that_collide_or_reach_nothing_do_not_become_vertices(slit):
    tree = HomologyTree(slit.space, StraightLine(), limit=0.6, rng=np.random.default_rng(0))
    for x in ([3.4, 2.8], [6.5, 2.5], [1.0, 3.4]):
        assert not tree.extend(np.array(x))
    assert tree.size == 1
    assert tree.extend(np.array([5.0, 4.0]))
    assert tree.extend(np.array([1.0, 3.4]))  # now it sees a vertex
    assert (tree.size, tree.draws) == (3, 5)


def test_straight_lines_know_their_nearest_states_without_sorting_all():
    rng = np.random.default_rng(4)
    states, steering = rng.uniform(0.0, 5.0, (300, 2)), StraightLine()
    for count in (1, 7, 300, 400):
        for x in rng.uniform(0.0, 5.0, (20, 2)):
            found = steering.nearest(states, x, count, forward=True)
            assert np.array_equal(found, Steering.nearest(steering, states, x, count, forward=True))
