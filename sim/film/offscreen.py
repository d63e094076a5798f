"""Pictures of a MuJoCo scene without a window: by EGL, else by OSMesa, or by what MUJOCO_GL names."""

from __future__ import annotations

import copy
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import OptionError
from sim.drawing.colors import Color
from sim.mjcf.dressed import FLOOR, dress, has_floor, has_sky

Picture = NDArray[np.uint8]  # (height, width, 3)

BACKENDS = ("egl", "osmesa")
CHOSEN = os.environ.get("MUJOCO_GL")  # by the user; MuJoCo's bindings have read it when they were imported
SKY: Color = (204, 216, 228)  # behind what has no sky
MOST = 6000  # shapes in a picture
DEEP, SUNK = 0.02, 0.002  # half of a floor's thickness, and how far below 0 it begins, so that marks are seen on it [m]
THIN = 1.5  # width of thin lines [px]
INSET, ROW, LETTER = 14.0, 26.0, 12.0  # of texts in a picture 720 pixels high [px]
PANEL = (0.08, 0.09, 0.10, 0.85)  # behind them
SLICES, STACKS = 28, 8  # corners of round shapes
ORIGIN, AXES = np.zeros(3), np.eye(3).ravel()


class Offscreen:
    """Draws one model, with lines and texts added to it.

    Raises:
        OptionError: there is no way to draw; names the option that asked for it.
    """

    def __init__(self, model: mujoco.MjModel, *, width: int, height: int, option: str) -> None:
        self._model = copy.copy(model)
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        # Without a GPU corners and mirrors are what takes time: 100 ms a picture instead of 800.
        self._model.vis.quality.numslices, self._model.vis.quality.numstacks = SLICES, STACKS
        self._model.mat_reflectance[:] = 0.0
        dress(self._model)
        self._sky, self._floor = has_sky(self._model), has_floor(self._model)
        self._gl = _context(width, height, option)
        self._gl.make_current()
        self._renderer = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
        self._frame = mujoco.MjrRect(0, 0, width, height)
        self._scene = mujoco.MjvScene(self._model, maxgeom=MOST)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._rows: tuple[tuple[str, Color], ...] = ()
        self._options, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()

    def look_at(self, center: Array, *, distance: float, elevation: float) -> None:
        """Look northward at a point (3,) from a distance [m], down by an angle [degrees]."""
        self._camera.lookat[:] = center
        self._camera.distance, self._camera.elevation, self._camera.azimuth = distance, -elevation, 90.0

    def pose(self, data: mujoco.MjData) -> None:
        """Take the places of all bodies from data; what was added before is gone."""
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._options, None, self._camera, everything, self._scene)

    def _add(self, kind: mujoco.mjtGeom, size: Array, center: Array, rgba: Any) -> Any:
        """Return one more shape; None where there are enough."""
        if self._scene.ngeom == MOST:
            return None
        shape = self._scene.geoms[self._scene.ngeom]
        mujoco.mjv_initGeom(shape, kind, size, center, AXES, np.array(rgba, np.float32))
        self._scene.ngeom += 1
        return shape

    def ground(self, lower: Array, upper: Array) -> None:
        """Lay a floor between two corners (2,) [m] where the model has none."""
        if not self._floor:
            half = (upper - lower) / 2
            center = np.array([*(lower + half), -DEEP])
            self._add(mujoco.mjtGeom.mjGEOM_BOX, np.array([*half, DEEP - SUNK]), center, FLOOR)

    def line(self, points: Array, color: Color, radius: float) -> None:
        """Add a polyline (k, 3)."""
        self._join(points, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, np.array([*color, 255]) / 255, 0.2)

    def thin(self, strips: NDArray[np.float32], colors: NDArray[np.float32]) -> None:
        """Add thin polylines (s, k, 3) in colours (s, 4), from 0 to 1."""
        for strip, rgba in zip(strips.astype(float), colors, strict=True):
            self._join(strip, mujoco.mjtGeom.mjGEOM_LINE, THIN, rgba, 0.6)

    def _join(self, points: Array, kind: mujoco.mjtGeom, width: float, rgba: Any, emission: float) -> None:
        for a, b in zip(points[:-1], points[1:], strict=True):
            if (shape := self._add(kind, ORIGIN, ORIGIN, rgba)) is not None:
                mujoco.mjv_connector(shape, kind, width, a, b)
                shape.emission = emission

    def label(self, place: Array, text: str) -> None:
        """Add a text at a place (3,)."""
        if (shape := self._add(mujoco.mjtGeom.mjGEOM_LABEL, ORIGIN, place, np.ones(4))) is not None:
            shape.label = text

    def note(self, rows: Sequence[tuple[str, Color]]) -> None:
        """Write rows of text into the upper left corner, each in its colour, until other ones are given."""
        self._rows = tuple(rows)

    def _write(self) -> None:
        scale = self._frame.height / 720.0
        wide = round(scale * (2 * INSET + LETTER * max((len(text) for text, _ in self._rows), default=0)))
        high = round(scale * (INSET + ROW * len(self._rows)))
        if self._rows:
            mujoco.mjr_rectangle(mujoco.MjrRect(0, self._frame.height - high, wide, high), *PANEL)
            mujoco.mjr_rectangle(self._frame, 0.0, 0.0, 0.0, 0.0)  # what texts are placed in
        for k, (text, color) in enumerate(self._rows, 1):
            x, y = scale * INSET / self._frame.width, 1.0 - scale * ROW * k / self._frame.height
            ink = (channel / 255.0 for channel in color)
            mujoco.mjr_text(mujoco.mjtFont.mjFONT_NORMAL, text, self._renderer, x, y, *ink)

    def draw(self) -> Picture:
        """The picture."""
        self._gl.make_current()
        mujoco.mjr_render(self._frame, self._scene, self._renderer)
        self._write()
        pixels = np.empty((self._frame.height, self._frame.width, 3), np.uint8)
        depth = None if self._sky else np.empty(pixels.shape[:2], np.float32)
        mujoco.mjr_readPixels(pixels, depth, self._frame, self._renderer)
        if depth is not None:
            pixels[(depth >= 1.0) & ~pixels.any(axis=2)] = SKY  # what is transparent has no depth
        return pixels[::-1]

    def close(self) -> None:
        """Give the memory of the graphics back."""
        self._gl.make_current()
        self._renderer.free()
        try:
            self._gl.free()
        except Exception:  # MuJoCo 4.0 cannot let go of OSMesa's, and would complain again when the process ends
            self._gl._context = None


def _context(width: int, height: int, option: str) -> Any:
    """An OpenGL context, the first that can be had."""
    chosen = CHOSEN or ("" if sys.platform.startswith("linux") else "window system")
    reasons = []
    for name in ("",) if chosen else BACKENDS:
        try:
            if name:
                os.environ["MUJOCO_GL"] = name  # the library reads it too
            module = importlib.import_module(f"mujoco.{name}") if name else mujoco
            context = module.GLContext(width, height)
            context.make_current()
            return context
        except Exception as error:  # whatever a driver and its bindings raise
            reasons.append(f"{name or chosen}: {str(error).splitlines()[0][:80]}")
            if name:
                _forget_bindings()
    raise OptionError(
        f"{option}: nothing draws without a window ({'; '.join(reasons)}); install libegl1 or libosmesa6, "
        "or leave it out"
    )


def _forget_bindings() -> None:
    """Unload PyOpenGL, which serves one backend only."""
    for variable in ("MUJOCO_GL", "PYOPENGL_PLATFORM"):
        os.environ.pop(variable, None)
    for name in list(sys.modules):
        if name.split(".")[0] == "OpenGL" or name.startswith(tuple(f"mujoco.{backend}" for backend in BACKENDS)):
            del sys.modules[name]
