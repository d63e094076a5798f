"""Choose the limit H_limit of |1 - H_i| by which a tree holds every class that is short."""

import itertools
from collections.abc import Callable

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import NoReference
from pirrht.freespace import FreeSpace
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.planner.tuning import LIMITS
from pirrht.steering.steering import Steering


def grown_tree(
    space: FreeSpace, steering: Steering, x: Array, vertices: int = 1000, *, limit: float = 0.6, classes: int = 16,
    seed: int | np.random.SeedSequence = 0, progress: Callable[[int], None] | None = None,
) -> HomologyTree:  # fmt: skip
    """Grow a tree whose limit gives way to the short classes at a state x (n,).

    The limit is the least of `limit`, 0.8, 1 and 1.5 with which the tree holds every class whose path is at most 1.5
    times as long as the shortest, or as many as `classes` allows. A small tree within the greatest limit finds these
    paths. Only turns about static obstacles count. The limit gives way as well where no
    class reaches the goal.

    Args:
        space: the examined scene.
        steering: the obstacle-blind two-point optimum.
        x: a state of the system, for instance at the start.
        vertices: how many the tree has.
        limit: H_limit to begin with [turns].
        classes: keep at most so many cheapest classes per vertex; 0 keeps all.
        seed: of the random states.
        progress: called with the number of vertices now and then.

    Examples:
        >>> import numpy as np
        >>> from pirrht import *
        >>> room = {"lower": (0, 0), "upper": (4, 3), "start": (0.6, 1.4), "goal": (3.4, 1.5, 0.3)}
        >>> scene = Scene.from_boxes([[1.6, 1.1, 2.4, 1.9]], robot_radius=0.2, **room)
        >>> problem = Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=2.0 * np.eye(2))
        >>> tree = grown_tree(FreeSpace.of(scene), StraightLine.of(problem), scene.start[:2], vertices=100)
        >>> tree.limit, len(tree.references(scene.start[:2]))
        (0.6, 2)

    Raises:
        OptionError, SceneError: x is no state, or lies outside the workspace or in an obstacle.
    """
    space.refuse_start(steering.checked(x, 0.0))
    x = np.asarray(x, dtype=float)

    def grown(limit: float, vertices: int = vertices) -> HomologyTree:
        tree = HomologyTree(space, steering, limit=limit, classes=classes, rng=np.random.default_rng(seed))
        tree.grow(vertices, progress=progress)
        return tree

    def references(tree: HomologyTree) -> list[Reference]:
        try:
            return tree.references(tree.at(x, 0.0))
        except NoReference:
            return []

    first = grown(limit)
    short: list[Reference] = []
    if len(space.homology.markers):
        found = references(grown(LIMITS.wider[-1], min(vertices, LIMITS.vertices)))
        longest = LIMITS.longer * min((one.length for one in found), default=0.0)
        short = sorted((one for one in found if one.length <= longest), key=lambda one: one.length)
    needed = [space.homology.most_turned(one.trajectory.points) for one in short]
    if needed and needed[0] <= limit < max(needed):
        held = sum(one.length <= longest for one in references(first))
        needed = needed[:1] if held == classes else needed
    least = min(max(needed, default=0.0), LIMITS.wider[-1])
    wider = (grown(wide) for wide in LIMITS.wider if wide > limit and wide >= least)
    trees = itertools.chain([first] if least <= limit else [], wider)
    return next((tree for tree in trees if tree.lengths(tree.at(x, 0.0))), first)
