"""Messages of ROS 2, with its own type names, as Humble and later define them; nothing else here names a type of ROS.

A message `nav_msgs/msg/Path` is the DDS type `nav_msgs::msg::dds_::Path_`. Fields keep ROS's names, order and types,
so that the bytes (CDR) are those of ROS. `HASHES` are ROS's own hashes of the definitions (REP 2016), which nodes of
Iron and later compare; tests derive them from ROS's definitions.
"""

from dataclasses import dataclass, field
from typing import TypeVar

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import array, float32, float64, int8, int32, sequence, uint8, uint32

Message = TypeVar("Message", bound=IdlStruct)


@dataclass
@final
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    """A time since the clock's zero."""

    sec: int32 = 0
    nanosec: uint32 = 0

    @classmethod
    def of(cls, seconds: float) -> "Time":
        """The time of a number of seconds."""
        whole, rest = divmod(round(seconds * 1e9), 10**9)
        return cls(whole, rest)

    @property
    def seconds(self) -> float:
        """The time as a number [s]."""
        return float(self.sec + 1e-9 * self.nanosec)


@dataclass
@final
class Duration(IdlStruct, typename="builtin_interfaces.msg.dds_.Duration_"):
    """A length of time."""

    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
@final
class Clock(IdlStruct, typename="rosgraph_msgs.msg.dds_.Clock_"):
    """The simulated time."""

    clock: Time = field(default_factory=Time)


@dataclass
@final
class Empty(IdlStruct, typename="std_msgs.msg.dds_.Empty_"):
    """Nothing but the fact that it was sent; ROS gives a structure without fields one byte."""

    structure_needs_at_least_one_member: uint8 = 0


@dataclass
@final
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    """Time and frame of what a message holds."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
@final
class ColorRGBA(IdlStruct, typename="std_msgs.msg.dds_.ColorRGBA_"):
    """A colour, each part from 0 to 1."""

    r: float32 = 0.0
    g: float32 = 0.0
    b: float32 = 0.0
    a: float32 = 0.0


@dataclass
@final
class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    """A vector."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
@final
class Point(IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
    """A place [m]."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
@final
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    """A rotation."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
@final
class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    """A place and a rotation."""

    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
@final
class PoseStamped(IdlStruct, typename="geometry_msgs.msg.dds_.PoseStamped_"):
    """A pose in a frame, at a time."""

    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@dataclass
@final
class PoseWithCovariance(IdlStruct, typename="geometry_msgs.msg.dds_.PoseWithCovariance_"):
    """A pose and its covariance, row by row."""

    pose: Pose = field(default_factory=Pose)
    covariance: array[float64, 36] = field(default_factory=lambda: [0.0] * 36)


@dataclass
@final
class Twist(IdlStruct, typename="geometry_msgs.msg.dds_.Twist_"):
    """Velocities along [m/s] and about [rad/s] the axes of a body."""

    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
@final
class TwistStamped(IdlStruct, typename="geometry_msgs.msg.dds_.TwistStamped_"):
    """Velocities at a time."""

    header: Header = field(default_factory=Header)
    twist: Twist = field(default_factory=Twist)


@dataclass
@final
class TwistWithCovariance(IdlStruct, typename="geometry_msgs.msg.dds_.TwistWithCovariance_"):
    """Velocities and their covariance, row by row."""

    twist: Twist = field(default_factory=Twist)
    covariance: array[float64, 36] = field(default_factory=lambda: [0.0] * 36)


@dataclass
@final
class Transform(IdlStruct, typename="geometry_msgs.msg.dds_.Transform_"):
    """The pose of a frame in another."""

    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)


@dataclass
@final
class TransformStamped(IdlStruct, typename="geometry_msgs.msg.dds_.TransformStamped_"):
    """The pose of a child frame in the header's frame."""

    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    transform: Transform = field(default_factory=Transform)


@dataclass
@final
class TFMessage(IdlStruct, typename="tf2_msgs.msg.dds_.TFMessage_"):
    """Poses of frames."""

    transforms: sequence[TransformStamped] = field(default_factory=list)


@dataclass
@final
class MapMetaData(IdlStruct, typename="nav_msgs.msg.dds_.MapMetaData_"):
    """Size and place of a map."""

    map_load_time: Time = field(default_factory=Time)
    resolution: float32 = 0.0
    width: uint32 = 0
    height: uint32 = 0
    origin: Pose = field(default_factory=Pose)


@dataclass
@final
class OccupancyGrid(IdlStruct, typename="nav_msgs.msg.dds_.OccupancyGrid_"):
    """A map: per cell the chance of a wall from 0 to 100, or -1, row by row from the lowest."""

    header: Header = field(default_factory=Header)
    info: MapMetaData = field(default_factory=MapMetaData)
    data: sequence[int8] = field(default_factory=list)


@dataclass
@final
class Odometry(IdlStruct, typename="nav_msgs.msg.dds_.Odometry_"):
    """Pose of a body in the header's frame, and its velocities in its own."""

    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass
@final
class Path(IdlStruct, typename="nav_msgs.msg.dds_.Path_"):
    """Poses along a path."""

    header: Header = field(default_factory=Header)
    poses: sequence[PoseStamped] = field(default_factory=list)


@dataclass
@final
class LaserScan(IdlStruct, typename="sensor_msgs.msg.dds_.LaserScan_"):
    """Ranges of a lidar, from the least angle on."""

    header: Header = field(default_factory=Header)
    angle_min: float32 = 0.0
    angle_max: float32 = 0.0
    angle_increment: float32 = 0.0
    time_increment: float32 = 0.0
    scan_time: float32 = 0.0
    range_min: float32 = 0.0
    range_max: float32 = 0.0
    ranges: sequence[float32] = field(default_factory=list)
    intensities: sequence[float32] = field(default_factory=list)


@dataclass
@final
class CompressedImage(IdlStruct, typename="sensor_msgs.msg.dds_.CompressedImage_"):
    """A picture; part of every marker."""

    header: Header = field(default_factory=Header)
    format: str = ""
    data: sequence[uint8] = field(default_factory=list)


@dataclass
@final
class UVCoordinate(IdlStruct, typename="visualization_msgs.msg.dds_.UVCoordinate_"):
    """A place in a texture; part of every marker."""

    u: float32 = 0.0
    v: float32 = 0.0


@dataclass
@final
class MeshFile(IdlStruct, typename="visualization_msgs.msg.dds_.MeshFile_"):
    """A mesh; part of every marker."""

    filename: str = ""
    data: sequence[uint8] = field(default_factory=list)


@dataclass
@final
class Marker(IdlStruct, typename="visualization_msgs.msg.dds_.Marker_"):
    """Something to draw."""

    header: Header = field(default_factory=Header)
    ns: str = ""
    id: int32 = 0
    type: int32 = 0
    action: int32 = 0
    pose: Pose = field(default_factory=Pose)
    scale: Vector3 = field(default_factory=Vector3)
    color: ColorRGBA = field(default_factory=ColorRGBA)
    lifetime: Duration = field(default_factory=Duration)
    frame_locked: bool = False
    points: sequence[Point] = field(default_factory=list)
    colors: sequence[ColorRGBA] = field(default_factory=list)
    texture_resource: str = ""
    texture: CompressedImage = field(default_factory=CompressedImage)
    uv_coordinates: sequence[UVCoordinate] = field(default_factory=list)
    text: str = ""
    mesh_resource: str = ""
    mesh_file: MeshFile = field(default_factory=MeshFile)
    mesh_use_embedded_materials: bool = False


LINE_STRIP, LINE_LIST, CYLINDER, TEXT = 4, 5, 3, 9  # types of markers
CUBE, SPHERE, TRIANGLE_LIST = 1, 2, 11
DELETE_ALL = 3  # an action of markers
DOUBTFUL = "few effective samples"  # of a plan; diagnostics warn of it


@dataclass
@final
class MarkerArray(IdlStruct, typename="visualization_msgs.msg.dds_.MarkerArray_"):
    """Things to draw."""

    markers: sequence[Marker] = field(default_factory=list)


@dataclass
@final
class KeyValue(IdlStruct, typename="diagnostic_msgs.msg.dds_.KeyValue_"):
    """A value and its name."""

    key: str = ""
    value: str = ""


@dataclass
@final
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticStatus_"):
    """How a part of a robot is: level 0 is right, 1 a warning, 2 an error."""

    level: uint8 = 0
    name: str = ""
    message: str = ""
    hardware_id: str = ""
    values: sequence[KeyValue] = field(default_factory=list)


@dataclass
@final
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticArray_"):
    """How parts of a robot are."""

    header: Header = field(default_factory=Header)
    status: sequence[DiagnosticStatus] = field(default_factory=list)


HASHES: dict[type[IdlStruct], str] = {  # of types that have topics of their own, without RIHS01_
    Clock: "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    Empty: "20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312",
    PoseStamped: "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    Twist: "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    TwistStamped: "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    TFMessage: "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    OccupancyGrid: "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    Odometry: "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    Path: "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b",
    LaserScan: "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    MarkerArray: "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    DiagnosticArray: "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
}


def ros_name(kind: type[IdlStruct]) -> str:
    """Return the name of a type in ROS, such as nav_msgs/msg/Path."""
    return str(kind.__idl_typename__).replace(".dds_", "").removesuffix("_").replace(".", "/")
