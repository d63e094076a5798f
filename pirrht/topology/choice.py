"""Choose the obstacles and the signature of a scene: the one place that names kinds of signatures."""

from collections.abc import Sequence

import numpy as np

from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Scene
from pirrht.topology.homology import Homology
from pirrht.topology.linking import Linking
from pirrht.topology.nerve import Loop, continued_loops, loops
from pirrht.topology.obstacles import Component, components, continued
from pirrht.topology.signature import Signature


def obstacles_of(collision: Collision) -> tuple[Component, ...]:
    """Find the topological obstacles of a world, in the plane or in space; those with a marker have turns."""
    return components(collision) if len(collision.world.lower) == 2 else loops(collision)


def continued_in(
    parts: Sequence[Component], before: Sequence[Component], collision: Collision, named: int, earlier: Collision
) -> tuple[tuple[Component, ...], tuple[int, ...]]:
    """Return the obstacles of a changed world that have turns, in the order of earlier ones, then new ones.

    `earlier` has the solids of before. The second result are the numbers of those whose marker has moved.
    """
    if len(collision.world.lower) == 3:
        return continued_loops(collision, before, named), ()
    return continued(parts, before, collision, named, earlier)


def signature_of(
    scene: Scene, encircled: Sequence[Component], named: int | None = None, moved: tuple[int, ...] = ()
) -> Signature:
    """Choose the signature about obstacles with markers (d,) [m], and the moving ones of a scene.

    Names of classes give `named` turns at least; None: all of them. Markers `moved` lie elsewhere in their obstacles
    than before.
    """
    goal = scene.goal.center.astype(float)
    if scene.dimension == 3:
        return Linking(
            loops=tuple(part.corners for part in encircled if isinstance(part, Loop)), goal=goal, named=named
        )
    markers = np.array([part.marker for part in encircled if part.marker is not None]).reshape(-1, 2)
    return Homology(markers=markers, goal=goal, named=named, moved=moved).with_moving(scene.movers, scene.footprint)
