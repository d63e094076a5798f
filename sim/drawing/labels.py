"""Places for labels in a picture: off walls, off lines, off each other, and inside its edges."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from sim.plotting.ground import hull

Lines = NDArray[np.floating[Any]]

CELL, EVERY = 4.0, 2  # width of a cell [px]; cells from one place that a label may have to the next
LETTER, PADDING, HEIGHT = 6.3, 14.0, 23.0  # of labels as Rerun's viewer draws them [px]
BELOW = 3.0  # from the point that bears a label down to the label [px]
COVERED, TOUCHED = 900.0, 70.0  # what covering everything and anything costs, as a distance [px]
FIXED = 2.5  # weight of the distance of labels that stay: what they belong to has no colour that tells
STRADDLED = 60.0  # what a label that stays costs half on a solid and half off it [px]
FAINT = 0.2  # weight of what labels may cover if they must: samples, branches
LABEL = 3.0  # weight of a label, over that of a line
MOVED = 0.4  # what a move from where a label was costs, over the distance
FAR = 4000.0  # beyond which nothing is drawn [px]


class Sheet:
    """A picture as a grid of cells: which of them solids cover, and which of them lines and labels do.

    Points are in pixels from the upper left corner, x to the right and y down.

    Args:
        width: of the picture [px].
        height: of the picture [px].

    Examples:
        >>> sheet = Sheet(400.0, 200.0)
        >>> sheet.stroke(np.array([[0.0, 100.0], [400.0, 100.0]]))
        >>> x, y = sheet.place("a label", np.array([[200.0, 100.0]]))
        >>> bool(y + BELOW + HEIGHT < 100.0 or y + BELOW > 100.0)
        True
    """

    def __init__(self, width: float, height: float) -> None:
        shape = max(1, int(height / CELL)), max(1, int(width / CELL))
        self._solid, self._drawn = np.zeros(shape), np.zeros(shape)

    def copy(self) -> Sheet:
        """Return a sheet with the same cells covered, to be covered further."""
        found = Sheet.__new__(Sheet)
        found._solid, found._drawn = self._solid.copy(), self._drawn.copy()
        return found

    def fill(self, corners: Array) -> None:
        """Cover a convex solid with corners (k, 2) [px]."""
        rows, columns = self._solid.shape
        low = np.clip(np.floor(corners.min(axis=0) / CELL), 0, (columns, rows)).astype(int)
        high = np.clip(np.ceil(corners.max(axis=0) / CELL), 0, (columns, rows)).astype(int)
        x, y = (CELL * (np.arange(a, b) + 0.5) for a, b in zip(low, high, strict=True))
        off = np.stack(np.meshgrid(x, y), axis=-1)[:, :, None] - corners  # (rows, columns, k, 2)
        edge = np.roll(corners, -1, axis=0) - corners
        side = edge[:, 0] * off[..., 1] - edge[:, 1] * off[..., 0]
        inside = np.all(side >= 0.0, axis=-1) | np.all(side <= 0.0, axis=-1)
        part = self._solid[low[1] : high[1], low[0] : high[0]]
        part[inside] = 1.0
        self.stroke(np.vstack([corners, corners[:1]]), solid=True)  # what is thinner than a cell

    def stroke(self, line: Array, *, solid: bool = False) -> None:
        """Cover a polyline (k, 2) [px]."""
        line = np.clip(line, -FAR, FAR)
        steps = np.maximum(1, np.ceil(np.abs(np.diff(line, axis=0)).max(axis=1, initial=0.0) / (0.5 * CELL)))
        parts = [np.linspace(a, b, int(n) + 1) for a, b, n in zip(line[:-1], line[1:], steps, strict=True)]
        self.dot(np.vstack([line[:1], *parts]), solid=solid)

    def dot(self, points: Array, *, weight: float = 1.0, solid: bool = False) -> None:
        """Cover points (k, 2) [px], lines with a weight from 0 to 1."""
        cells = self._solid if solid else self._drawn
        x, y = np.floor(np.clip(points, -FAR, FAR) / CELL).astype(int).T
        seen = (x >= 0) & (x < cells.shape[1]) & (y >= 0) & (y < cells.shape[0])
        cells[y[seen], x[seen]] = np.maximum(cells[y[seen], x[seen]], weight)

    def place(self, text: str, line: Array, *, inside: bool = False, before: Array | None = None) -> Array:
        """Return the point (2,) [px] that is to bear a label: its middle, and `BELOW` over its upper edge.

        Args:
            line: points (k, 2) [px] that the label belongs to.
            inside: whether it may lie wholly inside of a solid.
            before: point where the label was in the picture before, which it leaves only for something.
        """
        size = self._size(text)
        solid, drawn = _means(self._solid, size), _means(self._drawn, size)
        covered = drawn if inside else solid + drawn
        covered = covered[::EVERY, ::EVERY]
        y, x = (CELL * (EVERY * np.arange(n) + 0.5 * k) for n, k in zip(covered.shape, size, strict=True))
        middles = np.stack(np.meshgrid(x, y), axis=-1)
        across, along = np.square(x[:, None] - line[:, 0]), np.square(y[:, None] - line[:, 1])
        away = np.sqrt((along[:, None] + across[None]).min(axis=-1))
        cost = away + COVERED * covered + TOUCHED * (covered > 0.01)
        if inside:
            part = solid[::EVERY, ::EVERY]
            cost += (FIXED - 1.0) * away + STRADDLED * 4.0 * part * (1.0 - part)
        shift = np.array([0.0, BELOW + 0.5 * CELL * size[0]])
        if before is not None:
            cost += MOVED * np.hypot(*np.moveaxis(middles - (before + shift), -1, 0))
        i, j = np.unravel_index(int(np.argmin(cost)), cost.shape)
        point: Array = middles[i, j] - shift
        return point

    def cover(self, text: str, point: Array) -> None:
        """Cover a label by the point (2,) [px] that bears it."""
        high, wide = self._size(text)
        i, j = (max(0, round(float(v) / CELL)) for v in (point[1] + BELOW, point[0] - 0.5 * CELL * wide))
        self._drawn[i : i + high, j : j + wide] = LABEL

    def _size(self, text: str) -> tuple[int, int]:
        rows, columns = self._solid.shape
        return min(rows, ceil(HEIGHT / CELL)), min(columns, ceil((LETTER * len(text) + PADDING) / CELL))


@dataclass(frozen=True, slots=True, kw_only=True)
class Eye:
    """Project points of space to pixels and back."""

    position: tuple[float, float, float]  # [m]
    target: tuple[float, float, float]  # that it looks at, in the middle of the picture [m]
    up: tuple[float, float, float]  # what points upward in the picture
    size: tuple[float, float]  # width and height of the picture [px]
    focal: float  # pixels per unit of slope

    @property
    def frame(self) -> Array:
        """Right, down and ahead as rows (3, 3)."""
        ahead = np.subtract(self.target, self.position)
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, self.up)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(ahead, right), ahead])

    def pixels(self, points: Lines) -> Array:
        """Return where points (k, 3) [m] are in the picture, (k, 2) [px]."""
        seen = np.subtract(points, self.position) @ self.frame.T
        found: Array = 0.5 * np.array(self.size) + self.focal * seen[:, :2] / np.maximum(seen[:, 2:], 1e-6)
        return found

    def point(self, pixel: Array, near: Lines) -> Array:
        """Return the point (3,) [m] that is seen at a pixel (2,), as far ahead as the point (3,) nearby is."""
        depth = float(np.subtract(near, self.position) @ self.frame[2])
        ray = np.append((pixel - 0.5 * np.array(self.size)) / self.focal, 1.0)
        found: Array = self.position + depth * ray @ self.frame
        return found


class Labels:
    """Labels of one view, each of which stays where it was unless something comes in its way.

    Args:
        eye: of the view.
    """

    def __init__(self, eye: Eye) -> None:
        self._eye, self._sheet = eye, Sheet(*eye.size)
        self._before: dict[str, Array] = {}

    def fill(self, points: Lines) -> None:
        """Cover the convex hull of points (k, 3) [m] for good."""
        self._sheet.fill(hull(self._eye.pixels(points)))

    def dot(self, points: Lines) -> None:
        """Cover points (k, 3) [m] faintly, for good."""
        self._sheet.dot(self._eye.pixels(points), weight=FAINT)

    def cover(self, text: str, point: Lines) -> None:
        """Cover a label that a point (3,) [m] bears for good."""
        self._sheet.cover(text, self._eye.pixels(point[None])[0])

    def fixed(self, texts: Sequence[str], places: Lines, drawn: Iterable[Lines]) -> list[Array]:
        """Return points (3,) [m] for labels that stay where they are from now on, each on a solid or off all.

        Args:
            places: that they belong to, (k, 3) [m].
            drawn: as for `placed`.
        """
        sheet, found = self._with(drawn), []
        for text, place in zip(texts, places, strict=True):
            pixel = sheet.place(text, self._eye.pixels(place[None]), inside=True)
            sheet.cover(text, pixel)
            self._sheet.cover(text, pixel)
            found.append(self._eye.point(pixel, place))
        return found

    def placed(
        self, texts: Mapping[str, str], lines: Mapping[str, Lines], drawn: Iterable[Lines], faint: Lines | None = None
    ) -> list[Array]:
        """Return points (3,) [m] for labels of lines, by name, the first ones first.

        Args:
            lines: parts (k, 3) of each line that its label is to be near [m].
            drawn: polylines (k, 3) [m] of this picture that labels are to keep off.
            faint: points (k, 3) [m] that they cover if they must.
        """
        sheet, found = self._with(drawn), []
        if faint is not None:
            sheet.dot(self._eye.pixels(faint), weight=FAINT)
        for name, text in texts.items():
            own = self._eye.pixels(lines[name])
            pixel = sheet.place(text, own, before=self._before.get(name))
            self._before[name] = pixel
            sheet.cover(text, pixel)
            nearest = int(np.argmin(np.square(own - pixel).sum(axis=1)))
            found.append(self._eye.point(pixel, lines[name][nearest]))
        return found

    def _with(self, drawn: Iterable[Lines]) -> Sheet:
        sheet = self._sheet.copy()
        for line in drawn:
            sheet.stroke(self._eye.pixels(line))
        return sheet


def _means(cells: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.float64]:
    """Mean over every box of a size in cells, by its first cell."""
    h, w = size
    total = np.pad(cells, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    found: NDArray[np.float64] = (total[h:, w:] - total[:-h, w:] - total[h:, :-w] + total[:-h, :-w]) / (h * w)
    return found
