"""Occupancy maps of ROS (map_server, nav2_map_server) as solids: a YAML file and the picture it names.

Occupied cells become boxes whose union they are, cell by cell. Cells that are neither occupied nor free by the
thresholds are unknown: walls unless said otherwise, since a map that says nothing of a place promises nothing.

Pixels mean what they mean to nav2_map_server. A colour counts by its mean. In the modes trinary and scale the chance of
a wall is its darkness, and what is transparent is unknown; map_server hands on chances between the thresholds of a
scale map, which count as unknown here. In the mode raw the pixel is the chance in per cent, and unknown above 100.
"""

from __future__ import annotations

import os
import reprlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.geometry.rectangles import Cells, cover
from sim.files import why_unreadable
from sim.importing.solids import Solid, World
from sim.mjcf.limits import FARTHEST, MOST_PIXELS, content_of

UNKNOWN = ("occupied", "free")
MODES = ("trinary", "scale", "raw")
DEFAULTS = {"occupied_thresh": 0.65, "free_thresh": 0.196, "negate": 0, "trinary": 1}
UNSEEN = 205  # grey that map_saver writes for an unknown cell
HEIGHT = 0.5  # of the walls [m]
FINEST, COARSEST = 1e-4, 100.0  # side of a cell [m]
SUFFIXES = (".yaml", ".yml")
PICTURES = (".pgm", ".png", ".ppm", ".bmp", ".gif", ".jpg", ".jpeg", ".tif", ".tiff")

_SHORT = reprlib.Repr()  # of values that refer to each other, the whole would fill the memory
_SHORT.maxlevel = 2
_FLAGS = {0: False, 1: True}
_EXTRA = "maps need PyYAML and Pillow; install them with `pip install 'pirrht[maps]'`"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Map:
    """An occupancy grid; the first row is the lowest."""

    occupied: Cells  # (rows, columns)
    free: Cells  # (rows, columns); what is neither is unknown
    resolution: float  # side of a cell [m]
    origin: Array  # (3,) x, y [m] of the lower left corner, yaw [rad] of the grid
    notes: tuple[str, ...] = ()  # sentences on what was read otherwise than a person may expect

    def world(self, unknown: str = "occupied") -> World:
        """Boxes where the map is occupied, or not free; its own border is the ground's, if it is not turned."""
        if unknown not in UNKNOWN:
            raise OptionError(f"--unknown is {unknown!r}; it must be one of {', '.join(UNKNOWN)}")
        blocked = ~self.free if unknown == "occupied" else self.occupied
        x, y, yaw = self.origin
        cos, sin = np.cos(yaw), np.sin(yaw)
        solids = []
        for number, piece in enumerate(cover(blocked), start=1):
            r0, r1, c0, c1 = self.resolution * piece
            u, v, pose = (c0 + c1) / 2, (r0 + r1) / 2, np.eye(4)
            pose[:2, :2] = [[cos, -sin], [sin, cos]]
            pose[:3, 3] = x + cos * u - sin * v, y + sin * u + cos * v, HEIGHT / 2
            size = np.array([c1 - c0, r1 - r0, HEIGHT]) / 2
            solids.append(Solid(name=f"wall {number}", shape="box", size=size, pose=pose))
        rows, columns = blocked.shape
        border = np.array([x, x + columns * self.resolution, y, y + rows * self.resolution])
        return World(kind="map", solids=tuple(solids), ground=border if yaw == 0.0 else None, notes=self.notes)


def read_map(path: Path) -> Map:
    """The map that a YAML file of map_server describes."""
    known, notes = _Keys(path), list[str]()
    resolution = known.of("resolution", _number, "a number")
    occupied_above, free_below = (known.of(key, _number, "a number") for key in ("occupied_thresh", "free_thresh"))
    if not FINEST <= resolution <= COARSEST:
        known.refuse("resolution", f"the side of a cell in metres, {FINEST:g} to {COARSEST:g}", f"{resolution:g}")
    if not 0 <= free_below <= occupied_above <= 1:
        raise SceneError(
            f"{path}: free_thresh is {free_below:g} and occupied_thresh {occupied_above:g}; "
            "they must lie between 0 and 1, the first below the second"
        )
    negate = known.of("negate", _FLAGS.__getitem__, "0 or 1")
    trinary = "mode" in known.values or known.of("trinary", _FLAGS.__getitem__, "0 or 1")
    if not trinary:
        notes.append("trinary: false is the old key for mode: scale, and is read so")
    known.values.setdefault("mode", "trinary" if trinary else "scale")
    mode = known.of("mode", {mode: mode for mode in MODES}.__getitem__, f"one of {', '.join(MODES)}")
    origin = known.of("origin", _origin, f"[x, y, yaw] of the lower left corner, none beyond {FARTHEST:g}")
    if np.isnan(origin[2]):  # older map_savers write it
        notes.append("the yaw of origin is nan and is read as 0")
        origin[2] = 0.0
    levels, white, transparent = _read_image(path, _image_file(known, notes))
    shades = np.arange(white + 1) / white
    if mode == "raw":
        chances = np.rint(255 * shades) / 100
        sure: Cells = (chances <= 1)[levels]
    else:
        chances = shades if negate else 1 - shades
        sure = ~transparent
    occupied = sure & (chances >= occupied_above)[levels]
    free = sure & (chances <= free_below)[levels] & ~occupied
    unseen = np.count_nonzero(free & (levels == UNSEEN * white // 255)) if mode == "trinary" else 0
    if unseen:
        notes.append(
            f"{unseen} cells are {UNSEEN}, which map_saver writes for unknown, and count as free by free_thresh "
            f"{free_below:g}; write free_thresh: {DEFAULTS['free_thresh']} unless they were seen to be free"
        )
    between = np.count_nonzero(sure & ~occupied & ~free) if mode == "scale" else 0
    if between:
        notes.append(f"{between} cells of a chance between free_thresh and occupied_thresh count as unknown")
    return Map(
        occupied=np.flipud(occupied),
        free=np.flipud(free),
        resolution=resolution,
        origin=origin,
        notes=tuple(f"{path}: {note}" for note in notes),
    )


class _Keys:
    """The keys of a map's YAML file, with the values of map_server where they are missing."""

    def __init__(self, path: Path) -> None:
        try:
            import yaml
        except ImportError:
            raise OptionError(_EXTRA) from None
        self.path = path
        try:
            content = yaml.safe_load(content_of(path, "the YAML file of a map").decode())
        except RecursionError:
            raise SceneError(f"{path}: not YAML: it is nested too deeply; fix it there") from None
        except (yaml.YAMLError, ValueError) as error:  # of dates and of bytes that are no UTF-8
            raise SceneError(f"{path}: not YAML: {' '.join(str(error).split())}; fix it there") from None
        if not isinstance(content, dict):
            raise SceneError(f"{path}: no map: it must have the keys image, resolution and origin")
        for key in ("image", "resolution", "origin"):
            if content.get(key) is None:
                raise SceneError(f"{path}: the key {key} is missing; a map has image, resolution and origin")
        self.values: dict[str, Any] = DEFAULTS | {key: value for key, value in content.items() if value is not None}

    def of(self, key: str, read: Callable[[Any], Any], must: str) -> Any:
        """What is read of a key's value; refused where that fails."""
        try:
            return read(self.values[key])
        except (TypeError, ValueError, OverflowError, KeyError):
            self.refuse(key, must, _SHORT.repr(self.values[key]))

    def refuse(self, key: str, must: str, shown: str) -> NoReturn:
        """Raise the SceneError of a key."""
        raise SceneError(f"{self.path}: {key} is {shown}; it must be {must}")


def _number(value: Any) -> float:
    if not np.isfinite(float(value)) or isinstance(value, bool):
        raise ValueError
    return float(value)


def _origin(value: Any) -> Array:
    """x, y, yaw (3,); the yaw may be nan."""
    origin = np.append(np.array([float(v) for v in value]), 0.0)[:3]
    if not isinstance(value, list) or len(value) not in (2, 3):
        raise ValueError
    if not np.all(np.abs(origin[:2]) <= FARTHEST) or abs(origin[2]) > FARTHEST:
        raise ValueError
    return origin


def _image_file(known: _Keys, notes: list[str]) -> Path:
    """The picture: relative to the YAML file, or next to it if that came from another machine."""
    name, path = known.values["image"], known.path
    if not isinstance(name, str):
        known.refuse("image", "the name of a file", _SHORT.repr(name))
    file, moved = path.parent / name, path.parent / PureWindowsPath(name).name
    if os.path.exists(file):  # os.path takes names that no system allows
        return file
    if not os.path.isfile(moved):
        raise SceneError(f"{path}: image {file} does not exist; put it next to the YAML file")
    notes.append(f"image {name} does not exist; {moved.name} next to the YAML file is read")
    return moved


def _read_image(path: Path, file: Path) -> tuple[NDArray[np.uint16], int, Cells]:
    """Brightness from 0, black, what white is of it, and what is transparent; (rows, columns) from the top."""
    try:
        from PIL import Image
    except ImportError:
        raise OptionError(_EXTRA) from None
    try:
        if (why := why_unreadable(file)) is not None:
            raise OSError(f"it {why}")
        with warnings.catch_warnings(action="ignore", category=Image.DecompressionBombWarning):
            picture = Image.open(file)
        with picture as image:
            if image.width * image.height > MOST_PIXELS:
                raise Image.DecompressionBombError(f"{image.width} x {image.height} pixels")
            if image.mode.startswith("I"):  # 16 bits
                whole = np.asarray(image).astype(np.uint16)
                return whole, 65535, np.zeros(whole.shape, np.bool_)
            pixels = np.asarray(image.convert("RGBA"))
    except Image.DecompressionBombError as error:
        raise SceneError(
            f"{path}: image {file} is too large ({error}); a map has {MOST_PIXELS} pixels at most: crop it or make its "
            "resolution coarser"
        ) from None
    except (OSError, ValueError, SyntaxError) as error:
        raise SceneError(f"{path}: image {file} cannot be read ({' '.join(str(error).split())})") from None
    return pixels[..., :3].sum(axis=2, dtype=np.uint16), 3 * 255, pixels[..., 3] < 255
