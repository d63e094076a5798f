"""Import of ROS maps, and the first plan in them, against the number of pixels: halls of clean and of fuzzy walls."""

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.plots import COLORS
from PIL import Image
from scipy import ndimage

from pirrht.plotting.maps import pyplot
from sim.importing.ros_map import DEFAULTS
from sim.importing.scene_file import import_world
from sim.scenario import prepare

SIDES = (1000, 1400, 2000, 2800, 4000)  # pixels
CELL = 0.05  # [m]
WALL, FREE = 0, 254
BAY, PILLAR = 6.4, 0.6  # from pillar to pillar, and the half side of one [m]
FRAYED, SPECKS, HALO = 0.25, 0.01, 0.2  # shares of cells at walls that differ and near them that are hit; how near [m]
ROBOT, VERTICES = 0.3, 500


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of the times; draws them with `png`."""
    _timed(SIDES[0] // 4, True)  # compiles
    values = [_timed(side, fuzzy) for fuzzy in (False, True) for side in SIDES]
    if options.png is not None:
        plot(options.png, values)
    table = [
        [
            v["walls"], f"{v['side']}", f"{v['boxes']}", f"{v['import_seconds']:.2f}",
            f"{1e6 * v['import_seconds'] / v['side'] ** 2:.2f}", f"{v['plan_seconds']:.2f}", f"{v['classes']}",
        ]
        for v in values
    ]  # fmt: skip
    table += [[walls, "exponent", "", f"{_exponent(values, walls):.2f}", "", "", ""] for walls in ("clean", "fuzzy")]
    return ["walls", "side [px]", "boxes", "import [s]", "per Mpx [s]", "plan [s]", "classes"], table, values


def hall(side: int, fuzzy: bool, seed: int = 0) -> np.ndarray:
    """Grey values (side, side): a hall of pillars, whose walls are as ragged as a lidar leaves them if `fuzzy`."""
    rng, x = np.random.default_rng(seed), CELL * np.arange(side)
    near = np.abs((x + BAY / 2) % BAY - BAY / 2) < PILLAR  # a pillar's middle
    walls = near[:, None] & near
    walls[:4], walls[-4:], walls[:, :4], walls[:, -4:] = True, True, True, True
    walls[: side // 10, : side // 10] = walls[-side // 10 :, -side // 10 :] = False  # corners for start and goal
    if fuzzy:
        away, within = (ndimage.distance_transform_edt(part) for part in (~walls, walls))
        frayed = np.maximum(away, within) <= 1.0
        halo = (away > 1.0) & (away < HALO / CELL)
        walls ^= (frayed & (rng.random(walls.shape) < FRAYED)) | (halo & (rng.random(walls.shape) < SPECKS))
    return np.where(walls, WALL, FREE).astype(np.uint8)


def plot(path: Path, values: list[dict[str, Any]]) -> None:
    """Seconds over pixels, both logarithmic, and a line of time in proportion to pixels."""
    plt = pyplot("this script")
    figure, axes = plt.subplots(figsize=(5.6, 4.0), layout="constrained")
    for i, (name, style) in enumerate((("import", "o-"), ("plan", "s--"))):
        for j, walls in enumerate(("clean", "fuzzy")):
            line = [(v["side"] ** 2, v[f"{name}_seconds"]) for v in values if v["walls"] == walls]
            axes.loglog(
                *zip(*line, strict=True), style, color=COLORS[2 * i + j], lw=1.8, ms=5, label=f"{name}, {walls}"
            )
    ends = np.array([SIDES[0], SIDES[-1]]) ** 2.0
    last = max(v["import_seconds"] for v in values)
    axes.loglog(ends, 1.5 * last * ends / ends[-1], color="#333333", lw=0.8, ls=":", label="in proportion to pixels")
    axes.set_xticks([side**2 for side in SIDES], [f"{side}²" for side in SIDES], minor=False)
    axes.set_xticks([], minor=True)
    axes.set_xlabel("pixels")
    axes.set_ylabel("processor time [s]")
    axes.grid(alpha=0.25, which="both")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _timed(side: int, fuzzy: bool) -> dict[str, Any]:
    """Processor seconds of an import and of the first plan, with what there was."""
    with tempfile.TemporaryDirectory() as folder:
        source, target, span = Path(folder) / "hall.yaml", Path(folder) / "hall.xml", CELL * side
        Image.fromarray(hall(side, fuzzy)).save(source.with_suffix(".pgm"))
        keys = {"image": "hall.pgm", "resolution": CELL, "origin": [0, 0, 0], **DEFAULTS}
        source.write_text("".join(f"{key}: {value}\n" for key, value in keys.items()))
        began = time.process_time()  # whatever else the machine does
        imported = import_world(source, target, start=[2, 2], goal=[span - 2, span - 2, 0.5])
        done = time.process_time()
        scenario = prepare(target, robot="puck", radius=ROBOT, given={"vertices": VERTICES})
        references = scenario.grown_tree().references(scenario.start)
        end = time.process_time()
    return {
        "walls": "fuzzy" if fuzzy else "clean",
        "side": side,
        "boxes": imported.geoms,
        "import_seconds": done - began,
        "plan_seconds": end - done,
        "classes": len(references),
    }


def _exponent(values: list[dict[str, Any]], walls: str) -> float:
    """The slope of import times over pixels, both logarithmic."""
    pixels, seconds = np.log([(v["side"] ** 2, v["import_seconds"]) for v in values if v["walls"] == walls]).T
    return float(np.polyfit(pixels, seconds, 1)[0])
