"""How the paper's figures look: sizes, type, the colours of the recordings, files that come out the same every time."""

from pathlib import Path
from typing import Any

from pirrht.errors import OptionError
from pirrht.plotting.colors import blend
from pirrht.plotting.colors import rgb as rgb
from pirrht.plotting.maps import INK as INK
from sim.drawing.colors import DEAD_COLOR
from sim.files import check_writable, replaced

COLUMN, PAGE = 3.5, 7.16  # widths of a column and of a page [in]
DPI = 300  # of PNG files
FORMATS = ("png", "pdf", "svg")

WALL, FLOOR, BORDER = "#5c6672", "#fbfbfa", "#8a8f96"
GOAL, GOAL_EDGE, ROBOT, LONGER = "#a9dab5", "#3c8f52", "#f28e1c", "#8c8c8c"
DEAD = blend(DEAD_COLOR, (255, 255, 255), 0.45)

RULES = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "axes.linewidth": 0.6,
    "axes.edgecolor": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "lines.linewidth": 1.3,
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "path",  # no viewer's fonts needed
    "svg.hashsalt": "pirrht",
}
METADATA: dict[str, dict[str, None]] = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}


def panel(axes: Any, index: int, text: str) -> None:
    """The letter of a panel and what it shows, above it."""
    axes.set_title(f"({chr(ord('a') + index)}) {text}".rstrip(), loc="left", pad=3.0)


def lines(axes: Any, **properties: Any) -> None:
    """Set labels and limits of a panel of lines by name; a thin grid below, no frame above and at the right."""
    axes.set(**properties)
    axes.grid(color="#e3e3e3", lw=0.4)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def space(axes: Any, lower: Any, upper: Any, heights: tuple[float, float], *, height: float, **view: float) -> None:
    """The axes of a panel in three dimensions: a workspace [m], and between two heights what is `height` [m] of it."""
    axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), zlim=heights)
    axes.set_box_aspect((*(upper - lower), height), zoom=1.08)
    axes.view_init(**view)
    axes.set_xlabel("$x$ [m]", labelpad=-5)
    axes.set_ylabel("$y$ [m]", labelpad=-5)
    axes.zaxis.set_rotate_label(False)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis._axinfo["grid"].update(color="#dddddd", linewidth=0.4)
        axis.line.set_linewidth(0.6)
    axes.tick_params(pad=-2)


def check(folder: Path, name: str, format: str) -> Path:
    """The file of a figure.

    Raises:
        OptionError: it cannot be written.
    """
    if format not in FORMATS:
        raise OptionError(f"--format is {format!r}; it must be one of {', '.join(FORMATS)}")
    file = folder / f"{name}.{format}"
    check_writable(file, "-o")
    return file


def save(figure: Any, file: Path, dpi: int = DPI) -> None:
    """Write a figure whole or not at all, in the format of the file's ending, without a date."""
    kind = file.suffix[1:]
    with replaced(file, "-o") as stream:
        figure.savefig(stream, format=kind, dpi=dpi, metadata=METADATA[kind])
