"""Occupancy maps of ROS (map_server, nav2_map_server) as solids: a YAML file and the picture it names.

Occupied cells become boxes whose union they are, cell by cell. Cells that are neither occupied nor free by the
thresholds are unknown: walls unless said otherwise, since a map that says nothing of a place promises nothing.
"""

from __future__ import annotations

import os
import reprlib
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.geometry.rectangles import Cells, cover
from sim.importing.limits import FARTHEST, MOST_PIXELS, check_regular, content_of
from sim.importing.sdf import Solid, World

UNKNOWN = ("occupied", "free")
MODES = ("trinary", "scale", "raw")
DEFAULTS = {"occupied_thresh": 0.65, "free_thresh": 0.196, "negate": 0, "mode": "trinary"}
HEIGHT = 0.5  # of the walls [m]
FINEST, COARSEST = 1e-4, 100.0  # side of a cell [m]
SUFFIXES = (".yaml", ".yml")
PICTURES = (".pgm", ".png", ".ppm", ".bmp", ".gif", ".jpg", ".jpeg", ".tif", ".tiff")

_SHORT = reprlib.Repr()  # of values that refer to each other, the whole would fill the memory
_SHORT.maxlevel = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Map:
    """An occupancy grid; the first row is the lowest."""

    occupied: Cells  # (rows, columns)
    free: Cells  # (rows, columns); what is neither is unknown
    resolution: float  # side of a cell [m]
    origin: Array  # (3,) x, y [m] of the lower left corner, yaw [rad] of the grid

    def world(self, unknown: str = "occupied", progress: Callable[[int, int], object] | None = None) -> World:
        """Boxes where the map is occupied, or not free; its own border is the ground's, if it is not turned."""
        if unknown not in UNKNOWN:
            raise OptionError(f"--unknown is {unknown!r}; it must be one of {', '.join(UNKNOWN)}")
        blocked = ~self.free if unknown == "occupied" else self.occupied
        done, total = 0, int(blocked.sum())

        def covered(more: int) -> None:
            nonlocal done
            done += more
            if progress is not None:
                progress(done, total)

        solids = tuple(self._box(i, piece) for i, piece in enumerate(cover(blocked, covered), start=1))
        x, y, yaw = self.origin
        rows, columns = blocked.shape
        border = np.array([x, x + columns * self.resolution, y, y + rows * self.resolution])
        return World(solids=solids, ground=border if yaw == 0.0 else None)

    def _box(self, number: int, piece: np.ndarray[Any, Any]) -> Solid:
        r0, r1, c0, c1 = self.resolution * piece
        x, y, yaw = self.origin
        cos, sin = np.cos(yaw), np.sin(yaw)
        u, v = (c0 + c1) / 2, (r0 + r1) / 2
        pose = np.eye(4)
        pose[:2, :2] = [[cos, -sin], [sin, cos]]
        pose[:3, 3] = x + cos * u - sin * v, y + sin * u + cos * v, HEIGHT / 2
        return Solid(name=f"wall {number}", shape="box", size=np.array([c1 - c0, r1 - r0, HEIGHT]) / 2, pose=pose)


def read_map(path: Path) -> Map:
    """The map that a YAML file of map_server describes.

    Raises:
        SceneError: names the file, the key and what would do.
        OptionError: PyYAML or Pillow is missing.
    """
    known = DEFAULTS | _read_yaml(path)
    resolution = _number(path, known, "resolution")
    occupied_above, free_below = (_number(path, known, key) for key in ("occupied_thresh", "free_thresh"))
    if not FINEST <= resolution <= COARSEST:
        raise SceneError(
            f"{path}: resolution is {resolution:g}; it must be the side of a cell in metres, {FINEST:g} to {COARSEST:g}"
        )
    if not 0 <= free_below <= occupied_above <= 1:
        raise SceneError(
            f"{path}: free_thresh is {free_below:g} and occupied_thresh {occupied_above:g}; "
            "they must lie between 0 and 1, the first below the second"
        )
    mode, negate = known["mode"], _flag(path, known, "negate")
    if mode not in MODES:
        raise SceneError(f"{path}: mode is {_SHORT.repr(mode)}; it must be one of {', '.join(MODES)}")
    shade, transparent = _read_image(path, known)
    if mode == "raw":
        chance = np.rint(255 * shade) / 100  # the pixel is the chance in per cent, and unknown above 100
        sure = chance <= 1
    else:
        chance = shade if negate else 1 - shade
        sure = ~transparent if mode == "scale" else np.ones_like(transparent)
    return Map(
        occupied=np.flipud(sure & (chance > occupied_above)),
        free=np.flipud(sure & (chance < free_below)),
        resolution=resolution,
        origin=_origin(path, known),
    )


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        import yaml
    except ImportError:
        raise OptionError("maps need PyYAML and Pillow; install them with `pip install 'pirrht[maps]'`") from None
    try:
        content = yaml.safe_load(content_of(path, "the YAML file of a map").decode())
    except RecursionError:
        raise SceneError(f"{path}: not YAML: it is nested too deeply; mend it there") from None
    except (yaml.YAMLError, ValueError) as error:  # of dates and of bytes that are no UTF-8
        raise SceneError(f"{path}: not YAML: {' '.join(str(error).split())}; mend it there") from None
    if not isinstance(content, dict):
        raise SceneError(f"{path}: no map: it must have the keys image, resolution and origin")
    for key in ("image", "resolution", "origin"):
        if content.get(key) is None:
            raise SceneError(f"{path}: the key {key} is missing; a map has image, resolution and origin")
    return {key: value for key, value in content.items() if value is not None}


def _read_image(path: Path, known: Mapping[str, Any]) -> tuple[Array, Cells]:
    """Shade from 0, black, to 1 and whether a pixel is transparent, (rows, columns) from the top."""
    try:
        from PIL import Image
    except ImportError:
        raise OptionError("maps need PyYAML and Pillow; install them with `pip install 'pirrht[maps]'`") from None
    if not isinstance(known["image"], str):
        raise SceneError(f"{path}: image is {_SHORT.repr(known['image'])}; it must be the name of a file")
    file = path.parent / known["image"]
    if not os.path.exists(file):  # of a name that no system allows, too
        raise SceneError(f"{path}: image {file} does not exist; it is looked for beside the YAML file")
    check_regular(file, "a picture")
    try:
        with warnings.catch_warnings(action="ignore", category=Image.DecompressionBombWarning):
            picture = Image.open(file)
        with picture as image:
            if image.width * image.height > MOST_PIXELS:
                raise Image.DecompressionBombError(f"{image.width} x {image.height} pixels")
            if image.mode.startswith("I"):  # 16 bits
                whole = np.asarray(image, dtype=float) / 65535
                return whole, np.zeros(whole.shape, np.bool_)
            pixels = np.asarray(image.convert("RGBA"), dtype=float) / 255
    except Image.DecompressionBombError as error:
        raise SceneError(
            f"{path}: image {file} is too large ({error}); a map has {MOST_PIXELS} pixels at most: crop it or make its "
            "resolution coarser"
        ) from None
    except (OSError, ValueError, SyntaxError) as error:
        raise SceneError(f"{path}: image {file} cannot be read ({' '.join(str(error).split())})") from None
    return pixels[..., :3].mean(axis=2), pixels[..., 3] < 1


def _number(path: Path, known: Mapping[str, Any], key: str) -> float:
    try:
        value = float(known[key])
    except (TypeError, ValueError, OverflowError):
        value = np.nan
    if not np.isfinite(value) or isinstance(known[key], bool):
        raise SceneError(f"{path}: {key} is {_SHORT.repr(known[key])}; it must be a number")
    return value


def _flag(path: Path, known: Mapping[str, Any], key: str) -> bool:
    if known[key] not in (0, 1):
        raise SceneError(f"{path}: {key} is {_SHORT.repr(known[key])}; it must be 0 or 1")
    return bool(known[key])


def _origin(path: Path, known: Mapping[str, Any]) -> Array:
    said = known["origin"]
    try:
        origin = np.array([float(v) for v in said] if isinstance(said, list) and len(said) in (2, 3) else [])
    except (TypeError, ValueError, OverflowError):
        origin = np.zeros(0)
    if not len(origin) or not np.all(np.abs(origin) <= FARTHEST):
        raise SceneError(
            f"{path}: origin is {_SHORT.repr(said)}; it must be [x, y, yaw] of the lower left corner, none beyond "
            f"{FARTHEST:g}"
        )
    return np.append(origin, 0.0)[:3]
