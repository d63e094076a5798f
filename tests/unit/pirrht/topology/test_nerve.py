"""Generators in space: as many as voxels have, and what the chains of solids are that stand for them."""

from itertools import count, islice

import gudhi
import numpy as np
import pytest
from spaces import bar, box, framed, in_space, mixed, pillars, solid, window

from pirrht.geometry.blocks import lattice
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Kind, Scene
from pirrht.topology.nerve import Loop, continued_loops, loops

SPACING = 0.1
SURE = (4, 6, 8, 15, 17, 27, 43, 49)  # seeds of scenes whose Betti numbers voxels can tell


def found(scene: Scene) -> list[Loop]:
    return [part for part in loops(Collision(scene.world, scene.footprint)) if isinstance(part, Loop)]


def voxels(scene: Scene) -> int | None:
    """First Betti number of free voxels; None if it changes with clearance by a spacing, and a grid cannot tell."""
    shape = np.ceil((scene.upper - scene.lower) / SPACING).astype(int)
    points = scene.lower + SPACING * (lattice(*shape) + 0.5)
    clearance = Collision(scene.world, scene.footprint).clearance(points.reshape(-1, 3)).reshape(shape)
    grid = gudhi.CubicalComplex(top_dimensional_cells=-clearance)
    grid.compute_persistence(homology_coeff_field=2)
    bars = grid.persistence_intervals_in_dimension(1).reshape(-1, 2)
    return None if np.any(np.abs(bars) < SPACING) else int(np.sum((bars[:, 0] < 0.0) & (bars[:, 1] > 0.0)))


def countable(seeds):
    """Random scenes whose Betti numbers voxels can tell."""
    for seed in seeds:
        scene = mixed(seed)
        betti = voxels(scene)
        if betti is not None:
            yield scene, betti


@pytest.mark.parametrize(("seeds", "amount"), [(SURE, 8), pytest.param(count(), 50, marks=pytest.mark.slow)])
def test_random_scenes_have_as_many_generators_as_their_voxels(seeds, amount):
    numbers = [(len(found(scene)), betti) for scene, betti in islice(countable(seeds), amount)]
    assert len(numbers) == amount
    assert all(generators == betti for generators, betti in numbers)
    assert len({betti for _, betti in numbers}) > 2


def rooms_of_voxels(seed: int) -> Scene:
    """Voxels at random, so large that voxels of a tenth tell the free space between them."""
    occupied = np.random.default_rng([seed, 6]).random((6, 5, 4)) < 0.35
    occupied[0, 0, 0] = occupied[-1, -1, -1] = False
    task = {"start": (0.4, 0.4, 0.4), "goal": (4.4, 3.6, 2.8, 0.1), "robot_radius": 0.2}
    return Scene.from_voxels(occupied, 0.8, **task)


@pytest.mark.parametrize("seeds", [range(3), pytest.param(range(3, 16), marks=pytest.mark.slow)])
def test_random_voxels_have_as_many_generators_as_a_finer_grid(seeds):
    numbers = [(len(found(scene)), voxels(scene)) for scene in map(rooms_of_voxels, seeds)]
    assert all(generators == betti for generators, betti in numbers)
    assert len({betti for _, betti in numbers}) > 2


@pytest.mark.parametrize(
    ("scene", "names"),
    [
        (window(), [("wall left", "wall right", "wall sill", "wall lintel")]),
        (window(closed=True), []),
        (pillars(), [(f"pillar {i}", "workspace") for i in range(4)]),
        (bar(), [("bar", "workspace")]),
        (in_space([solid("ball", Kind.SPHERE, (0.4, 0.0, 0.0), (3.0, 2.0, 1.5))]), []),
        (in_space([box("out of reach", (2.0, 1.0, -3.0), (3.0, 2.0, -2.0))]), []),
        (in_space([box("one", (2.0, 1.0, 0.0), (2.2, 1.2, 3.0)), box("same", (2.0, 1.0, 0.0), (2.2, 1.2, 3.0))]),
         [("one", "workspace")]),
    ],
)  # fmt: skip
def test_generators_go_by_the_names_of_what_paths_link_with(scene, names):
    assert [part.names for part in found(scene)] == names


def test_sides_of_polygons_stay_inside_of_one_grown_solid_each_or_outside():
    for scene in (*(mixed(seed) for seed in range(20)), window(), pillars()):
        collision = Collision(scene.world, scene.footprint)
        for part in found(scene):
            for tail, head in zip(part.corners, np.roll(part.corners, -1, axis=0), strict=True):
                points = tail + np.linspace(0.0, 1.0, 50)[:, None] * (head - tail)
                inside = [collision.obstacle_distance(i, points).max() <= scene.robot_radius for i in part.members]
                outside = np.any(np.all(points <= scene.lower, axis=0) | np.all(points >= scene.upper, axis=0))
                assert any(inside) or outside


def test_a_frame_loses_its_generator_when_the_ball_no_longer_fits():
    frame = framed("frame", 3.0, (-0.1, 0.1), (1.0, 0.5, 3.0, 2.5), (1.7, 1.2, 2.3, 1.8))
    assert [len(found(in_space(frame, radius=radius))) for radius in (0.2, 0.29, 0.31, 0.4)] == [1, 1, 0, 0]


def test_chains_keep_their_numbers_while_their_polygons_stay_inside_of_solids():
    scene = pillars()
    before = tuple(found(scene))

    def after(*gone, add=(), since=before) -> list:
        kept = [o for o in scene.obstacles if o.name not in gone]
        changed = in_space([*kept, *add])
        parts = continued_loops(Collision(changed.world, changed.footprint), since, named=2)
        return [part.names for part in parts]

    names = [part.names for part in before]
    assert after() == names
    assert after("pillar 1") == [names[0], (), *names[2:]]
    assert after("pillar 3", "pillar 2") == names[:2]
    more = box("pillar 4", (5.0, 3.5, 0.0), (5.2, 3.7, 3.0))
    assert after("pillar 1", add=[more]) == [names[0], (), *names[2:], ("pillar 4", "workspace")]
    lost = (before[0], *continued_loops(Collision(bar().world, bar().footprint), before[1:2], named=1)[:1])
    assert after("pillar 1", add=[more], since=lost)[:2] == [names[0], names[2]]
