"""An office with doors and furniture, and a warehouse with racks."""

from worlds import meshes
from worlds.page import Page, box, drum, seen

WALL = 0.1  # thickness [m]


Span = tuple[float, float]  # from and to [m]


def wall(name: str, axis: str, at: float, ends: Span, *doors: Span) -> list[str]:
    """A wall along x or y, at a place of the other axis, from end to end, left open at doors."""
    edges = [ends[0], *(edge for door in doors for edge in door), ends[1]]
    across = (at - WALL / 2, at + WALL / 2)
    pieces = [
        (piece, across) if axis == "x" else (across, piece) for piece in zip(edges[::2], edges[1::2], strict=True)
    ]
    return [box(f"{name} {i}", *piece) for i, piece in enumerate(pieces, 1)]


def office() -> Page:
    """Two rows of rooms along a corridor."""
    assets = [
        meshes.asset("desk", meshes.desk()),
        meshes.asset("shelf", meshes.shelf()),
        meshes.asset("table", meshes.round_table()),
    ]
    walls = [
        *wall("south wall", "x", 2.95, (0.0, 10.0), (2.35, 3.05), (4.75, 5.45), (7.35, 8.05)),
        *wall("north wall", "x", 4.15, (0.0, 10.0), (2.2, 2.9), (5.9, 6.5), (8.6, 9.3)),
        *wall("study wall", "y", 3.4, (0.0, 2.9), (0.55, 1.15)),
        *wall("meeting wall", "y", 6.8, (0.0, 2.9), (0.55, 1.2)),
        *wall("store wall", "y", 5.0, (4.2, 7.0), (5.9, 6.6)),
    ]
    furniture = [
        meshes.placed("desk", "desk", 1.2, 2.15, 0.0, "wood"),
        meshes.placed("meeting table", "table", 5.1, 1.55, 0.0, "oak"),
        meshes.placed("second desk", "desk", 8.9, 1.0, 90.0, "wood"),
        meshes.placed("kitchen table", "table", 2.5, 5.75, 0.0, "oak"),
        meshes.placed("left shelf", "shelf", 6.75, 5.35, 0.0, "wood"),
        meshes.placed("right shelf", "shelf", 8.6, 6.05, 90.0, "wood"),
        drum("plant", 6.35, 3.55, 0.16, 0.35, "brick"),
        drum("stool", 4.0, 2.3, 0.17, 0.45, "fabric"),
    ]
    return Page(
        name="office",
        about="Rooms, doors, furniture: along the corridor, left or right of the plant, or through the meeting room.",
        why="Rooms along a corridor. Desks, shelves and tables are meshes, and count as their convex hulls.",
        size=(10.0, 7.0),
        start=(0.7, 0.8),
        goal=(9.5, 6.5, 0.3),
        settings={"vertices": 2000, "limit": 0.8},
        assets=assets,
        elements=[*walls, *furniture, seen("ellipsoid", "6.35 3.55 0.5", "0.22 0.22 0.2", "moss")],
    )


def warehouse() -> Page:
    """Three rows of racks: narrow aisles between them, wide ones across."""
    rows, columns, parts = (1.3, 2.35, 4.4, 5.0, 6.7), (2.2, 5.2, 8.2), []
    for i, y in enumerate(rows, 1):
        for j, x in enumerate(columns, 1):
            parts.append(box(f"rack {i}{j}", (x, x + 2.3), (y, y + 0.45), 0.6, "steel"))
            parts += [
                seen("box", f"{x + 0.4 + 0.75 * k:g} {y + 0.225:g} 0.7", "0.25 0.18 0.1", "carton")
                for k in range(3)
                if (i + j + k) % 4
            ]
    parts += [box("pallet", (6.5, 6.9), (3.3, 3.65), 0.25, "carton"), drum("pillar", 4.85, 3.6, 0.15, 1.0, "wall")]
    return Page(
        name="warehouse",
        about="Racks, and a pillar and a forgotten pallet in the aisle: which side of each, or between the racks?",
        why="Fifteen racks, a pallet that someone left in the wide aisle, and a pillar.",
        size=(12.0, 8.4),
        start=(0.8, 2.0),
        goal=(11.2, 4.0, 0.35),
        settings={"vertices": 2000, "limit": 0.8},
        elements=parts,
    )
