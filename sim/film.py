"""A run as a film: MuJoCo's scene with references, samples, driven path and predicted moving obstacles drawn in.

Pictures are drawn without a window: by EGL on Linux, or by what MUJOCO_GL names.
"""

import copy
import importlib
import os
import sys
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from math import atan2, degrees, hypot
from operator import itemgetter
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.errors import OptionError
from pirrht.estimation.sampler import PathIntegral
from pirrht.mapping.believed import Believed
from pirrht.plotting.colors import ClassColors, Color, blend, rgb
from pirrht.plotting.strokes import rings
from sim.drawing.colors import DEAD_COLOR, DRIVEN, MOVER, NAMED, title
from sim.drawing.map_panel import Panel
from sim.drawing.strokes import DEAD, Fan, at_most, fans, foreseen, heavy_ends
from sim.drawing.ways import ways_in
from sim.drive.metrics import Frame
from sim.extras import require
from sim.files import replaced
from sim.mjcf import Loaded
from sim.mjcf.edits import dress
from sim.mjcf.names import names_of
from sim.mjcf.obstacles import Mocap

Picture = NDArray[np.uint8]  # (height, width, 3)

WIDTH, HEIGHT = 1280, 720
RATE = 30  # pictures per second
HOLD = 1.0  # how long the last picture stays [s]
ELEVATION = 68.0  # of the eye [degrees]
REFERENCE_POINTS, PATH_POINTS = 32, 300
FRESH = 0.1  # after which other samples are drawn [s]
SAMPLED = 800  # points of samples in a picture
FEWEST, ROWS = 0.005, 6  # share of psi from which a class is in the list, and classes in it at most
INK: Color = (240, 240, 236)
GROUND: Color = (206, 209, 207)  # into which predicted outlines fade
FORESEEN = blend(MOVER, (0, 0, 0), 0.4)
CHOSEN = os.environ.get("MUJOCO_GL") or not sys.platform.startswith("linux")  # MuJoCo has read it when imported
BACKEND = "mujoco.egl"
SKY: Color = (204, 216, 228)  # behind what has no sky
MOST = 6000  # shapes in a picture
THIN = 1.5  # width of thin lines [px]
INSET, ROW, LETTER = 14.0, 26.0, 12.0  # of texts at 150 % [px]
PER_SIZE, SIZES = 240, range(2, 7)  # rows of pixels for each 50 % of letters, and multiples of that which MuJoCo has
PANEL = (0.08, 0.09, 0.10, 0.85)  # behind them
SLICES, STACKS = 28, 8  # corners of round shapes
ORIGIN = np.zeros(3)
AXES = np.eye(3).ravel()


class Film:
    """Collects the frames of a run and draws them afterwards.

    Args:
        video: the film's file, .mp4.
        still: the file of its last picture, .png.
        size: of pictures that `shots` returns, width and height.
        ways: what to call classes, by id; others by what they pass, or by their titles.
        known: whether a map of what the robot knows is at the right.

    Raises:
        OptionError: files that cannot be made, for want of a library, of graphics or of the right ending.
    """

    def __init__(
        self, loaded: Loaded, *, video: Path | None = None, still: Path | None = None,
        size: tuple[int, int] | None = None, ways: Mapping[str, str] | None = None, known: bool = False,
    ) -> None:  # fmt: skip
        wide, high = size or (WIDTH, HEIGHT)
        self._video, self._still = video, still
        for file, option, ending in ((video, "--video", ".mp4"), (still, "--png", ".png")):
            if file is not None:
                require(option, "video")
                if file.suffix.lower() != ending:
                    raise OptionError(f"{option} {file}: the ending must be {ending}")
        self._panel = Panel(loaded.scene, (wide, high)) if known else None
        wide -= 0 if self._panel is None else self._panel.width
        self._model = model = copy.copy(loaded.model)
        model.vis.global_.offwidth, model.vis.global_.offheight = wide, high
        # Without a GPU corners and mirrors are what takes time: 100 ms a picture instead of 800.
        model.vis.quality.numslices, model.vis.quality.numstacks = SLICES, STACKS
        model.mat_reflectance[:] = 0.0
        dress(model)
        self._sky = bool(np.any(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX))
        try:
            self._gl = (mujoco if CHOSEN else importlib.import_module(BACKEND)).GLContext(wide, high)
            self._gl.make_current()
        except Exception as error:  # whatever a driver and its bindings raise
            why = f"{'MUJOCO_GL' if CHOSEN else BACKEND}: {str(error).splitlines()[0][:80]}"
            remedy = "install libegl1, or libosmesa6 and set MUJOCO_GL=osmesa, or leave it out"
            option = "--png" if video is None else "--video"
            raise OptionError(f"{option}: pictures cannot be drawn without a window ({why}); {remedy}") from None
        letters = min(max(round(high / PER_SIZE), SIZES[0]), SIZES[-1])
        self._renderer, self._text_scale = mujoco.MjrContext(model, 50 * letters), letters / 3.0
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
        self._frame = mujoco.MjrRect(0, 0, wide, high)
        self._shapes = mujoco.MjvScene(model, maxgeom=MOST)
        self._shapes.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0

        self._options = mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        self._scene = loaded.scene

        extent = self._scene.upper - self._scene.lower
        across = max(float(extent[1]), float(extent[0]) * high / wide)
        self._thick = max(1.0, across / 6.0)  # of lines
        if len(extent) == 3:
            eye, target = loaded.overview
            east, north, up = target - eye
            level = hypot(east, north)
            self._camera.lookat[:], self._camera.distance = target, hypot(level, up)
            self._camera.azimuth, self._camera.elevation = degrees(atan2(north, east)), degrees(atan2(up, level))
        else:  # what is near takes more of the picture, which looks northward
            self._camera.lookat[:] = [*(self._scene.lower + (0.5, 0.46) * extent), 0.0]
            self._camera.distance, self._camera.elevation, self._camera.azimuth = 1.32 * across, -ELEVATION, 90.0
        self._data = mujoco.MjData(model)
        self._states = loaded.adapter
        self._joints = self._states.joints(loaded.model)
        self._mocap = Mocap(loaded.model, self._scene.movers) if self._scene.movers else None
        self._colors = ClassColors()
        self._path: list[Array] = []  # rows of a time [s], a state, and perhaps an attitude
        # Plans with their times [s], samples, words of classes, and what was known.
        self._plans: list[tuple[float, Plan, dict[str, Fan], dict[str, str], Believed | None]] = []
        self._drawn, self._samples = -np.inf, dict[str, Fan]()  # what was drawn last, and when [s]
        self._words = dict(ways or {})  # of classes
        self._end = ""  # how the run ended
        self._loaded = loaded

    def add(self, frame: Frame, path_integral: PathIntegral | None = None) -> None:
        """Take a control step in, and what drew the samples of its plan; without it none are shown."""
        plan, states = frame.plan, frame.advance.states
        if not self._plans:
            self._path.append(np.hstack([0.0, plan.state, frame.advance.attitudes[0]])[None])
        times = frame.time + frame.advance.time * np.arange(1, len(states) + 1) / max(1, len(states))
        self._path.append(np.column_stack([times, states, frame.advance.attitudes]))
        if frame.time >= self._drawn + FRESH - 1e-9:
            self._drawn, self._samples = frame.time, {}
            if path_integral is not None and plan.estimate is not None:
                self._samples = fans(path_integral, plan.estimate, plan.classes, points=SAMPLED, everything=False)
            if plan.space is not None:
                ways = ways_in(plan.space, plan.references, names_of(self._loaded, plan.space))
                # From the start on a class keeps its words, whatever is left of its path.
                self._words = dict(zip(plan.ids, ways, strict=False)) | self._words
        self._plans.append((frame.time, plan, self._samples, self._words, frame.believed))
        self._end = "" if frame.outcome is None else f"{frame.outcome.name.lower()} after "
        self._colors.meet(plan.ids)

    @property
    def length(self) -> int:
        """Pictures in the film."""
        return 1 + int(self._path[-1][-1, 0] * RATE) + round(HOLD * RATE)

    def shots(self, times: Sequence[float]) -> list[Picture]:
        """Pictures (height, width, 3) at times of the run [s], the last one for any later time."""
        return [self._picture(time) for time in times]

    def save(self, progress: Callable[[int], None]) -> None:
        """Draw and write the files, or raise OptionError if one cannot be; `progress` is called for each picture."""
        if self._video is not None:
            with replaced(self._video, "--video") as stream:
                _encode(stream, self._pictures(progress))
        if self._still is not None:
            from PIL import Image

            with replaced(self._still, "--png") as stream:
                Image.fromarray(self._picture(np.inf)).save(stream, "png")
        self.close()

    def close(self) -> None:
        """Give the memory of the graphics back; two films cannot draw in turns."""
        self._gl.make_current()
        self._renderer.free()
        with suppress(Exception):  # MuJoCo 4.0 cannot let go of OSMesa's
            self._gl.free()
        self._gl._context = None  # or it would complain when the process ends

    def _pictures(self, progress: Callable[[int], None]) -> Iterator[Picture]:
        moving = self.length - round(HOLD * RATE)
        last = self._picture(np.inf)

        for k in range(self.length):
            yield self._picture(k / RATE) if k < moving else last
            progress(1)

    def _picture(self, time: float) -> Picture:
        path = np.concatenate(self._path)
        path = path[: np.searchsorted(path[:, 0], time + 1e-9, side="right")]

        now = float(path[-1, 0])
        state = path[-1, 1:]
        over = time >= self._path[-1][-1, 0]

        self._pose(state, now)
        _, plan, samples, words, known = self._plans[bisect_right(self._plans, time + 1e-9, key=itemgetter(0)) - 1]
        weights = {} if over else self._plan(plan, samples)
        if not self._scene.body.is_disc:
            self._line(rings(self._scene.body, self._states.poses(state[None]))[0], 0.035, DRIVEN, 0.01)
        for mover in self._scene.movers if len(self._scene.movers) <= NAMED else ():
            top = max(float(solid.position[2]) for solid in mover.at(now))
            place = np.array([*mover.motion.pose(now)[:2], top])
            if (shape := self._add(mujoco.mjtGeom.mjGEOM_LABEL, place, np.ones(4))) is not None:
                shape.label = mover.name.replace("_", " ")
        driven = self._states.drawn(at_most(path[:, 1:], PATH_POINTS), 0.03)
        self._tube(driven, DRIVEN, 0.015)
        heavy = sorted((n for n in plan.ids if weights.get(n, 0.0) >= FEWEST), key=lambda n: -weights[n])[:ROWS]
        texts = [f"{words.get(n, title(n))}  {100 * weights[n]:.0f} %" for n in heavy]
        rows = [(text, blend(self._colors[n], (255, 255, 255), 0.3)) for text, n in zip(texts, heavy, strict=True)]
        picture = self._draw([(f"{self._end if over else ''}{now:.1f} s", INK), *rows])
        if self._panel is None:
            return picture
        poses = self._states.poses(path[:, 1:])
        return np.hstack([picture, self._panel.draw(known, () if over else self._drawn_lines(plan), poses)])

    def _drawn_lines(self, plan: Plan) -> list[tuple[Array, Color, float]]:
        """Return the references of a plan, their colours, and the weights of their classes."""
        weights = plan.estimate.class_weights if plan.estimate else {}
        return [
            (at_most(one.trajectory.points, REFERENCE_POINTS), self._colors[name], weights.get(name, 0.0))
            for one, name in zip(plan.references, plan.ids, strict=True)
        ]

    def _plan(self, plan: Plan, samples: Mapping[str, Fan]) -> Mapping[str, float]:
        """Draw what a plan expects: references, samples and predicted outlines; return the shares of its classes."""
        weights = plan.estimate.class_weights if plan.estimate else {}
        for line, color, weight in self._drawn_lines(plan):
            self._line(line, 0.02, color, 0.008 + 0.02 * float(np.sqrt(weight)))
        for name, fan in samples.items():  # the heavier the stronger; grey ones do not arrive
            color = DEAD_COLOR if name == DEAD else self._colors[name]
            opacity = np.full(len(fan.strips), 0.35) if name == DEAD else 0.25 + 0.75 * fan.opacity
            for strip, share in zip(fan.strips.astype(float), opacity, strict=True):
                self._join(strip, mujoco.mjtGeom.mjGEOM_LINE, THIN, np.array([*rgb(color), share]), 0.6)
            for ring in heavy_ends(self._scene.body, fan):
                self._line(ring, 0.012, color, 0.004)
        for one in foreseen(plan.movers, plan.time):
            if one.after > 0.0:
                self._line(one.ring, 0.01, blend(GROUND, FORESEEN, one.strength), 0.008)
        return weights

    def _pose(self, state: Array, time: float) -> None:
        """Place all bodies as in a state, perhaps with an attitude, at a time [s]; what was drawn before is gone."""
        self._joints.place(self._data, state, np.zeros(2), np.zeros(self._model.nu))
        if self._mocap is not None:
            self._mocap.place(self._data, time)
        mujoco.mj_forward(self._model, self._data)
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, self._data, self._options, None, self._camera, everything, self._shapes)

    def _line(self, points: Array, height: float, color: Color, radius: float) -> None:
        """Draw a polyline (k, 3), or (k, 2) at a height, as thick as the scene is large [m]."""
        self._tube(np.column_stack([points, np.full(len(points), height)])[:, :3], color, radius)

    def _tube(self, points: Array, color: Color, radius: float) -> None:
        """Draw a polyline (k, 3), as thick as the scene is large [m]."""
        self._join(points, mujoco.mjtGeom.mjGEOM_CAPSULE, radius * self._thick, np.array([*rgb(color), 1.0]), 0.2)

    def _join(self, points: Array, kind: mujoco.mjtGeom, width: float, rgba: Array, emission: float) -> None:
        for a, b in zip(points[:-1], points[1:], strict=True):
            if (shape := self._add(kind, ORIGIN, rgba)) is not None:
                mujoco.mjv_connector(shape, kind, width, a, b)
                shape.emission = emission

    def _add(self, kind: mujoco.mjtGeom, center: Array, rgba: Array) -> Any:
        """Return one more shape; None where there are enough."""
        if self._shapes.ngeom == MOST:
            return None
        shape = self._shapes.geoms[self._shapes.ngeom]
        mujoco.mjv_initGeom(shape, kind, ORIGIN, center, AXES, rgba.astype(np.float32))
        self._shapes.ngeom += 1
        return shape

    def _draw(self, rows: Sequence[tuple[str, Color]]) -> Picture:
        """Return the picture, with rows of text in the upper left corner, each in its colour."""
        self._gl.make_current()
        mujoco.mjr_render(self._frame, self._shapes, self._renderer)
        width, height, scale = self._frame.width, self._frame.height, self._text_scale
        wide = round(scale * (2 * INSET + LETTER * max(len(text) for text, _ in rows)))
        high = round(scale * (INSET + ROW * len(rows)))
        mujoco.mjr_rectangle(mujoco.MjrRect(0, height - high, wide, high), *PANEL)
        mujoco.mjr_rectangle(self._frame, 0.0, 0.0, 0.0, 0.0)  # what texts are placed in
        for k, (text, color) in enumerate(rows, 1):
            at, font = (scale * INSET / width, 1.0 - scale * ROW * k / height), mujoco.mjtFont.mjFONT_NORMAL
            mujoco.mjr_text(font, text, self._renderer, *at, *(channel / 255.0 for channel in color))
        pixels = np.empty((height, width, 3), np.uint8)
        depth = np.empty((height, width), np.float32)
        mujoco.mjr_readPixels(pixels, depth, self._frame, self._renderer)
        if not self._sky:
            pixels[(depth >= 1.0) & ~pixels.any(axis=2)] = SKY  # what is transparent has no depth
        return pixels[::-1]


def _encode(stream: Any, pictures: Iterator[Picture]) -> None:
    """Write H.264 in MP4, as browsers and players take it; OSError where the stream takes no more."""
    import av

    try:
        with av.open(stream, "w", format="mp4") as container:
            track = container.add_stream("libx264", rate=RATE, options={"crf": "20"})
            track.width, track.height, track.pix_fmt = WIDTH, HEIGHT, "yuv420p"
            for picture in pictures:
                container.mux(track.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")))
            container.mux(track.encode())
    except av.FFmpegError as error:  # of closing what could not be written
        found: BaseException | None = error
        while found is not None and not isinstance(found, OSError):
            found = found.__context__
        raise found or OSError(str(error)) from None
