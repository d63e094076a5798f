"""Sizes of what maps show."""

from typing import NamedTuple


class PlottingTuning(NamedTuple):
    """Widths, opacities and spacings of lines on maps."""

    corners: int = 64  # of what is round, seen from above
    moments: tuple[float, ...] = (0.5, 1.0, 1.5, 2.0, 2.5)  # after which predicted moving obstacles are outlined [s]
    bundle: float = 5.0  # widths of strokes that many coinciding ones share
    smooth: int = 9  # points over which shifts of strokes change
    line: float = 2.0  # width of the path of a class [points]
    arrow: float = 0.5  # time that the arrow of a control spans [s], ...
    arrow_steps: int = 10  # ... and steps of the motion that it shows
    outlines: int = 7  # of a robot with corners along each reference
    faint: float = 0.08  # opacity of a sample of the least weight, ...
    strong: float = 0.6  # ... and of the greatest
    spacing: float = 0.15  # of points on edges that turn [m]


TUNING = PlottingTuning()
