"""Go on among other static obstacles: a new tree, and what a run knows of classes whose paths are still free."""

import reprlib
from dataclasses import fields, replace
from numbers import Integral
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.run_state import RunState
from pirrht.control.settings import TUNING
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.motion import SPACING
from pirrht.topology.signature import integers

Renewed = tuple[Problem, FreeSpace, HomologyTree | None]  # what a controller needs to know of another scene


def renewed(
    problem: Problem, space: FreeSpace, tree: HomologyTree | None, scene: Scene, vertices: int | None
) -> Renewed | None:
    """Return problem, free space and tree of so many vertices in another scene, or None; see `Controller.update`."""
    _refuse_others(problem, space, tree, scene, vertices)
    before = space.scene
    parts = "lower", "upper", "footprint", "robot_height"
    alike = all(np.array_equal(getattr(before, part), getattr(scene, part)) for part in parts)
    if alike and len(before.obstacles) == len(scene.obstacles) and all(map(_same, before.obstacles, scene.obstacles)):
        return None
    now = space.updated(replace(scene, waivers=before.waivers))
    grown = None
    if tree is not None:
        grown = HomologyTree(now, tree.steering, limit=tree.limit, classes=tree.classes, rng=tree.rng)
        wanted = tree.size if vertices is None else vertices
        grown.extend_by(kept_states(tree, round(TUNING.kept * wanted)))
        grown.grow(wanted)
    return replace(problem, scene=scene), now, grown


def _refuse_others(
    problem: Problem, space: FreeSpace, tree: HomologyTree | None, scene: Scene, vertices: int | None
) -> None:  # fmt: skip
    """Refuse what is no scene, has another goal, or moves, and what is no number of vertices."""
    if not isinstance(scene, Scene):
        raise OptionError(f"an update is to a Scene, and {reprlib.repr(scene)} is none; Scene.from_boxes makes one")
    if vertices is not None and not (isinstance(vertices, Integral) and vertices >= 1):
        raise OptionError(f"vertices is {reprlib.repr(vertices)}; it must be a whole number of at least 1, or None")
    before = space.scene
    goal = problem.scene.goal
    if not _same(goal, scene.goal):
        raise OptionError(f"an update keeps the goal, {goal}; for {scene.goal} make another Controller")
    timed = tree is None or tree.steering.timed
    if scene.movers or (timed and before.movers):
        raise OptionError(
            f"an update changes static obstacles, and {len(scene.movers or before.movers)} move here; make another "
            "Controller"
        )


def kept_states(tree: HomologyTree, most: int) -> Array:
    """Return states (k, n) of the vertices of a tree, in their order, for a tree in another scene; `most` at most."""
    chosen = np.arange(tree.size)
    if tree.size > most:
        chosen = np.sort(tree.rng.choice(tree.size, most, replace=False))
    return np.asarray(tree.states[chosen])


def continue_among(space: FreeSpace, run: RunState) -> None:
    """Continue a run among other static obstacles; classes keep their names, and memory while their paths are free."""
    path = run.route.path
    starts = run.starts
    before = run.route.homology
    goal = space.scene.goal.center

    run.route.enter(space.homology)
    rests = {whole: guide.rest(run.clock.since_plan, goal) for whole, (guide, *_) in starts.optima.items()}
    lines = {whole: np.vstack(one.points(SPACING)) for whole, one in starts.paths.items()}
    lines |= {whole: rest.points for whole, rest in rests.items() if rest is not None}
    free = [whole for whole, line in lines.items() if space.segments_free(line)]
    ahead = [space.homology.winding(np.vstack([path.here, lines[whole]])) for whole in free]
    heirs = {whole: integers(np.add(path.winding(), one)) for whole, one in zip(free, ahead, strict=True)}
    run.rename(heirs, {before.name(then): space.homology.name(now) for then, now in heirs.items()})


def _same(one: Any, other: Any) -> bool:
    """Compare two records by value."""
    pairs = ((getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    return one is other or all(np.array_equal(mine, its) for mine, its in pairs)
