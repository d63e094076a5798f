"""Grow a map of log-odds from scans, cell by cell.

A cell in which a ray of a scan ends is raised, and one that rays only pass is lowered: once per scan, however many rays
there are. Walls fill cells only in part, and rays pass the rest of them. So a ray takes a hit back only

- where it passes the hit itself, not just its cell: within a quarter of a cell, or half the distance to the next ray;
- nearer than the rays next to it end: so an edge is not what is gone;
- where it is above the cells of a wall that it comes down to at a small angle.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from pirrht.arrays import Array, BoolArray
from pirrht.geometry.checks import number, numbers
from pirrht.geometry.scene import Scene, height_of_walls
from pirrht.geometry.solids import cells, occupancy
from pirrht.jit.jit import kernel
from pirrht.mapping.scan import Scan
from pirrht.mapping.tuning import TUNING, MapTuning


class OccupancyMap:
    """A grid in the plane that scans fill; what none has seen is free and unknown.

    A cell counts as wholly occupied once a ray ends in it, so obstacles are larger than they are by up to one cell.

    Args:
        lower, upper: corners, (2,) [m]; the last row and column may reach beyond the upper one.
        cell: side of a cell [m].
        tuning: how much a scan counts.

    Raises:
        SceneError: the corners or the side are no such numbers, or there are too many cells.

    Examples:
        >>> import numpy as np
        >>> from pirrht.mapping.occupancy import OccupancyMap
        >>> from pirrht.mapping.scan import Scan
        >>> grid = OccupancyMap((0, 0), (3, 1), cell=0.5)
        >>> pose = np.array([0.2, 0.2, 0.0])
        >>> grid.integrate(Scan(pose=pose, angles=np.zeros(1), ranges=np.array([1.5]), most=30.0))
        >>> grid.occupied.astype(int).tolist(), grid.unknown.astype(int).tolist()
        ([[0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 0, 0]], [[0, 0, 0, 0, 1, 1], [1, 1, 1, 1, 1, 1]])
        >>> grid.unseen_length(np.array([[0.0, 0.2], [3.0, 0.2]]))
        1.0
    """

    def __init__(
        self, lower: ArrayLike, upper: ArrayLike, cell: float = 0.05, tuning: MapTuning = TUNING
    ) -> None:  # fmt: skip
        self.lower = numbers(lower, (2,), "the lower corner of the map", "x, y [m]")
        high = numbers(upper, (2,), "the upper corner of the map", "x, y [m]")
        self.cell = number(cell, "the side of a cell", "a positive number [m]")
        self.tuning = tuning
        self.version = 0  # another one whenever `occupied` is
        columns, rows = np.maximum(np.ceil((high - self.lower) / self.cell - 1e-6), 1).astype(int).tolist()
        self._seen = np.zeros_like(occupancy(np.broadcast_to(np.False_, (rows, columns)), ("rows", "columns")))
        self._odds = np.zeros((rows, columns))
        self._hits = np.zeros((rows, columns, 2))  # the last one in each cell [cells]
        self._stamps = np.zeros((rows, columns), np.int64)  # of the last scan that changed it
        self._met = np.full((rows, columns), -tuning.recent)  # scan that hit it first after it had been free
        self._scans = 0

    def __repr__(self) -> str:
        rows, columns = self._odds.shape
        return f"OccupancyMap({rows} x {columns} cells of {self.cell:g} m, {self.occupied.sum()} occupied)"

    @property
    def occupied(self) -> BoolArray:
        """Return which cells (rows, columns) are occupied; the first row is the lowest."""
        return np.asarray(self._odds > 0.0)

    @property
    def unknown(self) -> BoolArray:
        """Return which cells (rows, columns) no ray has reached."""
        return ~self._seen

    def integrate(self, scan: Scan, free_around: float = 0.0, passing: BoolArray | None = None) -> None:
        """Raise the cells that a scan hits and lower those that its rays pass, up to the border.

        `free_around`: radius [m] of a disc about the sensor that the robot fills: cells with their centre in it are
        free whatever was seen. `passing`: which rays (k,) hit what is only passing, and raise no cell; None: none.
        A ray that hit nothing lowers cells up to the greatest range.
        """
        self._scans += 1
        stays = scan.ranges / self.cell
        stays = stays if passing is None else np.where(passing, np.inf, stays)
        place = (scan.pose[:2] - self.lower) / self.cell
        changed = _integrate(
            self._odds, self._seen, self._hits, self._stamps, self._met, self._scans, place, scan.angles + scan.pose[2],
            scan.ranges / self.cell, stays, scan.most / self.cell, free_around / self.cell, self.tuning,
        )  # fmt: skip
        self.version += bool(changed)

    def unseen(self, points: Array) -> BoolArray:
        """Return which of the places (k, 2) [m] lie in cells of the map that no ray has reached."""
        rows, columns = self._odds.shape
        column, row = np.floor((points - self.lower) / self.cell).astype(int).T
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        return np.asarray(inside & ~self._seen[np.where(inside, row, 0), np.where(inside, column, 0)])

    def surprises(self, points: Array) -> BoolArray:
        """Return which of the places (k, 2) [m] are where it had been free a while ago, walls and their cells aside."""
        rows, columns = self._odds.shape
        at = np.floor((points - self.lower) / self.cell).astype(int)
        inside = np.all((at >= 1) & (at < (columns - 1, rows - 1)), axis=1)
        column, row = np.where(inside[:, None], at, 1).T
        found = inside & self._seen[row, column]
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                cell = row + i, column + j
                found &= (self._odds[cell] <= 0.0) | (self._scans - self._met[cell] < self.tuning.recent)
        return np.asarray(found)

    def clear(self, center: Array, radius: float) -> None:
        """Free the cells whose centre is in a disc at x, y (2,) [m]; unknown ones stay unknown."""
        low = np.maximum(np.floor((center - radius - self.lower) / self.cell).astype(int), 0)
        high = np.maximum(np.ceil((center + radius - self.lower) / self.cell).astype(int), 0)
        part = self._odds[low[1] : high[1], low[0] : high[0]]
        row, column = np.indices(part.shape)
        x, y = self.lower + self.cell * (low + 0.5) - center
        inside = np.hypot(x + self.cell * column, y + self.cell * row) < radius
        self.version += bool(np.any(inside & (part > 0.0)))
        part[inside] = np.minimum(part[inside], self.tuning.least)

    def scene(self, base: Scene, occupied: BoolArray | None = None) -> Scene:
        """Return a scene in the plane in which boxes over just the occupied cells are the static obstacles.

        `occupied`: cells (rows, columns) that were at some time; None: those that are now.
        """
        occupied = self.occupied if occupied is None else occupied
        return replace(base, obstacles=cells(occupied, self.cell, self.lower, height_of_walls(base.robot_height)))

    def unseen_length(self, points: Array) -> float:
        """Return the length [m] that a polyline through points (k, 2) [m] has in unknown cells and off the map."""
        return self.cell * float(_unseen(self._seen, (points - self.lower) / self.cell))


@kernel
def _integrate(odds, seen, hits, stamps, met, scan, place, angles, ranges, stays, most, around, tuning):  # type: ignore[no-untyped-def]
    """Change a grid by a scan, lengths in cells; return whether other cells are occupied than before."""
    rows, columns = odds.shape
    x, y = place
    was = odds > 0.0
    _raise(odds, seen, hits, stamps, met, scan, place, angles, stays, tuning)
    _lower(odds, seen, hits, stamps, scan, place, angles, ranges, most, tuning)
    for row in range(max(0, int(y - around)), min(rows, int(y + around) + 1)):
        for column in range(max(0, int(x - around)), min(columns, int(x + around) + 1)):
            if np.hypot(column + 0.5 - x, row + 0.5 - y) < around:
                odds[row, column] = tuning.least
                seen[row, column] = True
    return np.any((odds > 0.0) != was)


@kernel
def _raise(odds, seen, hits, stamps, met, scan, place, angles, ranges, tuning):  # type: ignore[no-untyped-def]
    """Raise the cells in which rays end."""
    rows, columns = odds.shape
    for i in np.flatnonzero(np.isfinite(ranges)):
        far = ranges[i] + tuning.into
        x = place[0] + far * np.cos(angles[i])
        y = place[1] + far * np.sin(angles[i])
        if 0.0 <= x < columns and 0.0 <= y < rows:
            row, column = _hit_cell(odds, x, y, tuning.slack)
            hits[row, column] = min(max(x, column), column + 1), min(max(y, row), row + 1)
            if stamps[row, column] != scan:
                stamps[row, column] = scan
                if odds[row, column] <= 0.0:
                    met[row, column] = scan if seen[row, column] else -tuning.recent
                odds[row, column] = min(odds[row, column] + tuning.hit, tuning.most)
                seen[row, column] = True


@kernel
def _lower(odds, seen, hits, stamps, scan, place, angles, ranges, most, tuning):  # type: ignore[no-untyped-def]
    """Lower the cells that rays pass, unless this scan has changed them."""
    rows, columns = odds.shape
    x, y = place
    crossed = np.empty((rows + columns + 3, 2), np.int64)
    begins = np.empty(rows + columns + 4)
    for i in np.flatnonzero(ranges > -np.inf):
        far = min(ranges[i], most)
        until, apart = _surely_free(angles, ranges, i, far, tuning.grazing)
        along = np.cos(angles[i])
        across = np.sin(angles[i])

        for k in range(_crossed(x, y, far * along, far * across, rows, columns, crossed, begins)):
            row, column = crossed[k]
            seen[row, column] = True
            if odds[row, column] > 0.0:
                past = far * begins[k + 1]
                off = abs((hits[row, column, 0] - x) * across - (hits[row, column, 1] - y) * along)
                if past > until or off > max(tuning.near, 0.5 * past * apart):
                    continue
            if stamps[row, column] != scan:
                stamps[row, column] = scan
                odds[row, column] = max(odds[row, column] - tuning.free, tuning.least)


@kernel
def _surely_free(angles, ranges, i, far, grazing):  # type: ignore[no-untyped-def]
    """Return how far ray i takes hits back, and the angle to its neighbours, the greater one."""
    apart = 0.0
    slope = np.inf
    nearest = far
    for j in (i - 1, i + 1):
        if 0 <= j < len(angles):
            between = abs(angles[j] - angles[i])
            apart = max(apart, between)
            nearest = min(nearest, ranges[j])
            slope = min(slope, abs(ranges[j] - ranges[i]) / (ranges[i] * between))
    return min(nearest, far - grazing * slope) if np.isfinite(ranges[i]) else nearest, apart


@kernel
def _hit_cell(odds, x, y, slack):  # type: ignore[no-untyped-def]
    """Return the cell, row and column, of a hit: its own one, unless only one within a slack of it is occupied."""
    rows, columns = odds.shape
    row = int(y)
    column = int(x)
    if odds[row, column] > 0.0:
        return row, column
    for i in range(max(int(y - slack), 0), min(int(y + slack), rows - 1) + 1):
        for j in range(max(int(x - slack), 0), min(int(x + slack), columns - 1) + 1):
            if odds[i, j] > 0.0:
                return i, j
    return row, column


@kernel
def _unseen(seen, points):  # type: ignore[no-untyped-def]
    """Return the length of a polyline outside the cells that were seen, in cells."""
    rows, columns = seen.shape
    crossed = np.empty((rows + columns + 3, 2), np.int64)
    begins = np.empty(rows + columns + 4)
    length = 0.0
    for i in range(len(points) - 1):
        x, y = points[i]
        along = points[i + 1, 0] - x
        across = points[i + 1, 1] - y
        share = 1.0
        for k in range(_crossed(x, y, along, across, rows, columns, crossed, begins)):
            if seen[crossed[k, 0], crossed[k, 1]]:
                share -= begins[k + 1] - begins[k]
        length += share * np.hypot(along, across)
    return length


@kernel
def _crossed(x, y, along, across, rows, columns, cells, begins):  # type: ignore[no-untyped-def]
    """Fill in the cells of a grid that a segment crosses, row and column, and at which share of it each begins.

    The share at which the last one ends follows. Return the number of cells.
    """
    along = along if abs(along) > 1e-12 else 1e-12
    across = across if abs(across) > 1e-12 else 1e-12
    right = along > 0.0
    up = across > 0.0
    first = max(0.0, ((0 if right else columns) - x) / along, ((0 if up else rows) - y) / across)
    last = min(1.0, ((columns if right else 0) - x) / along, ((rows if up else 0) - y) / across)
    if not first < last:
        return 0
    column = min(max(int(x + first * along), 0), columns - 1)
    row = min(max(int(y + first * across), 0), rows - 1)

    count = 0
    begins[0] = first
    while begins[count] < last and 0 <= column < columns and 0 <= row < rows:
        cells[count] = row, column
        next_column = (column + right - x) / along
        next_row = (row + up - y) / across
        count += 1
        begins[count] = min(next_column, next_row, last)
        if next_column < next_row:
            column += 1 if right else -1
        else:
            row += 1 if up else -1
    return count
