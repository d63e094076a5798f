"""What a robot with a lidar knows, in a recording, where that has changed.

/map/cells            its map, from above; on it, in cells, `scan` and `robot`, where it believes to be
/world/map/cells      the same on the floor
/world/map/obstacles  obstacles of the plan; `numbers` of those that paths can turn about
/world/map/scan       where rays of the last scan ended; `fan` is what they passed
/world/map/robot      where the robot believes to be, if it is elsewhere
"""

from typing import Any

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.mapping.believed import Believed
from pirrht.mapping.scan import Scan
from pirrht.plotting.colors import blend
from pirrht.plotting.strokes import rings
from sim.drawing.known import OCCUPIED, SCAN, UNKNOWN, seen_area, shades
from sim.drawing.strokes import lift
from sim.recording.stage import CONTROL, FLOOR
from sim.recording.subject import Moment, Stream, Subject

RAYS = 120  # of a fan at most
DARK = blend(UNKNOWN, FLOOR, 0.5)  # unknown cells on the floor
LOW = 0.05  # height of obstacles of the plan [m]
PASSED = (*SCAN, 12)  # see-through
LOOK = {"radii": 0.012, "colors": [SCAN]}  # of the outline of a robot


class Known:
    """Logs what is known when a plan is made into one recording stream."""

    def __init__(self, stream: Stream, subject: Subject) -> None:
        self._stream = stream
        self._scene = subject.loaded.scene
        self._last: Believed | None = None
        self._space: Any = None  # of the last plan

    def draw(self, known: Believed, subject: Subject, pose: Array, moment: Moment) -> None:
        """Log what is known, in the context of a plan at a pose (3,), at a step and simulated time [s]."""
        if self._last is None:
            self._begin(known)
        if self._last is None or known.scan is not self._last.scan:
            self._cells(known, moment)
            if known.scan is not None:
                self._scan(known, known.scan, moment)
        self._last = known
        if subject.space is not self._space:
            self._space = subject.space
            self._obstacles(subject, moment)
        ring = rings(self._scene.body, (pose + known.error)[None])[0]
        self._stream.log("/map/robot", *moment, rr.LineStrips2D([_in_cells(known, ring)]))
        if known.error.any():
            self._stream.log("/world/map/robot", *moment, rr.LineStrips3D([lift(ring, 0.04)], **LOOK))

    def _begin(self, known: Believed) -> None:
        """Log what stays as it is: the floor that bears the map, and looks."""
        low, high = known.lower, known.upper
        corners = np.array([(low[0], high[1]), high, (high[0], low[1]), low])
        floor = {"triangle_indices": [(0, 2, 1), (0, 3, 2)], "vertex_texcoords": [(0, 0), (1, 0), (1, 1), (0, 1)]}
        self._stream.static("/world/map/cells", rr.Mesh3D(vertex_positions=lift(corners, 0.001), **floor))
        self._stream.static("/map/robot", rr.LineStrips2D.from_fields(colors=[SCAN], radii=rr.Radius.ui_points(2.0)))
        self._stream.static("/map/scan", rr.Points2D.from_fields(colors=[SCAN], radii=rr.Radius.ui_points(1.5)))
        self._stream.static("/world/map/scan", rr.Points3D.from_fields(colors=[SCAN], radii=rr.Radius.ui_points(2.0)))
        self._stream.static("/world/map/fan", rr.Mesh3D.from_fields(albedo_factor=PASSED))
        boxes = {"colors": [OCCUPIED], "fill_mode": "solid"}
        self._stream.static("/world/map/obstacles", rr.Boxes3D.from_fields(**boxes))

    def _cells(self, known: Believed, moment: Moment) -> None:
        """Log the map: as a picture, and as the texture of the floor."""
        self._stream.log("/map/cells", *moment, rr.Image(shades(known)))
        dark = shades(known, FLOOR, DARK)
        size = rr.components.ImageFormat(
            width=dark.shape[1], height=dark.shape[0], color_model="RGB", channel_datatype="U8"
        )
        texture = {"albedo_texture_buffer": dark.tobytes(), "albedo_texture_format": size}
        self._stream.log("/world/map/cells", *moment, rr.Mesh3D.from_fields(**texture))

    def _scan(self, known: Believed, scan: Scan, moment: Moment) -> None:
        """Log where rays ended, and what they passed."""
        self._stream.log("/map/scan", *moment, rr.Points2D(_in_cells(known, scan.points)))
        self._stream.log("/world/map/scan", *moment, rr.Points3D(lift(scan.points, self._scene.robot_height)))
        corners = lift(seen_area(scan, RAYS, known.lower, known.upper), 0.02)
        k = np.arange(1, len(corners) - 1, dtype=np.uint32)
        faces = np.column_stack([np.zeros_like(k), k, k + 1])
        self._stream.log(
            "/world/map/fan", *moment, rr.Mesh3D.from_fields(vertex_positions=corners, triangle_indices=faces)
        )

    def _obstacles(self, subject: Subject, moment: Moment) -> None:
        """Log the obstacles that the plan knows, low ones, and numbers of those that paths can turn about."""
        solids = subject.space.scene.obstacles
        sizes = np.array([solid.size for solid in solids]).reshape(-1, 3)
        sizes[:, 2] = 0.5 * LOW
        middles = lift(np.array([solid.position[:2] for solid in solids]).reshape(-1, 2), 0.5 * LOW)
        boxes = {"centers": middles, "half_sizes": sizes}
        self._stream.log("/world/map/obstacles", *moment, rr.Boxes3D.from_fields(**boxes))
        there = [k for k, part in enumerate(subject.space.obstacles) if part.members]  # others are gone
        markers = lift(subject.space.homology.markers[there], 0.1)
        texts = [str(k + 1) for k in there]
        look = {"radii": 0.0, "colors": [CONTROL], "show_labels": True}
        self._stream.log("/world/map/numbers", *moment, rr.Points3D(markers, labels=texts, **look))


def _in_cells(known: Believed, points: Array) -> Array:
    """Return points (k, 2) [m] in cells from the upper left corner of a map, to the right and down."""
    across = (points - known.lower) / known.cell
    return np.column_stack([across[:, 0], known.unknown.shape[0] - across[:, 1]]).astype(np.float32)
