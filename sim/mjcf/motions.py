"""Bodies that move: mocap bodies whose motions stand in the scene as custom numerics `pirrht_motion_BODY`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf, remainder, tau
from pathlib import Path

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.obstacle import Motion, Mover, Obstacle, about_vertical
from pirrht.geometry.scene import Scene
from sim.mjcf.coordinates import heading_of
from sim.mjcf.numbers import MOTION, refuse_far
from sim.mjcf.obstacles import Mask

NEAR = 1e-6  # by which a first row may miss the place where its body stands [m]
TURNED = 1e-3  # and its yaw there [rad]: people write pi/2 with four digits
ROWS = "rows of four numbers: t x y yaw [s, m, m, rad]"
MOVES = 'it moves: move site "start", choose another --start, or write another first row'


def read_motions(spec: mujoco.MjSpec, path: Path) -> dict[str, Motion]:
    """The motions of a scene by the names of their bodies, in the order of the file.

    Raises:
        SceneError: there is no such body, it is no mocap body, or its rows are none; names element and remedy.
    """
    rows = {n.name: np.array(list(n.data)) for n in spec.numerics if n.name.startswith(MOTION)}
    texts = {t.name: str(t.data) for t in spec.texts if t.name.startswith(MOTION)}
    for name, text in texts.items():
        label = f'{path}: custom text "{name}"'
        if name not in rows:
            known = ", ".join(f'"{one}"' for one in rows)
            there = f"the motions here are {known}: give it the name of one" if known else "remove it"
            raise SceneError(
                f"{label} repeats a motion that is not there; {there}, or add "
                f'<numeric name="{name}" data="0 x y yaw  t x y yaw ..."/>'
            )
        if text != "repeat":
            raise SceneError(f'{label} is "{text}"; write "repeat", or remove it: then the body stops at the last row')
    motions = {}
    for name, data in rows.items():
        _check_body(spec, name, path)
        motions[name.removeprefix(MOTION)] = _motion(name, data, name in texts, path)
    return motions


def _check_body(spec: mujoco.MjSpec, name: str, path: Path) -> None:
    label, called = f'{path}: custom numeric "{name}"', name.removeprefix(MOTION)
    body = spec.body(called)
    if body is None:
        known = ", ".join(f'"{b.name}"' for b in spec.bodies if b.mocap and b.name)
        there = f"bodies that can move are {known}" if known else "none in this scene is a mocap body"
        raise SceneError(
            f'{label} moves a body "{called}", which is not there; {there}: '
            f'write <body name="{called}" mocap="true" ...> in the worldbody or name another'
        )
    joints = body.find_all(mujoco.mjtObj.mjOBJ_JOINT)
    if joints:
        joint = f'joint "{joints[0].name}"' if joints[0].name else "a joint"
        raise SceneError(
            f'{label} moves body "{called}", which has {joint}; what moves by rows has no joints: '
            f'remove them and write <body name="{called}" mocap="true" ...>'
        )
    if not body.mocap:
        raise SceneError(
            f'{label} moves body "{called}", which is no mocap body; '
            f'write <body name="{called}" mocap="true" ...> in the worldbody'
        )


def _motion(name: str, data: Array, repeat: bool, path: Path) -> Motion:
    label = f'{path}: custom numeric "{name}"'
    if data.size > 4 and not data.any():
        raise SceneError(f"{label} is of {data.size} numbers that are all 0; write {ROWS}")
    if data.size == 0 or data.size % 4:
        raise SceneError(f"{label} is of {data.size} numbers; write {ROWS}")
    try:
        motion = Motion(rows=data.reshape(-1, 4), repeat=repeat)
    except SceneError as error:
        raise SceneError(f"{label}: {error}; write {ROWS}, in order") from None
    refuse_far(f'custom numeric "{name}"', path, motion.rows)
    return motion


def moved_geoms(model: mujoco.MjModel, motions: Mapping[str, Motion]) -> Mask:
    """The geoms that move with bodies of these names, those of bodies inside them too, (ngeom,)."""
    roots = [model.body(name).id for name in motions]
    return np.asarray(np.isin(model.body_rootid[model.geom_bodyid], roots))


def read_movers(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    motions: Mapping[str, Motion],
    solids: Mapping[int, Obstacle],
    path: Path,
) -> tuple[Mover, ...]:
    """What moves, in the order of the motions.

    Args:
        model: the robot joined to its scene.
        data: its data after kinematics, as the file places everything.
        motions: by name of the body.
        solids: whatever the robot can collide with where the file places it, by number of the geom.
        path: the scene's file, for messages.

    Raises:
        SceneError: a body stands elsewhere than its motion begins, or nothing of it can touch the robot.
    """
    roots = model.body_rootid[model.geom_bodyid]
    movers = []
    for name, motion in motions.items():
        body = int(model.body(name).id)
        _check_place(data, body, name, motion, path)
        mine = tuple(_in_body(solid, motion) for geom, solid in solids.items() if roots[geom] == body)
        if not mine:
            raise SceneError(
                f'{path}: body "{name}" moves, and none of its geoms can touch the robot; match their contype and '
                f'conaffinity and let them reach into its height, or remove "{MOTION}{name}"'
            )
        movers.append(Mover(name=name, solids=mine, motion=motion))
    return tuple(movers)


def _check_place(data: mujoco.MjData, body: int, name: str, motion: Motion, path: Path) -> None:
    (x, y, z), yaw = data.xpos[body].tolist(), heading_of(data.xquat[body])
    first = motion.rows[0]
    away, turned = max(abs(first[1] - x), abs(first[2] - y)), abs(remainder(first[3] - yaw, tau))
    if away > NEAR or turned > TURNED:
        stand = f'pos="{first[1]:g} {first[2]:g} {z:g}"' if away > NEAR else f"turn it to yaw {first[3]:.6g} rad"
        raise SceneError(
            f'{path}: body "{name}" stands at ({x:g}, {y:g}) with yaw {yaw:.6g}, and the first row of '
            f'"{MOTION}{name}" is ({first[1]:g}, {first[2]:g}) with yaw {first[3]:.6g}, a jump at the start; '
            f'let it stand there: {stand}, or begin with "0 {x:g} {y:g} {yaw:.6g}"'
        )


def _in_body(solid: Obstacle, motion: Motion) -> Obstacle:
    """A solid in the frame of its body at yaw 0, where the body stands at the first row."""
    _, x, y, yaw = motion.rows[0]
    turn = about_vertical(-yaw)
    return replace(solid, position=turn @ (solid.position - np.array([x, y, 0.0])), rotation=turn @ solid.rotation)


def shortfall(scene: Scene) -> float:
    """Return how far moving obstacles reach into the footprint at the start [m]; negative if none does."""
    if not scene.movers:
        return -inf
    from pirrht.moving.collision import MovingObstacles

    return -float(MovingObstacles(scene.movers, scene.footprint).clearance(scene.start[:2], 0.0))


def check_start(scene: Scene, path: Path) -> None:
    """Refuse bodies that are where the robot starts, or sweep across it where their motions start over.

    Raises:
        SceneError: names the body and what to write.
    """
    if not scene.movers:
        return
    from pirrht.moving.collision import Body, MovingObstacles, jumps  # FCL is slow to import, and few scenes move

    place = scene.start[:2]
    where = f"the start ({place[0]:g}, {place[1]:g})"
    for mover in scene.movers:
        lack = -MovingObstacles([mover], scene.footprint).clearance(place, 0.0)
        if lack >= 0.0:
            raise SceneError(f'{path}: at {where} the robot touches body "{mover.name}" (by {lack:.3g} m), and {MOVES}')
        if jumps(mover.motion):
            rows = mover.motion.rows
            turned = rows[-1, 3] + remainder(rows[0, 3] - rows[-1, 3], tau)
            back = Motion(rows=np.array([[0.0, *rows[-1, 1:]], [1.0, *rows[0, 1:3], turned]]))
            way = Mover(name=mover.name, solids=mover.solids, motion=back)
            if Body(way, scene.footprint).meets(place, 0.0, place, 1.0):
                raise SceneError(
                    f'{path}: body "{mover.name}" starts over at {rows[-1, 0]:g} s with a jump from '
                    f"({rows[-1, 1]:g}, {rows[-1, 2]:g}) to ({rows[0, 1]:g}, {rows[0, 2]:g}) across {where}; let its "
                    'last row be its first place, or move site "start"'
                )
