"""A default limit of |1 - H_i| shows the classes that people see in a map, however the scene was made."""

from pathlib import Path

import numpy as np
import pytest

from pirrht import FreeSpace, HomologyTree, Problem, Scene, SingleIntegrator, StraightLine, grown_tree
from pirrht.planner.tuning import LIMITS
from sim.importing.scene_file import import_world
from sim.scenario import Scenario, prepare

# Five rooms: x0, y0, x1, y1 of walls, then of furniture, in cells [m]. The second class is 1.22 times the shortest.
CELL, ACROSS, UP = 0.15, 80, 60
APARTMENT = (
    (0, 0, 80, 1), (0, 59, 80, 60), (0, 0, 1, 60), (79, 0, 80, 60), (0, 33, 13, 34), (20, 33, 33, 34),
    (40, 33, 47, 34), (46, 0, 47, 10), (46, 17, 47, 43), (46, 50, 47, 60), (26, 33, 27, 47), (26, 53, 27, 60),
    (47, 26, 60, 27), (67, 26, 80, 27), (1, 37, 11, 45), (17, 4, 32, 9), (28, 18, 36, 24), (31, 36, 33, 43),
    (61, 10, 72, 15), (57, 36, 63, 48),
)  # fmt: skip
START, GOAL, RADIUS = (1.0, 8.0), (11.0, 8.0, 0.3), 0.115
VERTICES = 400


def as_boxes(folder: Path) -> Scene:
    rows = CELL * np.array(APARTMENT, dtype=float)
    upper = (CELL * ACROSS, CELL * UP)
    return Scene.from_boxes(rows, lower=(0, 0), upper=upper, start=START, goal=GOAL, robot_radius=RADIUS)


def cells() -> np.ndarray:
    occupied = np.zeros((UP, ACROSS), dtype=bool)
    for x0, y0, x1, y1 in APARTMENT:
        occupied[y0:y1, x0:x1] = True
    return occupied


def as_grid(folder: Path) -> Scene:
    return Scene.from_grid(cells(), CELL, start=START, goal=GOAL, robot_radius=RADIUS)


def as_mjcf(folder: Path) -> Path:
    extents = (CELL * np.array(row).reshape(2, 2) for row in APARTMENT)
    places = ((0.5 * (low + high), 0.5 * (high - low)) for low, high in extents)
    geoms = "".join(f'<geom type="box" pos="{x} {y} 0.4" size="{across} {up} 0.4"/>' for (x, y), (across, up) in places)
    (folder / "apartment.xml").write_text(
        f"""<mujoco><worldbody>{geoms}<site name="workspace" type="box" pos="6 4.5 0.5" size="6 4.5 0.5"/>
        <site name="start" pos="{START[0]} {START[1]} 0"/>
        <site name="goal" type="cylinder" pos="{GOAL[0]} {GOAL[1]} 0" size="{GOAL[2]} 0.01"/></worldbody></mujoco>"""
    )
    return folder / "apartment.xml"


def as_map(folder: Path) -> Path:
    pytest.importorskip("PIL")
    pytest.importorskip("yaml")
    picture = np.where(np.flipud(cells()), 0, 255).astype(np.uint8)
    (folder / "map.pgm").write_bytes(b"P5 %d %d 255\n" % (ACROSS, UP) + picture.tobytes())
    keys = {"image": "map.pgm", "resolution": CELL, "origin": "[0, 0, 0]", "negate": 0}
    keys |= {"occupied_thresh": 0.65, "free_thresh": 0.2}
    (folder / "map.yaml").write_text("".join(f"{key}: {value}\n" for key, value in keys.items()))
    import_world(folder / "map.yaml", folder / "map.xml", start=START, goal=GOAL)
    return folder / "map.xml"


def tree_of(made: Scene | Path) -> tuple[HomologyTree, np.ndarray]:
    """A tree with the default limit of a scene, and its start."""
    if isinstance(made, Path):
        scenario: Scenario = prepare(made, robot="puck", vertices=VERTICES, margin=0.0, radius=RADIUS)
        return scenario.grown_tree(), scenario.start
    problem = Problem(dynamics=SingleIntegrator(b=0.1), scene=made, R=2.0 * np.eye(2))
    return grown_tree(FreeSpace.of(made), StraightLine.of(problem), made.start[:2], VERTICES), made.start[:2]


@pytest.mark.parametrize("way", [as_boxes, as_grid, as_mjcf, as_map])
def test_a_default_limit_shows_the_short_classes_of_an_apartment(way, tmp_path):
    tree, start = tree_of(way(tmp_path))
    lengths = sorted(one.length for one in tree.references(start))
    every = HomologyTree(tree.space, tree.steering, limit=3.0, rng=np.random.default_rng(1))
    every.grow(VERTICES)
    seen = sorted(one.length for one in every.references(start))
    short = [length for length in seen if length <= 0.99 * LIMITS.longer * seen[0]]
    assert len(short) > 5
    assert lengths[: len(short)] == pytest.approx(short, rel=0.01)


def test_a_limit_stays_if_it_has_as_many_short_classes_as_are_kept(tmp_path):
    scenario = prepare(as_mjcf(tmp_path), margin=0.0, vertices=VERTICES, classes=1)
    assert scenario.grown_tree().limit == scenario.settings.limit
    assert prepare(as_mjcf(tmp_path), margin=0.0, vertices=VERTICES, limit=0.6).grown_tree().limit == 0.6


def test_what_a_limit_must_allow_is_the_greatest_turn_of_what_is_left_of_a_path():
    space = FreeSpace.of(
        Scene.from_boxes([[1.9, 0.9, 2.1, 1.1]], lower=(0, 0), upper=(4, 3), start=(0.5, 1), goal=(3.5, 1, 0.2),
                         robot_radius=0.1)
    )  # fmt: skip
    assert space.homology.most_turned(np.array([[0.5, 1.0], [2.0, 2.0], [3.5, 1.0]])) == pytest.approx(0.5)
    back = np.array([[3.5, 1.0], [2.0, 2.0], [0.5, 1.0], [2.0, 0.2], [3.5, 1.0]])  # once around
    assert space.homology.most_turned(back) == pytest.approx(1.0)
    assert space.homology.most_turned(np.array([[3.0, 1.0], [3.5, 1.0]])) == pytest.approx(0.0)
