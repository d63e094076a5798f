"""Obstacles of a compiled MuJoCo model, and how far the workspace reaches.

Those that move are mocap bodies whose motions stand in the scene as custom numerics: `pirrht_motion_BODY`, about the
vertical through where they stand, or for a robot in space also `pirrht_poses_BODY`, with places and quaternions.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import acos, inf, remainder, tau

import mujoco
import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.obstacle import Motion, Mover, rotation_of
from pirrht.geometry.scene import Kind, Obstacle, Scene
from sim.mjcf.library import FARTHEST, Faults, listed, prefixed, refuse_far, refused
from sim.states.planar_joints import GROUND, heading_of

Mask = NDArray[np.bool_]
Faces = NDArray[np.int64]

MOTION = "pirrht_motion_"  # with the name of a body: how it moves ...
POSES = "pirrht_poses_"  # ... in space
MOTIONS = {
    MOTION: "rows of four numbers: t x y yaw [s, m, m, rad]",
    POSES: "rows of eight numbers: t x y z [s, m, m, m] and a quaternion w x y z",
}
_GEOM = mujoco.mjtGeom
CONVEX = 0.99  # share of its hull that a mesh fills at least to count as convex
_UNIT = 1e-6  # by which the norm of a rotation's quaternion may be off 1
_UP = 1 - 1e-9  # the upward part of the normal of a horizontal plane, at least
NEAR = 1e-6  # by which a first row may miss the place where its body stands [m]
TURNED = 1e-3  # and its yaw there [rad]: people write pi/2 with four digits
QUARTER = 0.25 * tau  # by how much a motion about the vertical turns at most between two rows in space [rad]
_ABOUT_VERTICAL = np.array([-1.0, -1.0, 1.0, 1.0])  # k (w, x, y, z) = (-z, -y, x, w)
_TOUCH = 1e-9  # what only touches the robot's height range, like a slab it stands on, is not in its way [m]


def read_obstacles(
    model: mujoco.MjModel, data: mujoco.MjData, robot: Mask, span: tuple[float, float], faults: Faults
) -> dict[int, Obstacle]:
    """The geoms that would collide with the robot and reach into its height range `span` [m], in their order.

    `robot` masks its own geoms (ngeom,). Faults are what moves or deforms, planes off the floor, height fields, and
    meshes without volume.
    """
    faults.of(_refuse_turns, model)
    faults.of(_refuse_moving, model, robot)
    found = {}
    offered, accepted = model.geom_contype, model.geom_conaffinity
    match = (offered[:, None] & accepted[robot]) | (offered[robot] & accepted[:, None])
    for geom in np.flatnonzero(~robot & np.any(match != 0, axis=1)).tolist():
        obstacle = faults.of(_obstacle, model, data, geom)
        if obstacle is not None:
            low, high = _height_range(obstacle)
            if low < span[1] - _TOUCH and high > span[0] + _TOUCH:
                found[geom] = obstacle
    return found


def read_workspace(
    model: mujoco.MjModel, data: mujoco.MjData, given: Sequence[float] | None, dimension: int = 2
) -> tuple[Array, Array]:
    """Least and greatest corner [m], of as many coordinates as a position has.

    They are as given, else of the site `workspace`, else of the first floor plane, which bounds no height.
    """
    ends = " ".join(f"{axis}0 {axis}1" for axis in "XYZ"[:dimension])
    order = " and ".join(f"{axis}0 < {axis}1" for axis in "xyz"[:dimension])
    if given is not None:
        bounds = np.array(given, dtype=float)
        numbers = bounds.shape == (2 * dimension,) and np.all(np.abs(bounds) <= FARTHEST)
        if not (numbers and np.all(bounds[::2] < bounds[1::2])):
            raise SceneError(f"the workspace {bounds.tolist()} is no box; give {ends} with {order}")
        return bounds[::2], bounds[1::2]
    site = site_of(model, "workspace")
    if site >= 0:
        if model.site_type[site] != _GEOM.mjGEOM_BOX:
            raise SceneError('site "workspace" must be a box; write type="box" and its half sizes')
        least, most = _extent('site "workspace"', data.site_xpos[site], data.site_xmat[site], model.site_size[site])
        return least[:dimension], most[:dimension]
    remedy = '<site name="workspace" type="box" pos="x y z" size="half-x half-y half-z"/>'
    remedy = f"add {remedy} or give --workspace {ends}"
    planes = np.flatnonzero((model.geom_type == _GEOM.mjGEOM_PLANE) & (data.geom_xmat[:, 8] > _UP)).tolist()
    floor = next((geom for geom in planes * (dimension == 2) if model.geom(geom).name != f"robot/{GROUND}"), None)
    if floor is None:
        raise SceneError(f'no site "workspace" and no horizontal floor plane; {remedy}')
    size = model.geom_size[floor, :2]
    if not np.all(size > 0):
        raise SceneError(f"{geom_label(model, floor)} is infinite and bounds nothing; give it half sizes or {remedy}")
    least, most = _extent(geom_label(model, floor), data.geom_xpos[floor], data.geom_xmat[floor], np.append(size, 0.0))
    return least[:dimension], most[:dimension]


def site_of(model: mujoco.MjModel, name: str) -> int:
    """The number of a site; -1 if there is none."""
    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name))


def geom_label(model: mujoco.MjModel, geom: int) -> str:
    """How messages call a geom, by its name or by its place."""
    name, body = model.geom(geom).name, model.body(model.geom_bodyid[geom]).name
    return f'geom "{name}"' if name else f'unnamed geom number {geom} (in body "{body}")'


def _refuse_turns(model: mujoco.MjModel) -> None:
    """Refuse compiled rotations that are none, which would vanish from all checks."""
    for kind in ("body", "geom", "site"):
        norms = np.linalg.norm(getattr(model, f"{kind}_quat"), axis=1)
        wrong = np.flatnonzero(~(np.abs(norms - 1.0) < _UNIT))
        if len(wrong):
            name = getattr(model, kind)(wrong[0]).name
            label = f'{kind} "{name}"' if name else f"unnamed {kind} number {wrong[0]}"
            raise SceneError(
                f"{label} has a rotation that is not finite after compilation; write finite numbers of ordinary size "
                "in its orientation, its mesh, and the frames and bodies around it"
            )


def _refuse_moving(model: mujoco.MjModel, robot: Mask) -> None:
    if model.nflex:
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_FLEX, 0)
        raise SceneError(f'flex "{name}" deforms; obstacles must be static: remove it')
    own = set(model.body_rootid[model.geom_bodyid[robot]].tolist())
    joints: dict[int, list[str]] = {}
    for joint, root in enumerate(model.body_rootid[model.jnt_bodyid].tolist()):
        if root not in own:
            kind = mujoco.mjtJoint(int(model.jnt_type[joint])).name.removeprefix("mjJNT_").lower()
            name = model.joint(joint).name
            joints.setdefault(root, []).append(f'joint "{name}"' if name else f"a {kind} joint")
    if joints:
        moving = [f'body "{model.body(root).name}" moves by {listed(names)}' for root, names in joints.items()]
        name = model.body(next(iter(joints))).name or "NAME"
        raise SceneError(
            f"{listed(moving)}; obstacles are static or follow a motion: remove joints, load it with --freeze or "
            f'--without {name}, or write <body mocap="true" ...> and a numeric "{MOTION}{name}"'
        )


def _obstacle(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Obstacle | None:
    """The plain values of a geom; None for a horizontal floor."""
    label = geom_label(model, geom)
    shape = _GEOM(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()

    if shape == "plane":
        if data.geom_xmat[geom, 8] > _UP and data.geom_xpos[geom, 2] <= _TOUCH:
            return None
        raise SceneError(f"{label} is a plane, but not the horizontal floor at z = 0; move it, or write a box")
    if shape not in {kind.value for kind in Kind}:
        raise SceneError(f"{label} is of type {shape}; remove it or write one of {', '.join(k.value for k in Kind)}")
    refuse_far(label, data.geom_xpos[geom], model.geom_size[geom])
    vertices, faces, size = None, None, np.array(model.geom_size[geom])
    if shape == Kind.MESH.value:
        with prefixed(f"the mesh of {label} "):
            vertices, faces = _hull_of(mesh_of(model, geom)[0])
        refuse_far(label, vertices)
        size = np.zeros(3)
    return Obstacle(
        name=model.geom(geom).name or f"geom{geom}", kind=Kind(shape), size=size, vertices=vertices, faces=faces,
        position=np.array(data.geom_xpos[geom]), rotation=np.array(data.geom_xmat[geom]).reshape(3, 3),
    )  # fmt: skip


def _height_range(obstacle: Obstacle) -> tuple[float, float]:
    """Lowest and highest point [m]."""
    up = obstacle.rotation[2]
    size = obstacle.size
    middle = float(obstacle.position[2])

    if obstacle.vertices is not None:
        heights = obstacle.vertices @ up
        return middle + float(heights.min()), middle + float(heights.max())
    half = {
        Kind.BOX: np.abs(up) @ size,
        Kind.CYLINDER: size[0] * np.hypot(up[0], up[1]) + size[1] * abs(up[2]),
        Kind.ELLIPSOID: np.linalg.norm(up * size),
    }.get(obstacle.kind, size[0] + size[1] * abs(up[2]))  # a sphere is a capsule without length
    return middle - float(half), middle + float(half)


def _extent(what: str, centre: Array, rotation: Array, size: Array) -> tuple[Array, Array]:
    refuse_far(what, centre, size)
    turn = np.abs(rotation.reshape(3, 3))
    if np.any(np.minimum(turn, np.abs(1 - turn)) > 1e-6):
        raise SceneError(f"{what} is askew; the domain is aligned with the axes: turn it by quarter turns")
    half = turn @ size
    return np.array(centre - half), np.array(centre + half)


def mesh_of(model: mujoco.MjModel, geom: int) -> tuple[Array, Faces]:
    """Corners (v, 3) [m] in the frame of the geom, and faces (f, 3): MuJoCo recentres meshes, and poses with them."""
    mesh = int(model.geom_dataid[geom])
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]].astype(float)
    return vertices, model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]


def _hull_of(vertices: Array) -> tuple[Array, Faces]:
    """Corners and faces of the convex hull of points (v, 3); SceneError if they have no volume."""
    import trimesh  # slow to import, and few scenes have meshes

    try:
        hull = trimesh.convex.convex_hull(vertices)
    except Exception as error:  # whatever Qhull says of points without volume
        raise SceneError(f"has no hull ({str(error).partition(chr(10))[0]}); give it volume") from None
    return np.array(hull.vertices, dtype=float), np.array(hull.faces, dtype=np.int64)


def concave_meshes(model: mujoco.MjModel, solids: Mapping[int, Obstacle]) -> dict[int, str]:
    """How messages call meshes, by geom, that fill less than `CONVEX` of their hulls, with which MuJoCo collides."""
    found = {}
    for geom, hull in solids.items():
        if hull.vertices is not None:
            from trimesh import Trimesh

            parts = mesh_of(model, geom), (hull.vertices, hull.faces)
            with np.errstate(all="ignore"):  # an open mesh may have a volume of zero, by which trimesh divides
                mine, whole = (abs(float(Trimesh(*part, process=False).volume)) for part in parts)
            if mine < CONVEX * whole:
                found[geom] = f"{geom_label(model, geom)} ({whole:.3g} m3, of which the mesh fills {mine:.3g})"
    return found


def read_motions(spec: mujoco.MjSpec) -> dict[str, Motion]:
    """The motions of a scene by the names of their bodies, in the order of the file."""
    rows = {n.name: np.array(list(n.data)) for n in spec.numerics if n.name.startswith(tuple(MOTIONS))}
    texts = {t.name: str(t.data) for t in spec.texts if t.name.startswith(tuple(MOTIONS))}
    for name, text in texts.items():
        if name not in rows or text != "repeat":
            known = listed([f'"{one}"' for one in rows]) or "none"
            raise SceneError(
                f'custom text "{name}" is "{text}"; write "repeat" for one of the motions here, which are {known}, add '
                f'<numeric name="{name}" data="0 x y yaw  t x y yaw ..."/>, or remove it: a body stops at its last row'
            )
    bodies = [*map(moved_by, rows)]
    if twice := {f'"{name}"' for name in bodies if bodies.count(name) > 1}:
        raise SceneError(f"body {listed([*twice])} has two motions; keep {MOTION}BODY or {POSES}BODY")
    return {moved_by(name): _motion(spec, name, data, name in texts) for name, data in rows.items()}


def moved_by(name: str) -> str:
    """Return the body that a numeric of a motion moves."""
    return name.removeprefix(MOTION).removeprefix(POSES)


def _motion(spec: mujoco.MjSpec, name: str, data: Array, repeat: bool) -> Motion:
    """The motion that a numeric of that name gives a body, which must be able to move so."""
    label = f'custom numeric "{name}"'
    called = moved_by(name)
    width, must = (8, MOTIONS[POSES]) if name.startswith(POSES) else (4, MOTIONS[MOTION])
    body, why = spec.body(called), ""
    if body is None:
        why = "is not there"
    elif joints := body.find_all(mujoco.mjtObj.mjOBJ_JOINT):
        why = f'has joint "{joints[0].name}"' if joints[0].name else "has a joint"
    elif not body.mocap:
        why = "is no mocap body"
    if why:
        known = listed([f'"{b.name}"' for b in spec.bodies if b.mocap and b.name]) or "none"
        raise SceneError(
            f'{label} moves body "{called}", which {why}; write <body name="{called}" mocap="true" ...> without joints '
            f"in the worldbody, or name another; bodies that can move are {known}"
        )
    if data.size % width or not (data.any() or data.size == width):
        zeros = "" if data.any() else " that are all 0"
        raise SceneError(f"{label} is of {data.size} numbers{zeros}; write {must}")
    with refused(f"{label}: ", f"; write {must}, in order", SceneError):
        motion = Motion(rows=data.reshape(-1, width), repeat=repeat)
    refuse_far(label, motion.rows)
    return motion


def moved_geoms(model: mujoco.MjModel, names: Iterable[str]) -> Mask:
    """Return which geoms move with bodies of these names or with bodies inside them, (ngeom,)."""
    return np.isin(model.body_rootid[model.geom_bodyid], [model.body(name).id for name in names])


def read_movers(
    model: mujoco.MjModel, data: mujoco.MjData, motions: Mapping[str, Motion], solids: Mapping[int, Obstacle],
    dimension: int,
) -> tuple[Mover, ...]:  # fmt: skip
    """Moving obstacles, in the order of the motions by body, given whatever the robot can collide with by geom."""
    roots = model.body_rootid[model.geom_bodyid]
    movers = []
    for name, given in motions.items():
        body = int(model.body(name).id)
        place = data.xpos[body]
        quaternion = data.xquat[body]
        if given.in_space and dimension == 2:
            raise SceneError(
                f'body "{name}" moves in space, and the robot does not; write "{MOTION}{name}" in place of '
                f'"{POSES}{name}", as {MOTIONS[MOTION]}, or choose a robot in space'
            )
        _refuse_jump(name, given, place, quaternion)
        motion = _raised(given, float(place[2]), quaternion) if dimension == 3 and not given.in_space else given
        first = motion.pose_at(-motion.offset)
        turn, origin = rotation_of(first).T, np.array([*first[:2], first[2] if dimension == 3 else 0.0])
        mine = tuple(
            replace(one, position=turn @ (one.position - origin), rotation=turn @ one.rotation)
            for geom, one in solids.items()
            if roots[geom] == body
        )
        if not mine:
            raise SceneError(
                f'body "{name}" moves, and none of its geoms can touch the robot; match their contype and conaffinity '
                f'and let them reach into its height, or remove "{MOTION}{name}"'
            )
        movers.append(Mover(name=name, solids=mine, motion=motion))
    return tuple(movers)


def _refuse_jump(name: str, motion: Motion, place: Array, quaternion: Array) -> None:
    """Refuse a first row that is not where its body stands."""
    kind, d, turn = (POSES, 3, "quat") if motion.in_space else (MOTION, 2, "yaw")
    first = motion.rows[0, 1:]
    now = [*place, *quaternion] if motion.in_space else [*place[:2], heading_of(quaternion)]
    turned = remainder(first[-1] - now[-1], tau)
    if motion.in_space:
        turned = 2.0 * acos(min(abs(float(first[3:] @ quaternion)), 1.0))
    if np.abs(first - now)[:d].max() > NEAR or abs(turned) > TURNED:
        there, at = (
            f"({', '.join(f'{v:g}' for v in pose[:d])}) with {turn} {as_text(pose[d:])}" for pose in (now, first)
        )
        raise SceneError(
            f'body "{name}" stands at {there}, and the first row of "{kind}{name}" is {at}, a jump at the start; let '
            f'it stand there, pos="{as_text([*first[:d], *place[d:]])}" and turned so, or begin with "0 {as_text(now)}"'
        )


def as_text(values: Iterable[float]) -> str:
    """Numbers as an attribute has them."""
    return " ".join(f"{value:g}" for value in values)


def _raised(motion: Motion, height: float, quaternion: Array) -> Motion:
    """Return a motion about the vertical as one in space, at a height [m] and from an attitude at its first row."""
    rows = motion.rows
    parts = np.maximum(np.ceil(np.abs(np.diff(rows[:, 3])) / QUARTER).astype(int), 1)
    at = np.interp(np.arange(parts.sum() + 1), np.append(0, np.cumsum(parts)), np.arange(len(rows)))
    fine = np.column_stack([np.interp(at, np.arange(len(rows)), column) for column in rows.T])
    turned = _turned(np.tile(quaternion, (len(fine), 1)), fine[:, 3] - fine[0, 3])
    return replace(motion, rows=np.column_stack([fine[:, :3], np.full(len(fine), height), turned]))


def clearance_at_start(scene: Scene) -> tuple[float, str]:
    """Clearance of the footprint from the nearest moving obstacle at the start [m], and the body's name."""
    if not scene.movers:
        return inf, ""
    from pirrht.moving.collision import MovingObstacles  # FCL is slow to import, and few scenes move

    pose = scene.place if scene.footprint.is_disc else scene.start
    crowds = {mover.name: MovingObstacles([mover], scene.footprint) for mover in scene.movers}
    return min((float(crowd.clearance(pose, 0.0)), name) for name, crowd in crowds.items())


class Mocap:
    """Places the J moving bodies of a model, in the plane by x, y and yaw, with height and tilt as in the file."""

    def __init__(self, model: mujoco.MjModel, movers: Sequence[Mover]) -> None:
        bodies = [int(model.body(mover.name).id) for mover in movers]
        self._motions = [mover.motion for mover in movers]
        self._in_space = any(motion.in_space for motion in self._motions)
        self._rows = model.body_mocapid[bodies]
        self._heights = model.body_pos[bodies, 2]
        yaws = np.array([motion.rows[0, 3] for motion in self._motions])
        self._upright = _turned(model.body_quat[bodies], -yaws)  # at yaw 0

    def place(self, data: mujoco.MjData, time: float) -> None:
        """Place the bodies as they are at a time [s]."""
        poses = np.array([motion.pose_at(time) for motion in self._motions])
        if self._in_space:
            data.mocap_pos[self._rows] = poses[:, :3]
            data.mocap_quat[self._rows] = poses[:, 3:]
            return
        data.mocap_quat[self._rows] = _turned(self._upright, poses[:, 2])
        poses[:, 2] = self._heights
        data.mocap_pos[self._rows] = poses

    def poses(self, times: Array) -> tuple[Array, Array]:
        """Places (k, J, 3) [m] and quaternions (k, J, 4), w first, at times (k,) [s]."""
        found = np.stack([motion.pose(times) for motion in self._motions], axis=1)
        if self._in_space:
            return found[..., :3], found[..., 3:]
        heights = np.broadcast_to(self._heights, found.shape[:2])
        return np.dstack([found[..., :2], heights]), _turned(self._upright, found[..., 2])


def _turned(quaternions: Array, yaws: Array) -> Array:
    """Quaternions (..., 4), w first, turned about the vertical by yaws (...) [rad]."""
    half = 0.5 * yaws[..., None]
    return np.asarray(np.cos(half) * quaternions + np.sin(half) * (_ABOUT_VERTICAL * quaternions[..., ::-1]))
