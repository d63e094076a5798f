"""Words for ways in space: they tell classes apart, and are true of the paths."""

from types import SimpleNamespace

import numpy as np
import pytest
from spaces import bar, box, framed, in_space, pillars, window

from pirrht import FreeSpace
from pirrht.topology.linking import Linking
from sim.drawing.ways import through, ways_in
from sim.text import shared


def reference(homology, points):
    """The straight lines through points as a reference."""
    winding = homology.winding(points)
    trajectory = SimpleNamespace(points=points)
    return SimpleNamespace(
        id=homology.name(winding), winding=winding, signature=homology.signature(points[0], winding),
        trajectory=trajectory,
    )  # fmt: skip


def words_of(scene, *stops):
    """The ways of paths from the start over some stops each to the goal."""
    space = FreeSpace.of(scene)
    ends = scene.start, scene.goal.center
    paths = [reference(space.homology, np.vstack([ends[0], *stop, ends[1]])) for stop in stops]
    named = [shared([name for name in part.names if name != "workspace"]) for part in space.obstacles]
    return ways_in(space, paths, [name or part.names[0] for name, part in zip(named, space.obstacles, strict=True)])


POSTS = [box("post a", (2.8, 1.2, 0), (3.2, 1.5, 3)), box("post b", (2.8, 2.5, 0), (3.2, 2.8, 3))]
DOOR = [
    box("left", (2.9, 2.4, 0), (3.1, 4, 2)),
    box("right", (2.9, 0, 0), (3.1, 1.6, 2)),
    box("beam", (2.9, 0, 1.5), (3.1, 4, 2)),
]
RIM = framed("rim", 3.0, (-0.1, 0.1), (1.0, 0.2, 3.0, 2.2), (1.6, 0.6, 2.4, 1.4))
CRATE = [box("crate", (2.8, 1.8, 0.8), (3.2, 2.2, 1.2))]


@pytest.mark.parametrize(
    ("scene", "ways"),
    [
        (window(), {(): "through the opening in wall", ((2.65, 2, 1), (2.65, 2, 2.45), (3.4, 2, 2.6)): "over wall"}),
        (window(), {(): "through the opening in wall", ((3.0, 2.0, 2.6),): "over wall"}),
        (in_space(RIM),
         {(): "through the opening in rim", ((3.0, 3.5, 1.0),): "left of rim"}),
        (in_space(RIM),
         {(): "through the opening in rim",
          ((3.5, 2, 1), (3, 3.5, 1), (2.5, 2, 1)): "2 times through the opening in rim"}),
        (in_space(POSTS), {((3, 0.6, 1), (3.5, 2, 1), (2.5, 2, 1), (3, 3.5, 1)): "right of post a",
                           ((3, 3.5, 1),): "left of post a"}),
        (bar(), {(): "under bar", ((3.0, 2.0, 2.5),): "over bar"}),
        (in_space(POSTS), {(): "between post a and post b", ((3, 3.5, 1),): "left of post b",
                           ((3, 0.6, 1),): "right of post a"}),
        (in_space(POSTS), {((3, 3.5, 1),): "left of post a", ((3, 0.6, 1),): "right of post a"}),
        (in_space(DOOR), {(): "through the opening between left, right, beam and the border",
                          ((3.0, 2.0, 2.5),): "over beam"}),
        (in_space(CRATE), {((3.0, 2.0, 0.4),): "under crate"}),
        (in_space(CRATE), {((3.0, 1.4, 1.0),): "right of crate", ((3.0, 1.3, 1.0),): "right of crate"}),
        (in_space(), {(): "the only way"}),
        (in_space(CRATE, start=(3.6, 2, 1)), {(): "away from crate"}),
        (in_space(CRATE, goal=(2.4, 2, 1, 0.1)), {(): "this side of crate"}),
        (pillars(), {(): "right of pillar 1", ((2.0, 3.6, 1.0), (3.0, 2.0, 0.4)): "left of pillar 1"}),
    ],
)  # fmt: skip
def test_ways_say_what_paths_go_through_over_under_or_past(scene, ways):
    found = words_of(scene, *(np.reshape(stop, (-1, 3)) for stop in ways))
    assert found == list(ways.values())


def pierced(loop, line):
    """How often a polyline pierces the fan over a polygon, forwards less backwards."""

    def side(*points):
        return np.sign(np.linalg.det(np.diff(points, axis=0)))

    count = 0
    middle = loop.mean(axis=0)
    for p, q in zip(line[:-1], line[1:], strict=True):
        for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            if side(p, middle, a, b) != side(q, middle, a, b):
                edges = {side(p, q, *pair) for pair in ((middle, a), (a, b), (b, middle))}
                count += int(side(p, middle, a, b)) if len(edges) == 1 else 0
    return count


def test_a_path_goes_through_a_loop_as_often_as_it_pierces_the_fan_over_it():
    rng, counts = np.random.default_rng(7), []
    for _ in range(60):
        loop, line = rng.normal(size=(7, 3)), rng.normal(size=(6, 3))
        homology = Linking(loops=(loop,), goal=line[-1])
        space = SimpleNamespace(homology=homology)
        found = through(reference(homology, line), 0, space)
        counts.append((found, pierced(loop, line)))
    found, expected = np.array(counts).T
    assert np.array_equal(found, expected) or np.array_equal(found, -expected)
    assert len({*found.tolist()}) >= 3
