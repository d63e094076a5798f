"""Choose the signature of a scene: the one place that names kinds of signatures."""

from collections.abc import Sequence

import numpy as np

from pirrht.geometry.scene import Scene
from pirrht.topology.homology import Homology
from pirrht.topology.obstacles import Component
from pirrht.topology.signature import Signature


def signature_of(scene: Scene, encircled: Sequence[Component], named: int | None = None) -> Signature:
    """Choose the signature about obstacles with markers (2,) [m], and the moving ones of a scene.

    Names of classes give `named` turns at least; None: all of them.
    """
    markers = np.array([part.marker for part in encircled if part.marker is not None]).reshape(-1, 2)
    return Homology(markers=markers, goal=scene.goal.center.astype(float), named=named).with_moving(
        scene.movers, scene.footprint
    )
