"""Plans as messages that RViz and Foxglove draw."""

from collections.abc import Iterable

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.plotting.colors import OTHER_COLOR, ClassColors, Color
from sim.ros.frames import quaternion_of
from sim.ros.messages import (
    DELETE_ALL,
    LINE_LIST,
    LINE_STRIP,
    TEXT,
    ColorRGBA,
    Header,
    Marker,
    MarkerArray,
    Path,
    Point,
    Pose,
    PoseStamped,
    Vector3,
)  # fmt: skip

THICK, THIN = 0.04, 0.01  # lines of classes and samples [m]
LETTERS = 0.25  # height of words [m]
FAINT = 0.25  # opacity of a sample, and of a class without weight


def path_of(points: Array, header: Header) -> Path:
    """Return a polyline (k, 2) or in space (k, 3) [m] as a path; each pose looks along it."""
    spans = np.diff(points[:, :2], axis=0, append=points[-1:, :2])
    yaws = np.arctan2(spans[:, 1], spans[:, 0])
    yaws[-1:] = yaws[-2:-1] if len(yaws) > 1 else 0.0
    return Path(header, [
        PoseStamped(header, Pose(Point(*point.tolist()), quaternion_of(yaw)))
        for point, yaw in zip(points, yaws.tolist(), strict=True)
    ])  # fmt: skip


def classes_of(plan: Plan, colors: ClassColors, header: Header) -> MarkerArray:
    """Return the best path of every class of a plan, in its colour, with its share at the robot."""
    weights = plan.weights()
    markers = [Marker(header, action=DELETE_ALL)]
    for number, (name, reference) in enumerate(zip(plan.ids, plan.references, strict=True)):
        share = weights.get(name, 0.0)
        color = tinted(colors[name], FAINT + (1.0 - FAINT) * share)
        points = reference.trajectory.points
        markers.append(_line("classes", number, LINE_STRIP, points, THICK, color, header))
        place = points[int(len(points) * (0.5 + 0.4 * number / len(plan.ids)))]  # classes share much of their paths
        markers.append(Marker(
            header, "names", number, TEXT, pose=Pose(Point(float(place[0]), float(place[1]), LETTERS)),
            scale=Vector3(z=LETTERS), color=tinted(colors[name], 1.0),
            text=f"{formatting.turns(name)}: {formatting.share(share)}",
        ))  # fmt: skip
    return MarkerArray(markers)


def samples_of(plan: Plan, count: int, header: Header) -> MarkerArray:
    """Return the heaviest samples of a plan, and as many that died, each as segments."""
    markers = [Marker(header, action=DELETE_ALL)]
    for paths, strength in plan.heaviest(count):
        number = int(strength.any())  # 0 of those that died
        segments = [np.repeat(path[:, :2], 2, axis=0)[1:-1] for path in paths if len(path) > 1]
        if segments:
            color = tinted(OTHER_COLOR, FAINT * (1 + 2 * number))
            markers.append(_line("samples", number, LINE_LIST, np.vstack(segments), THIN, color, header))
    return MarkerArray(markers)


def tinted(color: Color, opacity: float) -> ColorRGBA:
    """Return a colour with an opacity as a message."""
    return ColorRGBA(*(one / 255.0 for one in color), opacity)


def _line(
    group: str, number: int, kind: int, points: Iterable[Array], width: float, color: ColorRGBA, header: Header
) -> Marker:  # fmt: skip
    places = [Point(float(x), float(y), width) for x, y, *_ in points]  # above the map
    return Marker(header, group, number, kind, scale=Vector3(x=width), color=color, points=places)
