"""Recordings as files of MCAP with messages of ROS 2, which Foxglove and RViz open.

Frames are map, odom, which equals it, base_link and moving/NAME; times are simulated.

/tf, /tf_static  poses of the robot and of moving obstacles at every control step
/odom            pose at a step, and mean velocities until the next one, noise included
/cmd_vel         the control, of robots whose control is their velocity
/plan            path of the class of most weight, wherever plans are drawn
/pirrht/classes, /pirrht/samples   best path of each class; sampled paths
/pirrht/scene    solids of the scene and of the robot
/map             what a robot with a lidar has seen, where it has changed
/diagnostics     numbers of every step
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from sim.drawing import known
from sim.files import replaced
from sim.recording.export import Recording, Row, Shown
from sim.recording.writer import AHEAD, PIECES
from sim.ros import messages as ros
from sim.ros.drawn import path_of
from sim.ros.messages import ColorRGBA, Header, Marker, MarkerArray, Point, Pose, Quaternion, Time, Twist, Vector3

MAP, ODOM, BASE = "map", "odom", "base_link"
LATCHED = ("/tf_static", "/map", "/pirrht/scene")
SAMPLES, MOVERS, ROBOT = "/world/samples/", "/world/scene/movers/", "/world/robot/body/"
SOLIDS = ("/world/scene/obstacles/", "/world/scene/others/", "/world/scene/goal", MOVERS, ROBOT)
THIN, LETTERS = 0.012, 0.2  # of a sampled path, and of a name [m]
NUMBERS = ("cost", "length", "clearance", "value", "value_error", "collision", "vertices", "outcome")
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
POSE, SPACE = ("x", "y", "heading"), ("x", "y", "z")
COMMANDED: Mapping[tuple[str, ...], Callable[..., Twist]] = {  # of robots by their states, which are no velocities
    ("x", "y"): lambda x, y: Twist(linear=Vector3(x, y)),
    SPACE: lambda x, y, z: Twist(linear=Vector3(x, y, z)),
    POSE: lambda ahead, turn: Twist(linear=Vector3(ahead), angular=Vector3(z=turn)),
}

Sent = tuple[float, str, Any]  # time [s], topic, message


def write(file: Path, recording: Recording, shown: Shown) -> dict[str, int]:
    """Write a recording, and return the number of messages of each topic; an OptionError if the file cannot be."""
    from mcap.writer import Writer

    found = sorted(sent(recording, shown), key=lambda one: one[0])
    counts = dict[str, int]()
    channels = dict[str, int]()
    with replaced(file, "--output") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="pirrht")
        for time, topic, message in found:
            if topic not in channels:
                channels[topic] = _channel(writer, topic, type(message))
            counts[topic] = counts.get(topic, 0) + 1
            moment = round(1e9 * time)
            writer.add_message(channels[topic], moment, message.serialize(), moment, counts[topic])
        writer.finish()
    return counts


def _channel(writer: Any, topic: str, kind: type[Any]) -> int:
    """Register a topic with ROS's own definition of its type, and how players shall offer it."""
    from rosbags.typesys import Stores, get_typestore

    name = ros.ros_name(kind)
    definition, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(name, ros_version=2)
    schema = writer.register_schema(name, "ros2msg", definition.encode())
    durability = "transient_local" if topic in LATCHED else "volatile"
    never = "{sec: 9223372036, nsec: 854775807}"
    quality = (
        f"- {{history: keep_last, depth: 10, reliability: reliable, durability: {durability}, deadline: {never}, "
        f"lifespan: {never}, liveliness: automatic, liveliness_lease_duration: {never}, "
        "avoid_ros_namespace_conventions: false}"
    )
    return int(writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": quality}))


def sent(recording: Recording, shown: Shown) -> Iterator[Sent]:
    """Yield all messages of a recording, topic by topic."""
    yield from _poses(shown)
    yield from _commands(recording, shown)
    yield from _numbers(recording)
    yield from _plans(recording, shown)
    yield from _samples(shown)
    yield 0.0, "/pirrht/scene", MarkerArray(_solids(shown))
    yield from _maps(shown)


def _poses(shown: Shown) -> Iterator[Sent]:
    """Yield poses of the robot and of moving obstacles, and the robot's velocities."""
    robot = _track(shown["/world/robot"])
    moving = {path: _track(rows) for path, rows in shown.items() if path.startswith(MOVERS)}
    moving = {path: track for path, track in moving.items() if track}
    yield 0.0, "/tf_static", ros.TFMessage([_transform(0.0, MAP, ODOM, np.append(np.zeros(3), UPRIGHT))])
    times = sorted(robot)
    twists = [_between(robot[one], robot[two], two - one) for one, two in pairwise(times)]
    latest = {path: track[min(track)] for path, track in moving.items()}
    for time, twist in zip(times, [*twists, *(twists[-1:] or [Twist()])], strict=True):
        latest = {path: moving[path].get(time, pose) for path, pose in latest.items()}
        parts = [_transform(time, MAP, _frame(path), pose) for path, pose in latest.items()]
        yield time, "/tf", ros.TFMessage([_transform(time, ODOM, BASE, robot[time]), *parts])
        odometry = ros.Odometry(_header(time, ODOM), BASE)
        odometry.pose.pose = _pose(robot[time])
        odometry.twist.twist = twist
        yield time, "/odom", odometry


def _track(rows: Sequence[Row]) -> dict[float, Array]:
    """Return poses (7,), place [m] and quaternion, w last, by time [s]."""
    return {
        row.time: np.append(row.cells["Transform3D:translation"][0], row.cells["Transform3D:quaternion"][0])
        for row in rows
        if "Transform3D:translation" in row.cells
    }


def _between(one: Array, two: Array, duration: float) -> Twist:
    """Return the mean velocities of a body from one pose (7,) to another, along and about its axes at the first."""
    turn = Rotation.from_quat(one[3:]).inv()
    linear = turn.apply(two[:3] - one[:3]) / duration
    angular = (turn * Rotation.from_quat(two[3:])).as_rotvec() / duration
    return Twist(Vector3(*linear.tolist()), Vector3(*angular.tolist()))


def _commands(recording: Recording, shown: Shown) -> Iterator[Sent]:
    """Yield the control of each step, where it is a velocity."""
    arrows = {row.time: row.cells.get("Arrows3D:vectors", ()) for row in shown["/world/robot"]}
    states = tuple(recording.settings.get("states", "").split())
    for _, time, cells in recording.steps:
        control = cells.get("control") or []
        names = states or POSE[: len(cells["state"])]
        if names == POSE and len(control) == 1 and len(arrows.get(time, ())):  # its speed is given
            way = np.exp(1j * control[0] * AHEAD / PIECES * np.arange(PIECES)).mean() * AHEAD  # at unit speed
            control = [float(np.linalg.norm(arrows[time][0])) / abs(way), *control]
        if names in COMMANDED and len(control) == (3 if names == SPACE else 2):
            yield time, "/cmd_vel", COMMANDED[names](*control)


def _numbers(recording: Recording) -> Iterator[Sent]:
    """Yield the numbers of each step."""
    for step, time, cells in recording.steps:
        values = {name: cells[name][0] for name in NUMBERS if cells.get(name)}
        values["effective samples"] = sum(cells.get("ess") or [])
        values["plan_ms"] = recording.plan_ms.get(step, float("nan"))
        weights = zip(cells.get("classes") or [], cells.get("weights") or [], strict=False)
        values |= {f"weight {name}": weight for name, weight in weights}
        doubtful = bool((cells.get("doubtful") or [0.0])[0])
        message = ros.DOUBTFUL if doubtful else ""
        texts = [ros.KeyValue(name, v if isinstance(v, str) else f"{v:.10g}") for name, v in values.items()]
        status = ros.DiagnosticStatus(int(doubtful), "pirrht", message, "", texts)
        yield time, "/diagnostics", ros.DiagnosticArray(_header(time, ""), [status])


def _plans(recording: Recording, shown: Shown) -> Iterator[Sent]:
    """Yield the best path of each class with names of the classes, and that of most weight."""
    level = "z" not in recording.settings.get("states", "").split()
    names = {row.time: row.cells for row in shown.get("/world/names", ())}
    for row in shown.get("/world/references", ()):
        strips = row.cells.get("LineStrips3D:strips", [])
        radii = _each(row.cells.get("LineStrips3D:radii", [THIN]), len(strips))
        colors = _each(row.cells.get("LineStrips3D:colors", [0xFFFFFFFF]), len(strips))
        markers = []
        for k, (strip, radius, color) in enumerate(zip(strips, radii, colors, strict=True)):
            line = _marker(row.time, MAP, "classes", k, ros.LINE_STRIP, color, (2.0 * float(radius), 0.0, 0.0))
            line.points = _points(strip)
            markers.append(line)
        said = names.get(row.time, {})
        texts = said.get("Points3D:labels", [])
        places = said.get("Points3D:positions", [])
        for k, (text, place) in enumerate(zip(texts, places, strict=True)):
            color = _each(said["Points3D:colors"], len(texts))[k]
            name = _marker(row.time, MAP, "names", k, ros.TEXT, color, (0.0, 0.0, LETTERS))
            name.text = text
            name.pose = _pose(np.append(place, UPRIGHT))
            markers.append(name)
        yield row.time, "/pirrht/classes", _array(row.time, markers)
        if strips:
            best = np.array(strips[int(np.argmax(radii))], dtype=float)
            yield row.time, "/plan", path_of(best[:, :2] if level else best, _header(row.time, MAP))


def _samples(shown: Shown) -> Iterator[Sent]:
    """Yield sampled paths, a list of lines for each class."""
    drawn = dict[float, list[Marker]]()
    for path, rows in shown.items():
        for row in rows if path.startswith(SAMPLES) else ():
            markers = drawn.setdefault(row.time, [])
            if strips := row.cells.get("LineStrips3D:strips"):
                name = _plain(path.removeprefix(SAMPLES))
                marker = _marker(row.time, MAP, name, 0, ros.LINE_LIST, 0xFFFFFFFF, (THIN, 0.0, 0.0))
                marker.points = [one for s in strips for pair in pairwise(_points(s)) for one in pair]
                colors = map(_color, _each(row.cells["LineStrips3D:colors"], len(strips)))
                marker.colors = [c for c, s in zip(colors, strips, strict=True) for _ in range(2 * len(s) - 2)]
                markers.append(marker)
    yield from ((time, "/pirrht/samples", _array(time, markers)) for time, markers in drawn.items())


def _solids(shown: Shown) -> list[Marker]:
    """Return the shapes of everything that stands in the scene or moves with a frame."""
    markers = list[Marker]()
    for path, rows in shown.items():
        if path.startswith(SOLIDS):
            for row in rows:
                frame = BASE if path.startswith(ROBOT) else _frame(path) if path.startswith(MOVERS) else MAP
                shapes = list(_shapes(row.cells, row.time, frame, _plain(path.removeprefix("/world/"))))
                for shape in shapes:
                    shape.id = len(markers)
                    shape.frame_locked = frame != MAP
                    markers.append(shape)
    return markers


def _shapes(cells: Mapping[str, Any], time: float, frame: str, name: str) -> Iterator[Marker]:
    """Yield what the components of an entity look like."""
    archetype = next((name for name in cells if name.startswith(("Boxes", "Ellip", "Cylin", "Caps", "Mesh"))), "")
    archetype = archetype.partition(":")[0]
    given = {name.partition(":")[2]: values for name, values in cells.items()}
    if archetype == "Mesh3D" and "triangle_indices" in given:
        color = given.get("albedo_factor", [0xB0B0B0FF])[0]
        mesh = _marker(time, frame, name, 0, ros.TRIANGLE_LIST, color, (1.0, 1.0, 1.0))
        mesh.points = _points(given["vertex_positions"][given["triangle_indices"].ravel()])
        yield mesh
        return
    sizes = given.get("half_sizes", given.get("lengths", ()))
    count = len(sizes)
    places = given.get("centers", given.get("translations", np.zeros((count, 3))))
    turns = _each(given.get("quaternions", [UPRIGHT]), count)
    colors = _each(given.get("colors", [0xB0B0B0FF]), count)
    radii = _each(given.get("radii", [0.0]), count)
    box = ros.CUBE if archetype == "Boxes3D" else ros.SPHERE
    for size, place, turn, color, radius in zip(sizes, places, turns, colors, radii, strict=True):
        if "half_sizes" in given:
            parts = [(box, place, 2.0 * size)]
        else:
            along = Rotation.from_quat(turn).apply((0.0, 0.0, float(size)))
            wide = 2.0 * float(radius)
            parts = [(ros.CYLINDER, place, (wide, wide, size))]
            if archetype == "Capsules3D":  # these begin at their lower end
                parts = [(ros.CYLINDER, place + 0.5 * along, (wide, wide, size))]
                parts += [(ros.SPHERE, end, (wide, wide, wide)) for end in (place, place + along)]
        for kind, at, scale in parts:
            marker = _marker(time, frame, name, 0, kind, color, scale)
            marker.pose = _pose(np.append(at, turn))
            yield marker


def _maps(shown: Shown) -> Iterator[Sent]:
    """Yield the map of a robot with a lidar, wherever that has changed."""
    floors = [row.cells for row in shown.get("/world/map/cells", ())]
    corners = [cells["Mesh3D:vertex_positions"] for cells in floors if "Mesh3D:vertex_positions" in cells]
    for row in shown.get("/map/cells", ()):
        form = row.cells["Image:format"][0]
        picture = np.asarray(row.cells["Image:buffer"][0]).reshape(form["height"], form["width"], 3)[::-1]
        chance = np.zeros(picture.shape[:2], np.int8)
        chance[(picture == known.OCCUPIED).all(axis=2)] = 100
        chance[(picture == known.UNKNOWN).all(axis=2)] = -1
        low, high = corners[0][:, :2].min(axis=0), corners[0][:, :2].max(axis=0)
        cell = float(high[0] - low[0]) / form["width"]
        origin = _pose(np.array([*low, 0.0, *UPRIGHT]))
        about = ros.MapMetaData(Time.of(row.time), cell, form["width"], form["height"], origin)
        yield row.time, "/map", ros.OccupancyGrid(_header(row.time, MAP), about, chance.ravel().tolist())


def _array(time: float, markers: Sequence[Marker]) -> MarkerArray:
    """Return markers that take the place of all before."""
    return MarkerArray([Marker(_header(time, MAP), action=ros.DELETE_ALL), *markers])


def _marker(
    time: float, frame: str, group: str, number: int, kind: int, color: int, scale: Sequence[float] | Array
) -> Marker:
    size = Vector3(*(float(one) for one in scale))
    return Marker(_header(time, frame), group, number, kind, scale=size, color=_color(color))


def _header(time: float, frame: str) -> Header:
    return Header(Time.of(time), frame)


def _transform(time: float, parent: str, frame: str, pose: Array) -> ros.TransformStamped:
    place, turn = pose[:3].tolist(), pose[3:].tolist()
    return ros.TransformStamped(_header(time, parent), frame, ros.Transform(Vector3(*place), Quaternion(*turn)))


def _pose(pose: Array) -> Pose:
    """Return a place [m] and a quaternion, w last, (7,), as a message."""
    return Pose(Point(*pose[:3].tolist()), Quaternion(*pose[3:].tolist()))


def _points(points: Array) -> list[Point]:
    return [Point(*point) for point in points.tolist()]


def _color(packed: int) -> ColorRGBA:
    """Return a colour 0xRRGGBBAA as a message."""
    return ColorRGBA(*(byte / 255.0 for byte in int(packed).to_bytes(4, "big")))


def _each(values: Any, count: int) -> Any:
    """Return so many values, of which one may stand for all."""
    return values if len(values) == count else [values[0]] * count


def _frame(path: str) -> str:
    """Return the frame of the moving obstacle that an entity is part of."""
    name = re.split(r"(?<!\\)/", path.removeprefix(MOVERS))[0]
    return f"moving/{_plain(name)}"


def _plain(path: str) -> str:
    """Return a part of the path of an entity as it was before it was escaped."""
    return re.sub(r"\\(.)", r"\1", path)
