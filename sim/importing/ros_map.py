"""Occupancy maps of ROS (map_server, nav2_map_server) as solids: a YAML file and the picture it names.

Occupied cells become boxes whose union they are, cell by cell. Cells that are neither occupied nor free by the
thresholds are unknown: walls unless said otherwise, since a map that says nothing of a place promises nothing.

Pixels mean what they mean to nav2_map_server. A colour counts by its mean. In the modes trinary and scale the chance of
a wall is its darkness, and what is transparent is unknown; map_server hands on chances between the thresholds of a
scale map, which count as unknown here. In the mode raw the pixel is the chance in per cent, and unknown above 100.
"""

import os
import reprlib
from collections.abc import Callable
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.geometry.rectangles import Cells, cover
from sim import extras
from sim.files import why_unreadable
from sim.importing.solids import Solid, World, transform
from sim.mjcf.library import FARTHEST, MOST_PIXELS, content_of, refused
from sim.text import suggestion

UNKNOWN = ("occupied", "free")
MODES = ("trinary", "scale", "raw")
DEFAULTS = {"occupied_thresh": 0.65, "free_thresh": 0.196, "negate": 0, "trinary": 1}
OCCUPIED = 65  # from which chance on a cell of a published map is a wall [per cent]
UNSEEN = 205  # grey that map_saver writes for an unknown cell
HEIGHT = 0.5  # of the walls [m]
FINEST, COARSEST = 1e-4, 100.0  # side of a cell [m]
SUFFIXES = extras.MAPS
PICTURES = (".pgm", ".png", ".ppm", ".bmp", ".gif", ".jpg", ".jpeg", ".tif", ".tiff")

_SHORT = reprlib.Repr()  # of values that refer to each other, the whole would fill the memory
_SHORT.maxlevel = 2


def read_map(path: Path, unknown: str = "occupied") -> World:
    """Read the map that a YAML file of map_server describes: boxes where it is occupied, or not free.

    Its own border is the ground's, if it is not turned.
    """
    check_unknown(unknown)
    known = _values(path)
    notes = list[str]()

    occupied_above = known["occupied_thresh"]
    free_below = known["free_thresh"]
    mode = known["mode"]

    if not 0 <= free_below <= occupied_above <= 1:
        must = "they must lie between 0 and 1, the first below the second"
        raise SceneError(f"{path}: free_thresh is {free_below:g} and occupied_thresh {occupied_above:g}; {must}")
    if not mode:
        mode = "trinary" if known["trinary"] else "scale"
        notes += [] if known["trinary"] else ["trinary: false is the old key for mode: scale, and is read so"]
    if np.isnan(known["origin"][2]):  # older map_savers write it
        notes.append("the yaw of origin is nan and is read as 0")
    levels, white, transparent = _read_image(path, _image_file(path, known["image"], notes))
    chance = np.arange(white + 1) / white
    chance = np.rint(255 * chance) / 100 if mode == "raw" else abs((not known["negate"]) - chance)
    cells = np.where(chance <= 1, chance, np.nan)[levels]
    if mode != "raw":
        cells[transparent] = np.nan
    occupied = cells >= occupied_above
    free = (cells <= free_below) & ~occupied
    unseen = np.count_nonzero(free & (levels == UNSEEN * white // 255)) if mode == "trinary" else 0
    if unseen:
        notes.append(
            f"{unseen} cells are {UNSEEN}, which map_saver writes for unknown, and count as free by free_thresh "
            f"{free_below:g}; write free_thresh: {DEFAULTS['free_thresh']} unless they were seen to be free"
        )
    between = np.count_nonzero((cells < occupied_above) & ~free) if mode == "scale" else 0
    if between:
        notes.append(f"{between} cells of a chance between free_thresh and occupied_thresh count as unknown")
    blocked = np.flipud(~free if unknown == "occupied" else occupied)  # lowest row first
    solids, border = walls_of(blocked, known["resolution"], np.nan_to_num(known["origin"]))
    said = tuple(f"{path}: {note}" for note in notes)
    return World(kind="map", solids=solids, ground=border, notes=said)


def check_unknown(unknown: str) -> None:
    """Refuse a rule for unknown cells that there is not, by an OptionError."""
    if unknown not in UNKNOWN:
        like = suggestion(unknown, UNKNOWN)
        raise OptionError(f"--unknown is {unknown!r}{like}; it must be one of {', '.join(UNKNOWN)}")


def walls_of(blocked: Cells, side: float, origin: Array) -> tuple[tuple[Solid, ...], Array | None]:
    """Return walls where cells of a side [m] are blocked, the lowest row first, and their border if it is not turned.

    Args:
        origin: x, y [m] and yaw [rad] of the lower left corner, (3,).
    """
    x, y, yaw = origin
    frame = transform(np.array([x, y, HEIGHT / 2, 0.0, 0.0, yaw]))
    solids = []

    for number, piece in enumerate(cover(blocked), start=1):
        r0, r1, c0, c1 = side * piece
        pose = frame.copy()
        pose[:, 3] = frame @ ((c0 + c1) / 2, (r0 + r1) / 2, 0.0, 1.0)
        solids.append(Solid(f"wall {number}", "box", np.array([c1 - c0, r1 - r0, HEIGHT]) / 2, pose))
    high, wide = side * np.array(blocked.shape)
    return tuple(solids), np.array([x, x + wide, y, y + high]) if yaw == 0.0 else None


def _values(path: Path) -> dict[str, Any]:
    """Read the values of all keys of a map, those of map_server where they are missing."""
    extras.require(f"the map {path}", "maps")
    import yaml

    deep = f"{path}: not YAML: it is nested too deeply; fix it there"
    wrong = yaml.YAMLError, ValueError  # of dates and of bytes that are no UTF-8
    with refused(deep, "", RecursionError, most=0), refused(f"{path}: not YAML: ", "; fix it there", *wrong):
        content = yaml.safe_load(content_of(path, "the YAML file of a map").decode())
    if not isinstance(content, dict):
        raise SceneError(f"{path}: no map: it must have the keys image, resolution and origin")
    values = {}
    for key, (read, must) in _KEYS.items():
        value = content.get(key)
        value = {"mode": "", **DEFAULTS}.get(key) if value is None else value
        if value is None:
            raise SceneError(f"{path}: the key {key} is missing; a map has image, resolution and origin")
        must = f"{path}: {key} is {_SHORT.repr(value)}; it must be {must}"
        with refused(must, "", TypeError, ValueError, OverflowError, KeyError, most=0):
            values[key] = read(value)
    return values


def _number(value: Any, low: float = -FARTHEST, high: float = FARTHEST) -> float:
    if isinstance(value, bool) or not low <= float(value) <= high:
        raise ValueError
    return float(value)


def _origin(value: Any) -> Array:
    """Read x, y, yaw (3,); the yaw may be nan."""
    if not isinstance(value, list):
        raise TypeError
    x, y, yaw = value if len(value) == 3 else (*value, 0.0)
    return np.array([_number(x), _number(y), np.nan if np.isnan(float(yaw)) else _number(yaw)])


_KEYS: dict[str, tuple[Callable[[Any], Any], str]] = {  # how a value is read, and what it must be
    "image": (str.__str__, "the name of a file"),
    "resolution": (lambda v: _number(v, FINEST, COARSEST), f"the side of a cell in metres, {FINEST:g} to {COARSEST:g}"),
    "origin": (_origin, f"[x, y, yaw] of the lower left corner, none beyond {FARTHEST:g}"),
    "occupied_thresh": (_number, "a number"),
    "free_thresh": (_number, "a number"),
    "negate": ({0: False, 1: True}.__getitem__, "0 or 1"),
    "trinary": ({0: False, 1: True}.__getitem__, "0 or 1"),
    "mode": ({mode: mode for mode in ("", *MODES)}.__getitem__, f"one of {', '.join(MODES)}"),
}


def _image_file(path: Path, name: str, notes: list[str]) -> Path:
    """Find the picture: relative to the YAML file, or next to it if that came from another machine."""
    file = path.parent / name
    moved = path.parent / PureWindowsPath(name).name

    if os.path.exists(file):  # os.path takes names that no system allows
        return file
    if not os.path.isfile(moved):
        raise SceneError(f"{path}: image {file} does not exist; put it next to the YAML file")
    notes.append(f"image {name} does not exist; {moved.name} next to the YAML file is read")
    return moved


def _read_image(path: Path, file: Path) -> tuple[NDArray[np.uint16], int, Cells]:
    """Brightness from 0, black, what white is of it, and what is transparent; (rows, columns) from the top."""
    from PIL import Image

    most = f"); a map has {MOST_PIXELS} pixels at most: crop it or make its resolution coarser"
    small = refused(f"{path}: image {file} is too large (", most, Image.DecompressionBombError)
    with small, refused(f"{path}: image {file} cannot be read (", ")", OSError, ValueError, SyntaxError):
        if (why := why_unreadable(file)) is not None:
            raise OSError(f"it {why}")
        with Image.open(file) as image:
            if image.width * image.height > MOST_PIXELS:
                raise Image.DecompressionBombError(f"{image.width} x {image.height} pixels")
            if image.mode.startswith("I"):  # 16 bits
                whole = np.asarray(image).astype(np.uint16)
                return whole, 65535, np.zeros(whole.shape, np.bool_)
            pixels = np.asarray(image.convert("RGBA"))
    return pixels[..., :3].sum(axis=2, dtype=np.uint16), 3 * 255, pixels[..., 3] < 255
