"""The list of figures: what each shows, how much work it is, how it is made."""

from argparse import ArgumentTypeError
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from figures import braids, lengths, lifted, shares, snapshots, style
from figures.effort import Effort, Tick
from pirrht.errors import OptionError

NOISES = (0.1, 0.3)  # of the drives of Fig. 2
MOMENTS, CAR_MOMENTS = (0.0, 0.3, 0.6, 0.85), (0.0, 0.35, 0.7)  # shares of the driven time

Draw = Callable[[Any, Effort, Tick], Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A figure that can be made."""

    name: str  # of its file
    text: str
    pieces: Callable[[Effort], int]  # of work; each is told when it is done
    draw: Draw  # (pyplot, effort, tick) -> matplotlib figure


def _of(module: Any) -> Draw:
    """Draw what a module works out."""
    return lambda plt, effort, tick: module.draw(plt, module.work(effort, tick))


def _points(plt: Any, effort: Effort, tick: Tick) -> Any:
    drives = []
    for noise in NOISES:
        drives.append(snapshots.drive(effort.scenario("slit", noise=noise), MOMENTS))
        tick()
    labels = [f"$b$ = {noise:g}, " for noise in NOISES]
    return snapshots.draw(plt, drives, labels=labels, width=style.PAGE, whole=False)


def _car(plt: Any, effort: Effort, tick: Tick) -> Any:
    drive = snapshots.drive(effort.scenario("clutter"), CAR_MOMENTS)
    tick()
    return snapshots.draw(plt, [drive], labels=[""], width=style.PAGE, whole=True)


FIGURES = {
    1: Entry(name="fig1-tree", text="the tree in the H-augmented space", pieces=lambda _: 1, draw=_of(lifted)),
    2: Entry(name="fig2-drives", text="drives with little and much noise", pieces=lambda _: len(NOISES), draw=_points),
    3: Entry(name="fig3-lengths", text="path lengths per class and iteration", pieces=lambda _: 1, draw=_of(lengths)),
    4: Entry(name="fig4-car", text="a drive of the car", pieces=lambda _: 1, draw=_car),
    5: Entry(name="fig5-shares", text="class shares against noise", pieces=lambda e: len(e.noises), draw=_of(shares)),
    6: Entry(
        name="fig6-braids", text="classes in space and time", pieces=lambda _: len(braids.SCENES), draw=_of(braids)
    ),
}


def chosen(text: str | None) -> list[int]:
    """Figure numbers from text such as 1,3; all if there is none.

    Raises:
        OptionError: no such figure.
    """
    numbers = [part.strip() for part in text.split(",")] if text is not None else [str(k) for k in FIGURES]
    unknown = [part for part in numbers if part not in map(str, FIGURES)]
    if unknown:
        raise OptionError(f"--only: there is no figure {unknown[0]!r}; name some of {','.join(map(str, FIGURES))}")
    return sorted({int(part) for part in numbers})


def dots(text: str) -> int:
    """A resolution [1/in] from 50 to 1200."""
    if not (text.isdecimal() and 50 <= int(text) <= 1200):
        raise ArgumentTypeError(f"{text!r} must be a whole number from 50 to 1200")
    return int(text)


def open_folder(path: Path) -> None:
    """Make sure that a folder exists.

    Raises:
        OptionError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OptionError(f"-o {path}: no folder can be made there ({error.strerror}); choose another") from None


def make(number: int, folder: Path, format: str, effort: Effort, tick: Tick, *, dpi: int = style.DPI) -> Path:
    """Make one figure and write it; its file.

    Raises:
        OptionError: matplotlib is missing or the file cannot be written.
    """
    from pirrht.plotting.maps import pyplot

    entry, plt = FIGURES[number], pyplot("this script")
    file = style.check(folder, entry.name, format)
    with plt.rc_context(style.RULES):
        figure = entry.draw(plt, effort, tick)
        try:
            style.save(figure, file, dpi)
        finally:
            plt.close(figure)
    return file
