"""Bags of ROS 1 and 2, and files of MCAP, as scenes: an occupancy grid, a path, and obstacles that were tracked.

The last grid of its topic is the map, with walls from 65 per cent on. The first path gives start and goal. Markers
(cubes, spheres, cylinders), obstacles of costmap_converter and detections of vision_msgs are tracked by name: one that
has moved becomes a moving obstacle, an upright column that waits where it was first seen and stays where it was last
seen. Any other stays as it is. What is in another frame than the map is left out.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from sim import extras
from sim.files import why_unreadable
from sim.importing import ros_map
from sim.importing.dynabarn import HALF_HEIGHT, thinned
from sim.importing.solids import LOWEST, Solid, World, distinct, text, transform
from sim.mjcf.library import FARTHEST, FINEST, MOST_PIXELS, listed, prefixed, refused
from sim.states.planar_joints import heading_of

SUFFIXES = extras.BAGS
INSIDE = "metadata.yaml"  # of a folder that is a bag
RADIUS = 0.25  # of a goal at the end of a path [m]
MOVED, TURNED = 0.05, 0.1  # from which on an obstacle has moved [m], [rad]
DEVIATION = 0.01  # of straight lines between rows from a track, at most [m]
UNIT = 0.1  # by which the norm of a rotation may be off
AROUND = 1.0  # of what is known, where there is no map [m]
OURS = ("/pirrht/scene",)  # of several topics, in files of `pirrht export`
NONE = -1, 0  # ids of obstacles that are not tracked
SHAPES = {1: "box", 2: "sphere", 3: "cylinder"}  # of types of markers


@dataclass(slots=True, eq=False)
class Track:
    """An obstacle over time."""

    shape: str
    size: Array  # along its axes (3,) [m]
    poses: dict[float, Array] = field(default_factory=dict)  # place and quaternion (7,) by time [s]


Seen = tuple[str, str, str, Array, Array]  # name, frame, shape, size (3,) [m] and pose (7,) of an obstacle


def read_bag(path: Path, topics: Sequence[str] = (), unknown: str = "occupied") -> World:
    """Read a bag; `topics` choose among several of a kind."""
    ros_map.check_unknown(unknown)
    extras.require(f"the bag {path}", "ros")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    why = why_unreadable(path)
    if why is not None and not path.is_dir():
        raise SceneError(f"{path}: cannot be read (it {why}); give a bag of ROS")
    older = Stores.ROS1_NOETIC if path.suffix.lower() == ".bag" else Stores.ROS2_JAZZY
    with ExitStack() as stack:
        with _broken(path):
            reader = stack.enter_context(AnyReader([path], default_typestore=get_typestore(older)))
        chosen = _chosen(path, reader.connections, topics)
        read = {what: _messages(path, reader, chosen[what]) for what in KINDS}
        bag = _Bag(path, unknown)
        with prefixed(f"{path}: "):
            bag.read_map(read["map"])
            bag.read_path(read["path"])
            bag.read_tracks(read["obstacles"])
            return bag.world()


def _broken(path: Path) -> AbstractContextManager[None]:
    """Refuse what rosbags, or what it uses, stumbles over."""
    return refused(f"{path}: this is no whole bag of ROS (", "); give a folder of rosbag2, .mcap, .db3 or .bag",
                   Exception, most=150)  # fmt: skip


def _chosen(path: Path, connections: Sequence[Any], topics: Sequence[str]) -> dict[str, list[Any]]:
    """Return the connections of the topic of each kind."""
    held = sorted({one.topic for one in connections})
    for strange in set(topics) - set(held):
        raise OptionError(f"{path}: --topic {strange}: it is not there; topics are {listed(held, 20)}")
    chosen = dict[str, list[Any]]()
    for what, types in KINDS.items():
        mine = [one for one in connections if one.msgtype in types]
        names = sorted({one.topic for one in mine})
        if len(names) > 1:
            names = [name for name in names if name in (topics or OURS)] or names
        if len(names) > 1:
            raise OptionError(f"{path}: several topics have {what}: {listed(names, 20)}; choose one with --topic")
        chosen[what] = [one for one in mine if one.topic in names]
    if not any(chosen.values()):
        wanted = ", ".join(one for several in KINDS.values() for one in several)
        raise SceneError(f"{path}: no topic has one of the types {wanted}; its topics are {listed(held, 20) or 'none'}")
    return chosen


def _messages(path: Path, reader: Any, connections: Sequence[Any]) -> Iterator[tuple[float, str, str, Any]]:
    """Yield time [s], topic, type and content of messages, in order."""
    with _broken(path):
        for one, time, data in reader.messages(connections) if connections else ():
            yield 1e-9 * time, one.topic, one.msgtype, reader.deserialize(data, one.msgtype)


class _Bag:
    """What has been read of a bag."""

    def __init__(self, path: Path, unknown: str) -> None:
        self._path, self._unknown = path, unknown
        self._frame = ""  # of all that is read
        self._notes = list[str]()
        self._walls: tuple[Solid, ...] = ()
        self._ground: Array | None = None
        self._mapped = False
        self._ends: tuple[tuple[float, ...], tuple[float, ...]] | None = None
        self._points = list[Array]()  # (2,) [m] of what is known
        self._tracks = dict[str, Track]()
        self._first = np.inf  # time [s]

    def read_map(self, messages: Iterable[tuple[float, str, str, Any]]) -> None:
        """Take over the last map."""
        last = None
        for _, topic, _, message in messages:
            last = topic, message
        if last is None:
            return
        topic, message = last
        info = message.info
        count = info.width * info.height
        side = float(info.resolution)
        for wrong, why in (
            (count > MOST_PIXELS, f"it has {info.width} x {info.height} cells; at most {MOST_PIXELS} are taken"),
            (count < 1 or count != len(message.data), f"it has {len(message.data)} cells and says {count}"),
            (not ros_map.FINEST <= side <= ros_map.COARSEST, f"the side of a cell is {side:g} m"),
        ):
            if wrong:
                raise SceneError(f"the map on {topic} is refused: {why}")
        pose = self._pose(info.origin, f"the origin of the map on {topic}")
        chance = np.asarray(message.data, np.int8).reshape(info.height, info.width)
        blocked = (chance >= ros_map.OCCUPIED) | ((chance < 0) & (self._unknown == "occupied"))
        origin = np.array([*pose[:2], _heading(pose)])
        self._walls, self._ground = ros_map.walls_of(blocked, side, origin)
        self._mapped = True
        self._frame = _frame(message)

    def read_path(self, messages: Iterable[tuple[float, str, str, Any]]) -> None:
        """Take over start and goal of the first path that leads somewhere."""
        for _, topic, _, message in messages:
            if len(message.poses) < 2 or not self._fits(_frame(message), f"the path on {topic}"):
                continue
            first, last = (self._pose(message.poses[k].pose, f"pose {k} of the path on {topic}") for k in (0, -1))
            heading = _heading(first)
            self._ends = (*first[:2].tolist(), heading), (*last[:2].tolist(), RADIUS)
            self._points += [first[:2], last[:2]]
            begin, end = (text(*(round(number, 3) for number in one)) for one in self._ends)
            self._notes.append(f"the path on {topic} gives --start {begin} and --goal {end}, where they are not given")
            return

    def read_tracks(self, messages: Iterable[tuple[float, str, str, Any]]) -> None:
        """Take over obstacles by name; of messages whose obstacles have none only the last."""
        nameless = dict[str, Track]()
        others = Counter[str]()
        for received, _, kind, message in messages:
            seen = list(READERS[kind](message, self._pose))
            often = Counter(name for name, *_ in seen)
            stamp = getattr(message, "header", None)
            time = received if stamp is None else stamp.stamp.sec + 1e-9 * stamp.stamp.nanosec or received
            self._first = min(self._first, time)
            nameless = {}
            for k, (name, frame, shape, size, pose) in enumerate(seen):
                self._frame = self._frame or frame
                if frame != self._frame:
                    others[frame] += 1
                elif not name or often[name] > 1:
                    nameless[f"obstacle {k + 1}"] = Track(shape, size, {time: pose})
                else:
                    track = self._tracks.setdefault(name, Track(shape, size))
                    track.shape, track.size = shape, np.maximum(track.size, size)
                    track.poses[time] = pose
        self._tracks |= nameless
        for frame, count in others.items():
            self._notes.append(f"{count} poses of obstacles are in the frame {frame or 'of no name'}, not in "
                               f"{self._frame}, and are left out")  # fmt: skip

    def world(self) -> World:
        """Return all as a world."""
        solids, custom, bodies = [*self._walls], [], []
        labels = distinct((" ".join(name.split()) for name in self._tracks), {"floor", "world"})
        for label, track in zip(labels, self._tracks.values(), strict=True):
            rows = np.array([[time - self._first, *pose[:2], _heading(pose)] for time, pose in track.poses.items()])
            rows = rows[np.argsort(rows[:, 0])]
            rows[:, 3] = np.unwrap(rows[:, 3])
            self._points += [*rows[:, 1:3]]
            far = np.abs(np.ptp(rows[:, 1:], axis=0))
            half = 0.5 * track.size
            if max(far[:2]) > MOVED or (far[2] > TURNED and track.shape == "box"):
                motion, body = _moving(label, track.shape, half, rows)
                custom.append(motion)
                bodies.append(body)
                continue
            pose = transform(list(track.poses.values())[-1])
            if pose[2, 3] + half[2] <= LOWEST:
                self._notes.append(f"{label} is no higher than {LOWEST:g} m, so driven over and left out")
                continue
            size = {"box": half, "sphere": half[:1], "cylinder": half[[0, 2]]}[track.shape]
            solids.append(Solid(label, track.shape, size, pose))
        if not solids and not bodies and not self._mapped and self._ends is None:
            raise SceneError("it has neither a map nor a path nor an obstacle that can be read")
        if self._ground is None and not self._mapped:
            low = np.floor(np.min(self._points, axis=0) - AROUND)
            high = np.ceil(np.max(self._points, axis=0) + AROUND)
            self._ground = np.column_stack([low, high]).ravel()
        start, goal = self._ends or (None, None)
        notes = tuple(f"{self._path}: {note}" for note in self._notes)
        return World(
            kind="map" if self._mapped else "bag", solids=tuple(solids), ground=self._ground, notes=notes,
            custom=tuple(custom), bodies=tuple(bodies), start=start, goal=goal,
        )  # fmt: skip

    def _fits(self, frame: str, what: str) -> bool:
        """Return whether something is in the frame of the rest; a note reports it if not."""
        self._frame = self._frame or frame
        note = f"{what} is in the frame {frame}, not in {self._frame}, and is left out"
        if frame != self._frame and note not in self._notes:
            self._notes.append(note)
        return frame == self._frame

    def _pose(self, pose: Any, what: str) -> Array:
        """Read place and rotation (7,), w last; a rotation of zeros is none."""
        place, turn = pose.position, pose.orientation
        found = np.array([place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w], dtype=float)
        if not found[3:].any():
            found[6] = 1.0
        norm = np.linalg.norm(found[3:])
        if not np.all(np.abs(found[:3]) <= FARTHEST) or not abs(norm - 1.0) < UNIT:
            shown = ", ".join(f"{number:g}" for number in found)
            raise SceneError(f"{what} is {shown}, which is no pose: it must be finite, with a rotation")
        found[3:] /= norm
        return found


def _moving(name: str, shape: str, half: Array, rows: Array) -> tuple[str, str]:
    """Write motion and body of a column of half sizes (3,) [m] by rows (k, 4) t [s], x, y [m], yaw [rad]."""
    if shape != "box":
        rows[:, 3] = 0.0
    if rows[0, 0] > 0.0:
        rows = np.vstack([[0.0, *rows[0, 1:]], rows])
    rows = thinned(rows, DEVIATION)
    label = quoteattr(name)
    motion = f'<numeric name={quoteattr(f"pirrht_motion_{name}")} data="{"  ".join(text(*row) for row in rows)}"/>'
    size = text(*half[:2], HALF_HEIGHT) if shape == "box" else text(max(half[:2]), HALF_HEIGHT)
    kind = "box" if shape == "box" else "cylinder"
    turn = f' euler="0 0 {text(rows[0, 3])}"'
    return motion, (
        f'<body name={label} mocap="true" pos="{text(*rows[0, 1:3], HALF_HEIGHT)}"{turn}>\n      <geom name={label} '
        f'type="{kind}" size="{size}" material="drum"/>\n    </body>'
    )


Pose = Callable[[Any, str], Array]


def _markers(message: Any, pose: Pose) -> Iterator[Seen]:
    """Yield the solid shapes of an array of markers."""
    for one in message.markers:
        if one.action == 0 and one.type in SHAPES:
            name = f"{one.ns} {one.id}".strip()
            size = _size(one.scale, f"the scale of marker {name}")
            wide = size if one.type == 1 else np.array([max(size[:2]), max(size[:2]), size[2]])
            yield name, _frame(one), SHAPES[one.type], wide, pose(one.pose, f"the pose of marker {name}")


def _obstacles(message: Any, pose: Pose) -> Iterator[Seen]:
    """Yield the obstacles of costmap_converter, each as the disc around its polygon."""
    for k, one in enumerate(message.obstacles):
        corners = np.array([[corner.x, corner.y] for corner in one.polygon.points], dtype=float).reshape(-1, 2)
        radius = float(one.radius)
        if not len(corners) or not np.all(np.abs(corners) <= FARTHEST) or not 0.0 <= radius <= FARTHEST:
            raise SceneError(f"obstacle {k + 1} of an ObstacleArrayMsg has no finite polygon and radius")
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        radius += float(np.hypot(*(corners - middle).T).max())
        size = np.array([2.0 * max(radius, FINEST), 2.0 * max(radius, FINEST), 2.0 * HALF_HEIGHT])
        name = "" if one.id in NONE else f"obstacle {one.id}"
        at = np.array([*middle, HALF_HEIGHT, 0.0, 0.0, 0.0, 1.0])
        yield name, _frame(message), "cylinder", size, at


def _detections(message: Any, pose: Pose) -> Iterator[Seen]:
    """Yield the boxes of detections."""
    for k, one in enumerate(message.detections):
        what = f"detection {k + 1}"
        name = str(getattr(one, "id", ""))
        at = pose(one.bbox.center, f"the centre of {what}")
        yield name and f"detection {name}", _frame(message), "box", _size(one.bbox.size, f"the size of {what}"), at


def _size(size: Any, what: str) -> Array:
    """Read sizes (3,) [m]."""
    found = np.array([size.x, size.y, size.z], dtype=float)
    if not np.all((found > 0.0) & (found <= FARTHEST)):
        raise SceneError(f"{what} is {found.tolist()}; it must be positive and finite")
    return np.asarray(np.maximum(found, 2.0 * FINEST))


def _frame(message: Any) -> str:
    return str(message.header.frame_id).lstrip("/")


def _heading(pose: Array) -> float:
    """Return the turn of a pose (7,), w last, about the vertical [rad]."""
    return heading_of(np.roll(pose[3:], 1))


READERS: dict[str, Callable[[Any, Pose], Iterator[Seen]]] = {
    "visualization_msgs/msg/MarkerArray": _markers,
    "costmap_converter_msgs/msg/ObstacleArrayMsg": _obstacles,
    "vision_msgs/msg/Detection3DArray": _detections,
}
KINDS = {"map": ("nav_msgs/msg/OccupancyGrid",), "path": ("nav_msgs/msg/Path",), "obstacles": tuple(READERS)}
