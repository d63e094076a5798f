"""Bags of ROS become scenes: walls, start, goal and obstacles are where the messages have them."""

import numpy as np
import pytest

pytest.importorskip("rosbags")

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sdf_samples import refused

from sim import cli
from sim.importing.ros_bag import read_bag
from sim.importing.scene_file import import_world
from sim.mjcf import load

pytestmark = pytest.mark.slow

FOREIGN = {
    "costmap_converter_msgs/msg/ObstacleMsg": "std_msgs/Header header\ngeometry_msgs/Polygon polygon\nfloat64 radius\n"
    "int64 id\ngeometry_msgs/Quaternion orientation\ngeometry_msgs/TwistWithCovariance velocities\n",
    "costmap_converter_msgs/msg/ObstacleArrayMsg": "std_msgs/Header header\n"
    "costmap_converter_msgs/ObstacleMsg[] obstacles\n",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nvision_msgs/BoundingBox3D bbox\nstring id\n",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}


class Bag:
    """Makes messages of ROS 1 or 2, with rosbags' own types, and writes them."""

    def __init__(self, store: Stores = Stores.ROS2_JAZZY) -> None:
        self.store = get_typestore(store)
        self.old = store is Stores.ROS1_NOETIC
        for name, text in FOREIGN.items():
            self.store.register(get_types_from_msg(text, name))
        self.sent = list[tuple[str, float, object]]()

    def made(self, name: str, **fields):
        """A message whose other fields are empty."""
        kind = self.store.types[name.replace("/", "/msg/", 1)]
        values = {}
        for key, (form, what) in self.store.fielddefs[kind.__msgtype__][1:][0]:
            if key in fields:
                values[key] = fields[key]
            elif form.name == "BASE":
                values[key] = {"string": "", "bool": False}.get(what[0], 0)
            elif form.name == "NAME":
                values[key] = self.made(what.replace("/msg/", "/"))
            elif form.name == "SEQUENCE":
                (inner, known), _ = what
                number = inner.name == "BASE" and known[0] != "string"
                values[key] = np.zeros(0, {"byte": "uint8"}.get(known[0], known[0])) if number else []
            else:
                values[key] = np.zeros(what[1], what[0][1][0])
        return kind(**values)

    def header(self, time: float, frame: str = "map"):
        kind = "builtin_interfaces/Time"
        stamp = self.made(kind, sec=int(time), nanosec=round(time % 1.0 * 1e9))
        return self.made("std_msgs/Header", stamp=stamp, frame_id=frame)

    def pose(self, x: float, y: float, yaw: float = 0.0, z: float = 0.0):
        turn = self.made("geometry_msgs/Quaternion", z=np.sin(yaw / 2), w=np.cos(yaw / 2))
        place = self.made("geometry_msgs/Point", x=x, y=y, z=z)
        return self.made("geometry_msgs/Pose", position=place, orientation=turn)

    def grid(self, cells, side: float = 0.1, x: float = 0.0, y: float = 0.0, topic: str = "/map", **size) -> None:
        cells = np.array(cells, np.int8)
        given = {"width": cells.shape[1], "height": cells.shape[0]} | size
        info = self.made("nav_msgs/MapMetaData", resolution=side, origin=self.pose(x, y), **given)
        message = self.made("nav_msgs/OccupancyGrid", header=self.header(1.0), info=info, data=cells.ravel())
        self.sent.append((topic, 1.0, message))

    def path(self, *poses, frame: str = "map", topic: str = "/plan") -> None:
        header = self.header(1.0, frame)
        stamped = [self.made("geometry_msgs/PoseStamped", header=header, pose=self.pose(*one)) for one in poses]
        self.sent.append((topic, 1.0, self.made("nav_msgs/Path", header=header, poses=stamped)))

    def markers(self, time: float, *shapes, frame: str = "map", topic: str = "/tracks") -> None:
        """Shapes are type, number, pose and scale."""
        found = []
        for kind, number, pose, scale in shapes:
            size = self.made("geometry_msgs/Vector3", **dict(zip("xyz", scale, strict=True)))
            known = {"ns": "people", "id": number, "type": kind, "pose": self.pose(*pose), "scale": size}
            found.append(self.made("visualization_msgs/Marker", header=self.header(time, frame), **known))
        self.sent.append((topic, time, self.made("visualization_msgs/MarkerArray", markers=found)))

    def written(self, path, storage: StoragePlugin = StoragePlugin.SQLITE3):
        opened = Writer1(path) if self.old else Writer(path, version=9, storage_plugin=storage)
        serialize = self.store.serialize_ros1 if self.old else self.store.serialize_cdr
        with opened as writer:
            connections = {}
            for topic, time, message in self.sent:
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=self.store)
                writer.write(connections[topic], round(1e9 * time), serialize(message, kind))
        return path


ROOM = np.zeros((60, 80), int)
ROOM[:, :2] = ROOM[:, -2:] = ROOM[:2] = ROOM[-2:] = 100
ROOM[20:30, 40:44] = 65
ROOM[40, 40] = 64


def room(bag: Bag) -> Bag:
    """A room with a path through it, a walker that moves from 2 s on, and a barrel."""
    bag.grid(ROOM)
    bag.path((1.0, 1.0, 0.5), (3.0, 4.0, 0.0), (7.0, 5.0, 0.0))
    for k in range(5):
        walker = (3, 7, (2.0 + k, 3.0, 0.0, 0.5), (0.6, 0.6, 1.0))
        barrel = (2, 8, (6.0, 1.5, 0.0, 0.3), (0.8, 0.8, 0.8))
        bag.markers(10.0 + k, *([walker] if k else []), barrel)
    return bag


@pytest.mark.parametrize("form", ["folder", "db3", "folder of mcap", "mcap", "bag"])
def test_a_bag_becomes_a_scene_with_everything_where_it_was(tmp_path, capsys, form):
    bag = room(Bag(Stores.ROS1_NOETIC if form == "bag" else Stores.ROS2_JAZZY))
    storage = StoragePlugin.MCAP if "mcap" in form else StoragePlugin.SQLITE3
    source = bag.written(tmp_path / ("a.bag" if form == "bag" else "a"), storage)
    source = next(source.glob(f"*.{form}")) if form in ("db3", "mcap") else source
    target = tmp_path / "room.xml"
    assert cli.main(["import", str(source), "-o", str(target)]) == 0
    said = capsys.readouterr()
    assert "and 1 moving obstacle" in said.out
    assert "gives --start 1 1 0.5 and --goal 7 5 0.25" in said.out + said.err
    scene = load(target).scene
    np.testing.assert_allclose(scene.start, [1.0, 1.0, 0.5], atol=1e-6)
    np.testing.assert_allclose([*scene.goal.center, scene.goal.radius], [7.0, 5.0, 0.25])
    np.testing.assert_allclose([*scene.lower, *scene.upper], [0, 0, 8, 6], atol=1e-6)
    boxes = [(one.position[:2], one.size[:2]) for one in scene.obstacles if one.kind.name == "BOX"]
    middle = [np.concatenate(box) for box in boxes if np.allclose(box[0], [4.2, 2.5], atol=1e-6)]
    np.testing.assert_allclose(middle, [[4.2, 2.5, 0.2, 0.5]], atol=1e-6)
    assert len(boxes) == 5  # what is below 65 per cent is free
    (barrel,) = [one for one in scene.obstacles if one.kind.name != "BOX"]
    np.testing.assert_allclose(barrel.position[:2], [6.0, 1.5])
    (walker,) = scene.movers
    times = np.array([0.0, 1.0, 2.5, 4.0, 9.0])
    np.testing.assert_allclose(walker.motion.pose(times)[:, :2], [[3, 3], [3, 3], [4.5, 3], [6, 3], [6, 3]], atol=0.02)


def test_without_a_map_the_workspace_is_what_was_seen_and_obstacles_may_come_from_elsewhere(tmp_path):
    bag = Bag()
    corners = [bag.made("geometry_msgs/Point32", x=x, y=y) for x, y in ((0.0, 2.0), (0.6, 2.8))]
    for k in range(3):
        polygon = bag.made("geometry_msgs/Polygon", points=corners if k == 0 else corners[:1])
        known = {"header": bag.header(5.0), "polygon": polygon, "radius": 0.1, "id": 3}
        one = bag.made("costmap_converter_msgs/ObstacleMsg", **known)
        message = bag.made("costmap_converter_msgs/ObstacleArrayMsg", header=bag.header(5.0), obstacles=[one])
        if k == 0:
            bag.sent.append(("/obstacles", 5.0, message))
    bag.path((-2.0, 0.0, 0.0), (4.0, 0.0, 0.0))
    import_world(bag.written(tmp_path / "a"), tmp_path / "a.xml")
    scene = load(tmp_path / "a.xml").scene
    np.testing.assert_allclose([*scene.lower, *scene.upper], [-3, -1, 5, 4])
    (disc,) = scene.obstacles
    np.testing.assert_allclose([*disc.position[:2], disc.size[0]], [0.3, 2.4, 0.6])
    detected = Bag()
    for time in (1.0, 3.0):
        size = detected.made("geometry_msgs/Vector3", x=0.4, y=0.8, z=1.5)
        box = detected.made("vision_msgs/BoundingBox3D", center=detected.pose(time, 2.0, 0.3 * time), size=size)
        one = detected.made("vision_msgs/Detection3D", header=detected.header(time), bbox=box, id="cart")
        header = detected.header(time)
        array = detected.made("vision_msgs/Detection3DArray", header=header, detections=[one])
        detected.sent.append(("/seen", time, array))
    source = detected.written(tmp_path / "b")
    import_world(source, tmp_path / "b.xml", start=[0, 0], goal=[4, 0, 0.3], workspace=[-1, 5, -1, 4])
    (cart,) = load(tmp_path / "b.xml").scene.movers
    np.testing.assert_allclose(cart.motion.pose(np.array([0.0, 1.0, 2.0]))[:, [0, 1, -1]],
                               [[1, 2, 0.3], [2, 2, 0.6], [3, 2, 0.9]], atol=1e-6)  # fmt: skip


def test_among_several_topics_one_is_chosen_and_other_frames_are_left_out(tmp_path):
    bag = Bag()
    bag.grid(ROOM)
    bag.path((1.0, 1.0), (7.0, 5.0))
    bag.path((1.0, 1.0), (5.0, 5.0), topic="/other")
    bag.markers(2.0, (1, 1, (6.0, 3.0), (0.3, 0.3, 0.3)))
    bag.markers(3.0, (1, 2, (6.0, 3.0), (0.3, 0.3, 0.3)), frame="base_link")
    source = bag.written(tmp_path / "a")
    refused(lambda: read_bag(source), "several topics have path: /other, /plan; choose one with --topic")
    refused(lambda: read_bag(source, ["/gone"]), "--topic /gone: it is not there; topics are /map, /other, /plan")
    world = read_bag(source, ["/other"])
    assert world.goal == (5.0, 5.0, 0.25)
    assert [one.name for one in world.solids if "people" in one.name] == ["people 1"]
    assert any("1 poses of obstacles are in the frame base_link, not in map" in note for note in world.notes)


def wrong(make) -> Bag:
    make(bag := Bag())
    return bag


CUBE = (1, 1, (6.0, 3.0), (0.3, 0.3, 0.3))
NAN = float("nan")
REFUSED = [
    (lambda b: b.grid([[0]], width=100_000, height=10_000), "100000 x 10000 cells; at most 25000000"),
    (lambda b: b.grid([[0, 0]], width=3), "it has 2 cells and says 3"),
    (lambda b: b.grid([[0]], side=NAN), "the side of a cell is nan"),
    (lambda b: b.grid([[0]], x=NAN), "the origin of the map on /map is nan"),
    (lambda b: b.path((0.0, 0.0), (NAN, 1.0)), "pose -1 of the path on /plan is nan"),
    (lambda b: b.markers(1.0, (*CUBE[:2], (NAN, 0.0), CUBE[3])), "the pose of marker people 1 is nan"),
    (lambda b: b.markers(1.0, (*CUBE[:3], (0.0, 1.0, 1.0))), "the scale of marker people 1 is [0.0"),
    (lambda b: b.markers(1.0), "neither a map nor a path nor an obstacle"),
    (lambda b: b.sent.append(("/x", 1.0, b.made("std_msgs/String", data="a"))), "no topic has one of the types"),
]


@pytest.mark.parametrize(("make", "words"), REFUSED)
def test_what_cannot_be_read_is_refused_by_topic(tmp_path, make, words):
    source = wrong(make).written(tmp_path / "a")
    target = tmp_path / "a.xml"
    refused(lambda: import_world(source, target, start=[1, 1], goal=[2, 2, 0.3]), str(source), words)
    assert not target.exists()


@pytest.mark.parametrize("name", ["a.mcap", "a.db3", "a.bag", "folder"])
def test_broken_files_cost_one_line(tmp_path, refused_line, name):
    bag = room(Bag(Stores.ROS1_NOETIC if name == "a.bag" else Stores.ROS2_JAZZY))
    storage = StoragePlugin.MCAP if name == "a.mcap" else StoragePlugin.SQLITE3
    source = bag.written(tmp_path / "whole.bag" if name == "a.bag" else tmp_path / "whole", storage)
    content = (source if name == "a.bag" else next(source.glob("*.mcap" if name == "a.mcap" else "*.db3"))).read_bytes()
    broken = tmp_path / name
    if name == "folder":
        broken.mkdir()
        refused_line(broken, "is a folder")
        (broken / "metadata.yaml").write_text("nothing")
        refused_line(broken, "no whole bag of ROS")
        return
    rng = np.random.default_rng(0)
    for k in range(6):
        damaged = bytearray(content[: int(len(content) * (0.2 + 0.15 * k))])
        for at in rng.integers(0, len(damaged), 40 * (k == 5)):
            damaged[at] ^= 0xFF
        broken.write_bytes(damaged)
        refused_line(broken, str(broken))
    refused_line(tmp_path / "gone.mcap", "does not exist")


@pytest.fixture
def refused_line(tmp_path, capsys):
    def check(source, words: str) -> None:
        status = cli.main(["import", str(source), "-o", str(tmp_path / "out.xml")])
        said = capsys.readouterr().err
        if status == 0:  # what was damaged did not matter
            return
        assert status == 2
        assert said.count("\n") == 1
        assert words in said

    return check
