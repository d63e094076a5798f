"""The picture that the documentation opens with: drives side by side, as pixels, one picture after another."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from figures import ground, snapshots, style
from figures.snapshots import Drive
from pirrht.plotting.colors import ClassColors
from sim.drawing.colors import title
from sim.film import Film

WIDTH, DPI = 7.6, 100  # of a picture [in], and its dots per inch
MARGIN = 0.9  # of the workspace that is left out above and below [m]
NOTE = (
    "thin: sampled futures in the colour of their way; grey: those that end in a wall; {}bar: how probable each way is"
)


def pictures(
    plt: Any,
    drives: Sequence[Drive],
    *,
    labels: Sequence[str],
    times: Sequence[float],
    ways: Mapping[str, str],
    note: str = NOTE,
) -> Iterator[NDArray[np.uint8]]:
    """Pictures (height, width, 3) of all drives at each time [s]; a drive that is over shows its end.

    Args:
        labels: what each drive is called, above it.
        ways: what classes are called, by id; others by their titles.
        note: what there is to be seen, below the pictures.
    """
    scene = drives[0].scenario.loaded.scene
    margin = np.array([0.0, MARGIN])
    low, high = scene.lower + margin, scene.upper - margin
    height = WIDTH / len(drives) * float((high - low)[1] / (high - low)[0])
    colors = ClassColors(name for one in drives for name in one.frames[0].plan.ids)
    for time in times:
        figure, panels = plt.subplots(1, len(drives), figsize=(WIDTH, height + 0.62), squeeze=False, dpi=DPI)
        figure.subplots_adjust(
            left=0.01, right=0.99, bottom=0.22 / (height + 0.62), top=1 - 0.3 / (height + 0.62), wspace=0.03
        )
        for axes, one, label in zip(panels[0], drives, labels, strict=True):
            _one(axes, one, time, colors, height)
            axes.set_title(f"{label}, {_shares(one, time, ways)}", fontsize=9, loc="left", pad=4)
            ground.frame(axes, low, high)
            axes.set_axis_off()
        figure.text(0.01, 0.03 / height, note, fontsize=8.5, color=style.INK)
        yield pixels(figure)
        plt.close(figure)


def filmed(
    plt: Any, films: Sequence[Film], *, labels: Sequence[str], times: Sequence[float], note: str = NOTE
) -> Iterator[NDArray[np.uint8]]:
    """Pictures (height, width, 3) of all films at each time [s], in MuJoCo's look; `labels` and `note` as above."""
    shots = [film.shots(times) for film in films]
    high, wide, _ = shots[0][0].shape
    height = WIDTH / len(films) * high / wide
    for row in zip(*shots, strict=True):
        figure, panels = plt.subplots(1, len(films), figsize=(WIDTH, height + 0.5), squeeze=False, dpi=DPI)
        figure.subplots_adjust(0.0, 0.22 / (height + 0.5), 1.0, 1.0 - 0.26 / (height + 0.5), wspace=0.02)
        for axes, picture, label in zip(panels[0], row, labels, strict=True):
            axes.imshow(picture)
            axes.set_title(label, fontsize=10, loc="left", pad=4)
            axes.set_axis_off()
        figure.text(0.0, 0.02, note, fontsize=8.5, color=style.INK)
        yield pixels(figure)
        plt.close(figure)


def _step(one: Drive, time: float) -> int:
    begun = [frame.time for frame in one.frames]
    return max(0, int(np.searchsorted(begun, time + 1e-9, side="right")) - 1)


def _one(axes: Any, one: Drive, time: float, colors: ClassColors, height: float) -> None:
    """A drive at a time: its plan while it goes on, else its whole path."""
    if time < one.frames[-1].end_time:
        step = _step(one, time)
        snapshots.panel(axes, one, step, colors)
        snapshots.weights(axes, one.frames[step], colors, 1.6 * height)
        return
    scene = one.scenario.loaded.scene
    ground.draw(axes, scene, one.frames[-1].end_time)
    path = one.driven(len(one.frames))
    axes.plot(*path.T, color=style.INK, lw=0.8, zorder=8)
    ground.robot(axes, scene, one.frames[-1].advance.states[-1])


def _shares(one: Drive, time: float, ways: Mapping[str, str]) -> str:
    """The favourite class and its share, or that the drive is over."""
    last = one.frames[-1]
    if time >= last.end_time:
        outcome = last.outcome.name.lower() if last.outcome is not None else "under way"
        return f"{outcome} after {last.end_time:.1f} s"
    frame = one.frames[_step(one, time)]
    shares = frame.plan.estimate.class_weights if frame.plan.estimate else {}
    if not shares:
        return f"{frame.time:.1f} s"
    name = max(shares, key=lambda each: shares[each])
    return f"{frame.time:.1f} s: {ways.get(name, title(name))} {100 * shares[name]:.0f} %"


def pixels(figure: Any) -> NDArray[np.uint8]:
    """A figure as a picture (height, width, 3)."""
    figure.canvas.draw()
    return np.array(figure.canvas.buffer_rgba())[..., :3]
