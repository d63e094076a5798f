"""Pictures of a MuJoCo scene without a window: by EGL on Linux, or by what MUJOCO_GL names."""

from __future__ import annotations

import copy
import importlib
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import OptionError
from sim.drawing.colors import Color
from sim.mjcf.dressed import dress, has_sky

Picture = NDArray[np.uint8]  # (height, width, 3)

CHOSEN = os.environ.get("MUJOCO_GL") or not sys.platform.startswith("linux")  # MuJoCo has read it when imported
BACKEND = "mujoco.egl"
SKY: Color = (204, 216, 228)  # behind what has no sky
MOST = 6000  # shapes in a picture
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
        self._sky = has_sky(self._model)
        try:
            self._gl = (mujoco if CHOSEN else importlib.import_module(BACKEND)).GLContext(width, height)
            self._gl.make_current()
        except Exception as error:  # whatever a driver and its bindings raise
            why = f"{'MUJOCO_GL' if CHOSEN else BACKEND}: {str(error).splitlines()[0][:80]}"
            remedy = "install libegl1, or libosmesa6 and set MUJOCO_GL=osmesa, or leave it out"
            raise OptionError(f"{option}: nothing draws without a window ({why}); {remedy}") from None
        self._renderer = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
        self._frame = mujoco.MjrRect(0, 0, width, height)
        self._scene = mujoco.MjvScene(self._model, maxgeom=MOST)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._options, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()

    def look_at(self, center: Array, *, distance: float, elevation: float) -> None:
        """Look northward at a point (3,) from a distance [m], down by an angle [degrees]."""
        self._camera.lookat[:] = center
        self._camera.distance, self._camera.elevation, self._camera.azimuth = distance, -elevation, 90.0

    def pose(self, data: mujoco.MjData) -> None:
        """Take the places of all bodies from data; what was added before is gone."""
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._options, None, self._camera, everything, self._scene)

    def line(self, points: Array, color: Color, radius: float) -> None:
        """Add a polyline (k, 3)."""
        self._join(points, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, np.array([*color, 255]) / 255, 0.2)

    def thin(self, strips: NDArray[np.float32], colors: Array) -> None:
        """Add thin polylines (s, k, 3) in colours (s, 4), from 0 to 1."""
        for strip, rgba in zip(strips.astype(float), colors, strict=True):
            self._join(strip, mujoco.mjtGeom.mjGEOM_LINE, THIN, rgba, 0.6)

    def label(self, place: Array, text: str) -> None:
        """Add a text at a place (3,)."""
        if (shape := self._add(mujoco.mjtGeom.mjGEOM_LABEL, place, np.ones(4))) is not None:
            shape.label = text

    def _join(self, points: Array, kind: mujoco.mjtGeom, width: float, rgba: Array, emission: float) -> None:
        for a, b in zip(points[:-1], points[1:], strict=True):
            if (shape := self._add(kind, ORIGIN, rgba)) is not None:
                mujoco.mjv_connector(shape, kind, width, a, b)
                shape.emission = emission

    def _add(self, kind: mujoco.mjtGeom, center: Array, rgba: Array) -> Any:
        """Return one more shape; None where there are enough."""
        if self._scene.ngeom == MOST:
            return None
        shape = self._scene.geoms[self._scene.ngeom]
        mujoco.mjv_initGeom(shape, kind, ORIGIN, center, AXES, rgba.astype(np.float32))
        self._scene.ngeom += 1
        return shape

    def draw(self, rows: Sequence[tuple[str, Color]] = ()) -> Picture:
        """Return the picture, with rows of text in the upper left corner, each in its colour."""
        self._gl.make_current()
        mujoco.mjr_render(self._frame, self._scene, self._renderer)
        width, height, scale = self._frame.width, self._frame.height, self._frame.height / 720.0
        if rows:
            wide = round(scale * (2 * INSET + LETTER * max(len(text) for text, _ in rows)))
            high = round(scale * (INSET + ROW * len(rows)))
            mujoco.mjr_rectangle(mujoco.MjrRect(0, height - high, wide, high), *PANEL)
            mujoco.mjr_rectangle(self._frame, 0.0, 0.0, 0.0, 0.0)  # what texts are placed in
        for k, (text, color) in enumerate(rows, 1):
            at, font = (scale * INSET / width, 1.0 - scale * ROW * k / height), mujoco.mjtFont.mjFONT_NORMAL
            mujoco.mjr_text(font, text, self._renderer, *at, *(channel / 255.0 for channel in color))
        pixels, depth = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
        mujoco.mjr_readPixels(pixels, depth, self._frame, self._renderer)
        if not self._sky:
            pixels[(depth >= 1.0) & ~pixels.any(axis=2)] = SKY  # what is transparent has no depth
        return pixels[::-1]

    def close(self) -> None:
        """Give the memory of the graphics back."""
        self._gl.make_current()
        self._renderer.free()
        with suppress(Exception):  # MuJoCo 4.0 cannot let go of OSMesa's
            self._gl.free()
        self._gl._context = None  # or it would complain when the process ends
