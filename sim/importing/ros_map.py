"""Occupancy maps of ROS (map_server, nav2_map_server) as solids: a YAML file and the picture it names.

Occupied cells become boxes whose union they are, cell by cell. Cells that are neither occupied nor free by the
thresholds are unknown: walls unless said otherwise, since a map that says nothing of a place promises nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.files import MISSING, why_unreadable
from sim.importing.rectangles import Cells, cover
from sim.importing.sdf import Solid, World

UNKNOWN = ("occupied", "free")
MODES = ("trinary", "scale", "raw")
DEFAULTS = {"occupied_thresh": 0.65, "free_thresh": 0.196, "negate": 0, "mode": "trinary"}
HEIGHT = 0.5  # of the walls [m]
SUFFIXES = (".yaml", ".yml")
PICTURES = (".pgm", ".png", ".ppm", ".bmp", ".gif", ".jpg", ".jpeg", ".tif", ".tiff")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Map:
    """An occupancy grid; the first row is the lowest."""

    occupied: Cells  # (rows, columns)
    free: Cells  # (rows, columns); what is neither is unknown
    resolution: float  # side of a cell [m]
    origin: Array  # (3,) x, y [m] of the lower left corner, yaw [rad] of the grid

    def world(self, unknown: str = "occupied", progress: Callable[[int], object] | None = None) -> World:
        """Boxes where the map is occupied, or not free; its own border is the ground's, if it is not turned."""
        if unknown not in UNKNOWN:
            raise OptionError(f"--unknown is {unknown!r}; it must be one of {', '.join(UNKNOWN)}")
        blocked = ~self.free if unknown == "occupied" else self.occupied
        solids = tuple(self._box(i, piece) for i, piece in enumerate(cover(blocked, progress), start=1))
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
    if not resolution > 0:
        raise SceneError(f"{path}: resolution is {resolution:g}; it must be the side of a cell in metres")
    if not 0 <= free_below <= occupied_above <= 1:
        raise SceneError(
            f"{path}: free_thresh is {free_below:g} and occupied_thresh {occupied_above:g}; "
            "they must lie between 0 and 1, the first below the second"
        )
    mode, negate = known["mode"], _flag(path, known, "negate")
    if mode not in MODES:
        raise SceneError(f"{path}: mode is {mode!r}; it must be one of {', '.join(MODES)}")
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
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror}); give the YAML file of a map") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
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
    file = path.parent / str(known["image"])
    why = why_unreadable(file)
    if why not in (None, MISSING):
        raise SceneError(f"{path}: image {file} cannot be read: it {why}")
    try:
        with Image.open(file) as image:
            if image.mode.startswith("I"):  # 16 bits
                whole = np.asarray(image, dtype=float) / 65535
                return whole, np.zeros(whole.shape, np.bool_)
            pixels = np.asarray(image.convert("RGBA"), dtype=float) / 255
    except FileNotFoundError:
        raise SceneError(f"{path}: image {file} does not exist; it is looked for beside the YAML file") from None
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise SceneError(f"{path}: image {file} cannot be read ({' '.join(str(error).split())})") from None
    return pixels[..., :3].mean(axis=2), pixels[..., 3] < 1


def _number(path: Path, known: Mapping[str, Any], key: str) -> float:
    try:
        value = float(known[key])
    except (TypeError, ValueError):
        value = np.nan
    if not np.isfinite(value) or isinstance(known[key], bool):
        raise SceneError(f"{path}: {key} is {known[key]!r}; it must be a number")
    return value


def _flag(path: Path, known: Mapping[str, Any], key: str) -> bool:
    if known[key] not in (0, 1):
        raise SceneError(f"{path}: {key} is {known[key]!r}; it must be 0 or 1")
    return bool(known[key])


def _origin(path: Path, known: Mapping[str, Any]) -> Array:
    try:
        origin = np.array(known["origin"], dtype=float)
    except (TypeError, ValueError):
        origin = np.zeros(0)
    if origin.shape not in ((2,), (3,)) or not np.all(np.isfinite(origin)):
        raise SceneError(f"{path}: origin is {known['origin']!r}; it must be [x, y, yaw] of the lower left corner")
    return np.append(origin, 0.0)[:3]
