"""Ways found in space over time: classes of our tree, and distinct paths of plain roadmaps (PRM).

A roadmap joins random places with their nearest by free straight lines. As the shortest paths of one are nearly all
alike, there are new ones as long as time allows. Paths, shortened where points see each other, are distinct unless
points of equal share of their lengths do (visibility deformation, as in CTopPRM). Distinct paths of our references are
counted by the same rule. Half of our time is for the tree, and what references take is in the table.
"""

import argparse
import time
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import yen
from scipy.spatial import KDTree

from pirrht.arrays import Array
from pirrht.plotting.strokes import even
from sim.scenario import Scenario, prepare

TIMES = (1.0, 3.0, 10.0)  # [s]
NEAREST = 12  # places that each is joined with
PLACES = 200  # of a roadmap
PATHS = 16  # shortest ones of a roadmap
AT_ONCE = 200  # vertices between two looks at the clock
SIGHTS = 30  # lines of sight between two paths


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], Any]:
    """Table and JSON: what each finds until some times, in a scene in space."""
    scenario = prepare(options.scene or "window", given={"classes": 64, "vertices": AT_ONCE})
    scenario.references(scenario.grown_tree())  # compiles
    _roadmap(scenario, 0.1)
    values = [{"seconds": limit, **_ours(scenario, limit), **_roadmap(scenario, limit)} for limit in TIMES]
    named = [scenario.problem.scene.name, str(len(scenario.space.scene.obstacles))]
    table = [[*named, *(f"{number:.4g}" for number in one.values())] for one in values]
    return ["scene", "pieces", *(key.replace("_", " ") for key in values[0])], table, values


def _ours(scenario: Scenario, limit: float) -> dict[str, float]:
    """Vertices, classes and distinct paths of a tree that grows for so long [s]; the last references count, too."""
    end = time.perf_counter() + 0.5 * limit
    tree = scenario.grown_tree()
    while time.perf_counter() < end:
        tree.grow(tree.size + AT_ONCE)
    paths = [even(one.trajectory.points[:, :3], SIGHTS) for one in scenario.references(tree)]
    ours = time.perf_counter() - end + 0.5 * limit
    return {"ours": ours, "vertices": tree.size, "classes": len(paths), "distinct": len(_distinct(scenario, paths, []))}


def _roadmap(scenario: Scenario, limit: float) -> dict[str, float]:
    """Roadmaps and distinct paths after so long [s]."""
    began = time.perf_counter()
    scene = scenario.space.scene
    collision = scenario.space.collision
    rng = np.random.default_rng(scenario.settings.seed)
    kept = list[Array]()
    maps = 0
    while time.perf_counter() < began + limit:
        drawn = rng.uniform(scene.lower, scene.upper, (PLACES, 3))
        places = np.vstack([scene.start, scene.goal.center, drawn[collision.clearance(drawn) > 0.0]])
        near = KDTree(places).query(places, NEAREST)[1][:, 1:]
        ends = np.unique(np.sort([np.repeat(np.arange(len(places)), NEAREST - 1), near.ravel()], axis=0), axis=1)
        ends = ends[:, collision.segments_free(*places[ends])]
        lengths = np.linalg.norm(places[ends[0]] - places[ends[1]], axis=1)
        graph = csr_matrix((lengths, ends), shape=(len(places), len(places)))
        _, before = yen(graph, 0, 1, PATHS, directed=False, return_predecessors=True)
        paths = [_short(scenario, even(places[_back(row)], SIGHTS)) for row in before.tolist()]
        kept = _distinct(scenario, paths, kept)
        maps += 1
    return {"prm": time.perf_counter() - began, "maps": maps, "distinct_of_prm": len(kept)}


def _short(scenario: Scenario, path: Array) -> Array:
    """Return a path (k, 3) that goes on from each of its points to the last that is seen from there."""
    way = [0]
    while way[-1] < len(path) - 1:
        ahead = path[way[-1] + 1 :]
        seen = scenario.space.collision.segments_free(np.broadcast_to(path[way[-1]], ahead.shape), ahead)
        way.append(way[-1] + 1 + np.flatnonzero(seen).max(initial=0))
    return even(path[way], SIGHTS)


def _back(before: list[int]) -> list[int]:
    """Return the way from place 0 to place 1."""
    way = [1]
    while way[-1] != 0:
        way.append(before[way[-1]])
    return way[::-1]


def _distinct(scenario: Scenario, paths: list[Array], kept: list[Array]) -> list[Array]:
    """Return paths (SIGHTS, 3) that none before deforms to, after those that are kept."""
    for path in paths:
        if not any(scenario.space.collision.segments_free(path, other).all() for other in kept):
            kept = [*kept, path]
    return kept
