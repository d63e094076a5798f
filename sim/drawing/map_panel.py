"""A map of what a robot knows, as a panel of pictures: cells, the last scan, references, path, robot and goal."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.scene import Scene
from pirrht.mapping.believed import Believed
from pirrht.plotting.colors import Color, blend
from pirrht.plotting.strokes import rings
from sim.drawing.colors import DRIVEN
from sim.drawing.known import SCAN, Shades, shades
from sim.drawing.strokes import at_most

MOST = 0.5  # share of a picture that is the panel's at most
FINER = 2  # times as many pixels are drawn, and averaged
GROUND: Color = (20, 23, 26)
GOAL: Color = (44, 118, 66)
PATH = blend(DRIVEN, (0, 0, 0), 0.15)
PATH_POINTS = 300
DOT, THIN, THICK = 1.6, 1.5, 3.0  # of the scan, references, path and robot [px]


class Panel:
    """Draws panels at the right of pictures of a size, width and height, as wide as the map asks for."""

    def __init__(self, scene: Scene, size: tuple[int, int]) -> None:
        self._body, self._goal = scene.body, scene.goal
        wide, high = scene.upper - scene.lower
        self.width = 2 * round(0.5 * min(MOST * size[0], size[1] * wide / high))
        self._size = FINER * self.width, FINER * size[1]
        self._scale = min(self._size[0] / wide, self._size[1] / high)  # [px/m]
        self._corner = 0.5 * np.subtract(self._size, self._scale * np.array([wide, -high]))  # lower left one [px]
        self._lower = scene.lower

    def draw(self, known: Believed | None, lines: Sequence[tuple[Array, Color, float]], poses: Array) -> Shades:
        """Return a panel (height, width, 3): what is known, lines (k, 2), colours and weights, and the path (k, 3)."""
        from PIL import Image, ImageDraw

        picture = Image.new("RGB", self._size, GROUND)
        canvas = ImageDraw.Draw(picture)
        pose = poses[-1]
        if known is not None:
            self._cells(picture, known)
            pose = pose + known.error
        spread = self._scale * self._goal.radius
        self._disc(canvas, self._goal.center, spread, outline=GOAL, width=round(FINER * THICK))
        for line, color, weight in lines:
            self._line(canvas, line, color, THIN + THICK * weight)
        self._line(canvas, at_most(poses[:, :2], PATH_POINTS), PATH, THICK)
        if known is not None and known.scan is not None:
            for point in known.scan.points:
                self._disc(canvas, point, FINER * DOT, fill=SCAN)
        ring = rings(self._body, pose[None])[0]
        canvas.polygon(self._pixels(ring), fill=DRIVEN)
        self._line(canvas, ring, GROUND, THIN)
        return np.asarray(picture.resize((self.width, self._size[1] // FINER), Image.Resampling.BOX))

    def _cells(self, picture: Any, known: Believed) -> None:
        """Paste the map, cell by cell as they are."""
        from PIL import Image

        ends = np.array([[known.lower[0], known.upper[1]], [known.upper[0], known.lower[1]]])
        (left, top), (right, bottom) = np.rint(np.reshape(self._pixels(ends), (2, 2))).astype(int).tolist()
        cells = Image.fromarray(shades(known))
        picture.paste(cells.resize((right - left, bottom - top), Image.Resampling.NEAREST), (left, top))

    def _line(self, canvas: Any, line: Array, color: Color, width: float) -> None:
        canvas.line(self._pixels(line), fill=color, width=round(FINER * width), joint="curve")

    def _disc(self, canvas: Any, center: Array, radius: float, **look: Any) -> None:
        """Draw a disc around a place [m], of a radius [px]."""
        x, y = self._pixels(center[None])
        canvas.ellipse([x - radius, y - radius, x + radius, y + radius], **look)

    def _pixels(self, points: Array) -> list[float]:
        """Return places (k, 2) [m] as x and y in turn [px]."""
        away = self._scale * (points[:, :2] - self._lower) * (1.0, -1.0)
        return list((self._corner + away).ravel().tolist())
