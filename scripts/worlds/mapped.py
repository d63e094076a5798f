"""A house as a robot's map shows it: an occupancy grid in ROS's form, taken over by `pirrht import`'s own code."""

import tempfile
from pathlib import Path

import numpy as np

from sim.importing.ros_map import read_map
from worlds.page import Page

CELL = 0.05  # [m]
FREE, WALL = 254, 0  # grey values
PLAN = (  # x0, x1, y0, y1 [m]; filled walls
    (0.0, 9.0, 0.0, 0.1), (0.0, 9.0, 6.4, 6.5), (0.0, 0.1, 0.0, 6.5), (8.9, 9.0, 0.0, 6.5),
    (3.4, 3.5, 0.0, 0.7), (3.4, 3.5, 1.5, 3.5),  # kitchen | hall
    (0.0, 1.1, 3.4, 3.5), (1.9, 4.78, 3.4, 3.5), (5.18, 6.1, 3.4, 3.5),  # south | north
    (6.1, 6.2, 0.0, 0.8), (6.1, 6.2, 1.6, 3.5),  # hall | living room
    (6.9, 8.9, 3.4, 3.5),
    (4.6, 4.7, 3.5, 4.6), (4.6, 4.7, 5.4, 6.4),  # bedroom | study
)  # fmt: skip
FURNITURE = (
    (0.1, 0.7, 1.1, 2.6),  # counter
    (1.75, 2.55, 1.35, 2.15),  # kitchen table
    (4.35, 5.15, 1.55, 2.15),  # chest in the hall
    (7.2, 8.2, 1.7, 2.2),  # sofa table
    (1.6, 3.3, 4.5, 5.7),  # bed
    (6.3, 7.5, 4.55, 5.15),  # desk
    (8.4, 8.9, 5.0, 6.4),  # bookcase
)


def house() -> Page:
    """Six rooms of a map; its boxes are those that `pirrht import map.yaml` makes."""
    with tempfile.TemporaryDirectory() as folder:
        file = written(Path(folder))
        solids = read_map(file).solids
    elements = []
    for solid in solids:
        size, place = (" ".join(f"{v:.6g}" for v in values) for values in (solid.size, solid.pose[:3, 3]))
        material = "wood" if _furniture(*solid.pose[:2, 3].tolist()) else "wall"
        elements.append(f'<geom name="{solid.name}" type="box" pos="{place}" size="{size}" material="{material}"/>')
    return Page(
        name="house",
        about="A house from an occupancy map: by the narrow study door or the wide one of the living room.",
        why="The boxes are those that `pirrht import` makes of a ROS map: their union are its occupied cells.",
        size=(9.0, 6.5),
        start=(2.6, 0.6),
        goal=(8.3, 3.85, 0.25),
        settings={"vertices": 2000, "limit": 0.8},
        elements=elements,
    )


def _furniture(x: float, y: float) -> bool:
    """Whether a box with that middle is, or sticks to, a piece of furniture."""
    return any(x0 - CELL < x < x1 + CELL and y0 - CELL < y < y1 + CELL for x0, x1, y0, y1 in FURNITURE)


def grid() -> np.ndarray:
    """Grey values (rows, columns), the first row the highest; walls are as ragged as a laser leaves them."""
    rng = np.random.default_rng(5)
    cells = np.full((130, 180), FREE, np.uint8)
    for x0, x1, y0, y1 in (*PLAN, *FURNITURE):
        cells[round(y0 / CELL) : round(y1 / CELL), round(x0 / CELL) : round(x1 / CELL)] = WALL
    for x, y in rng.uniform((0.1, 0.1), (8.9, 6.4), (400, 2)):
        row, column = int(y / CELL), int(x / CELL)
        beside = cells[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
        if (beside == WALL).sum() == 3:  # at a straight wall
            cells[row, column] = WALL
    return cells[::-1]


def written(folder: Path) -> Path:
    """The map's two files; returns the YAML's."""
    cells = grid()
    rows, columns = cells.shape
    (folder / "house.pgm").write_bytes(f"P5 {columns} {rows} 255\n".encode() + cells.tobytes())
    file = folder / "house.yaml"
    file.write_text(
        f"image: house.pgm\nresolution: {CELL}\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return file
