"""A run as a film: MuJoCo's scene with references, samples, driven path and predicted moving obstacles drawn in."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.errors import OptionError
from pirrht.estimation.sampler import PathIntegral
from sim.drawing.colors import DEAD_COLOR, DRIVEN, MOVER, ClassColors, Color, mix, rgb, title
from sim.drawing.sides import NAMED
from sim.drawing.strokes import DEAD, Fan, at_most, fans
from sim.drawing.tubes import foreseen
from sim.drive.episode import Frame
from sim.files import replaced
from sim.film.offscreen import Offscreen, Picture
from sim.mjcf import Loaded
from sim.mjcf.coordinates import Stance
from sim.mjcf.motions import Mocap

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
FORESEEN = mix(MOVER, (0, 0, 0), 0.4)


class Film:
    """Collects the frames of a run and draws them afterwards.

    Args:
        video: the film's file, .mp4.
        still: the file of its last picture, .png.
        size: of pictures that `shots` returns, width and height.

    Raises:
        OptionError: files that cannot be made, for want of a library, of graphics or of the right ending.
    """

    def __init__(
        self, loaded: Loaded, *, video: Path | None = None, still: Path | None = None,
        size: tuple[int, int] | None = None,
    ) -> None:  # fmt: skip
        wide, high = size or (WIDTH, HEIGHT)
        self._video, self._still = video, still
        for file, option, ending, library in ((video, "--video", ".mp4", "av"), (still, "--png", ".png", "PIL")):
            if file is not None:
                _check(file, option, ending, library)
        self._eye = Offscreen(loaded.model, width=wide, height=high, option="--png" if video is None else "--video")
        self._scene = scene = loaded.scene
        extent = scene.upper - scene.lower
        across = max(float(extent[1]), float(extent[0]) * high / wide)
        center = np.array([*(scene.lower + (0.5, 0.46) * extent), 0.0])  # what is near takes more of the picture
        self._thick = max(1.0, across / 6.0)  # of lines
        self._eye.look_at(center, distance=1.32 * across, elevation=ELEVATION)
        self._model, self._data = loaded.model, mujoco.MjData(loaded.model)
        self._stance, self._colors = Stance(loaded.model, loaded.states), ClassColors()
        self._mocap = Mocap(loaded.model, scene.movers) if scene.movers else None
        self._path: list[Array] = []  # rows of a time [s] and a state
        self._times: list[float] = []  # of plans
        self._plans: list[tuple[Plan, dict[str, Fan]]] = []
        self._drawn = -np.inf  # time of the samples drawn last [s]

    def add(self, frame: Frame, path_integral: PathIntegral | None = None) -> None:
        """Take a control step in.

        Args:
            path_integral: that drew the samples of its plan; without it none are shown.
        """
        plan, states = frame.plan, frame.advance.states
        if not self._plans:
            self._path.append(np.append(0.0, plan.state)[None])
        times = frame.time + frame.advance.time * np.arange(1, len(states) + 1) / max(1, len(states))
        self._path.append(np.column_stack([times, states]))
        found = self._plans[-1][1] if self._plans else {}
        if frame.time >= self._drawn + FRESH - 1e-9:
            self._drawn, found = frame.time, {}
            if path_integral is not None and plan.estimate is not None:
                found = fans(path_integral, plan.estimate, plan.classes, points=SAMPLED, everything=False)
        self._times.append(frame.time)
        self._plans.append((plan, found))
        self._colors.meet(plan.ids)

    @property
    def length(self) -> int:
        """Pictures in the film."""
        return 1 + int(self._path[-1][-1, 0] * RATE) + round(HOLD * RATE)

    def shots(self, times: Sequence[float]) -> list[Picture]:
        """Pictures (height, width, 3) at times of the run [s], the last one for any later time."""
        return [self._picture(time) for time in times]

    def save(self, progress: Callable[[int], None]) -> None:
        """Draw everything and write the files; `progress` is called for each picture.

        Raises:
            OptionError: a file cannot be written.
        """
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
        self._eye.close()

    def _pictures(self, progress: Callable[[int], None]) -> Iterator[Picture]:
        moving = self.length - round(HOLD * RATE)
        for k in range(self.length):
            if k <= moving:
                picture = self._picture(k / RATE if k < moving else np.inf)
            yield picture
            progress(1)

    def _picture(self, time: float) -> Picture:
        path = np.concatenate(self._path)
        path = path[: np.searchsorted(path[:, 0], time + 1e-9, side="right")]
        now, state, eye, over = float(path[-1, 0]), path[-1, 1:], self._eye, time >= self._path[-1][-1, 0]
        self._stance.place(self._data, state, np.zeros(2), np.zeros(self._model.nu))
        if self._mocap is not None:
            self._mocap.place(self._data, now)
        mujoco.mj_forward(self._model, self._data)
        eye.pose(self._data)
        plan, samples = self._plans[int(np.searchsorted(self._times, time + 1e-9, side="right")) - 1]
        weights = plan.estimate.class_weights if plan.estimate else {}
        for reference, name in zip(plan.references, plan.ids, strict=True):
            radius = 0.008 + 0.02 * float(np.sqrt(weights.get(name, 0.0)))
            self._line(at_most(reference.trajectory.points, REFERENCE_POINTS), 0.02, self._colors[name], radius)
        for name, fan in samples.items():  # the heavier the stronger; grey ones do not arrive
            color = DEAD_COLOR if name == DEAD else self._colors[name]
            opacity = np.full(len(fan.strips), 0.35) if name == DEAD else 0.25 + 0.75 * fan.opacity
            eye.thin(fan.strips, np.column_stack([np.tile(rgb(color), (len(opacity), 1)), opacity]))
        for mover in self._scene.movers if len(self._scene.movers) <= NAMED else ():
            top = max(float(solid.position[2]) for solid in mover.solids)
            eye.label(np.array([*mover.motion.pose(now)[:2], top]), mover.name.replace("_", " "))
        for one in () if over else foreseen(plan.movers, plan.time):
            if one.after > 0.0:
                self._line(one.ring, 0.01, mix(GROUND, FORESEEN, one.strength), 0.008)
        self._line(at_most(path[:, 1:3], PATH_POINTS), 0.03, DRIVEN, 0.015)
        heavy = sorted((n for n in plan.ids if weights.get(n, 0.0) >= FEWEST), key=lambda n: -weights[n])[:ROWS]
        rows = [(f"{title(n)}  {100 * weights[n]:.0f} %", mix(self._colors[n], (255, 255, 255), 0.3)) for n in heavy]
        return eye.draw([(f"{now:.1f} s", INK), *rows])

    def _line(self, points: Array, height: float, color: Color, radius: float) -> None:
        """Draw a polyline (k, 2) at a height, as thick as the scene is large [m]."""
        self._eye.line(np.column_stack([points, np.full(len(points), height)]), color, radius * self._thick)


def _check(file: Path, option: str, ending: str, library: str) -> None:
    if file.suffix.lower() != ending:
        raise OptionError(f"{option} {file}: the ending must be {ending}")
    try:
        __import__(library)
    except ImportError as error:
        raise OptionError(f"{option} needs the extra `video` ({error}); pip install 'pirrht[video]'") from None


def _encode(stream: Any, pictures: Iterator[Picture]) -> None:
    """Write H.264 in MP4, as browsers and players take it.

    Raises:
        OSError: the stream takes no more.
    """
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
