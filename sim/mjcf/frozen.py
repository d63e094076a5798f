"""Scenes of other people: bodies that move are welded where they are, and bodies are left out."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.mjcf.library import compile_spec
from sim.text import counted

SHOWN = 6  # names in a line
_TARGETED = (mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY, mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODYCOM)


def leave_out(spec: mujoco.MjSpec, names: Sequence[str], path: Path) -> str:
    """Remove bodies with all that is in them or refers to them; a line on what is gone.

    Raises:
        SceneError: there is no such body; names those of the worldbody.
    """
    gone: set[str] = set()
    before = len(spec.actuators)
    for name in dict.fromkeys(names):
        body = spec.body(name) if name != "world" else None
        if body is None and name not in gone:
            known = listed([f'"{one.name}"' for one in spec.worldbody.bodies if one.name]) or "none with a name"
            raise SceneError(f'{path}: there is no body "{name}" to leave out; those of the worldbody are {known}')
        if body is not None:
            gone |= {name, *(inner.name for inner in body.find_all("body"))}
            spec.delete(body)
    for eye in [*spec.cameras, *spec.lights]:  # MuJoCo removes the rest of what refers to a body
        if eye.targetbody in gone:
            eye.targetbody, eye.mode = "", mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    for group in (spec.skins, spec.tuples):  # what they refer to may stand in files of their own
        _delete(group, spec)
    dropped = before - len(spec.actuators)
    also = f" and {counted(dropped, 'actuator')}" if dropped else ""
    return f"left out: {listed(list(dict.fromkeys(names)))}{also}"


def freeze(spec: mujoco.MjSpec, moving: Collection[str], path: Path) -> str:
    """Weld bodies where the first keyframe, else the default pose, has them; drop what would act on them or measure.

    Args:
        spec: changed in place.
        moving: mocap bodies that have motions and keep them.
        path: the scene's file, for messages.

    Returns:
        A line on what was done; empty where nothing moves.

    Raises:
        SceneError: the scene does not compile.
    """
    model = compile_spec(spec, path)
    data, where = mujoco.MjData(model), "the default pose"
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
        where = f'keyframe "{model.key(0).name}"' if model.key(0).name else "the first keyframe"
    mujoco.mj_kinematics(model, data)
    jointed = [body for body in spec.bodies if list(body.joints)]
    frames = _frames(spec, path) if list(spec.frames) else None
    for body in [*jointed, *(b for b in spec.bodies if b.mocap and b.name not in moving)]:
        parent = int(model.body_parentid[body.id])
        pose = _relative((data.xpos[parent], data.xquat[parent]), (data.xpos[body.id], data.xquat[body.id]))
        body.pos, body.quat = _relative(frames[body.id], pose) if frames else pose
        body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    roots = [spec.bodies[i].name or f"unnamed body {i}" for i in _roots(model, [body.id for body in jointed])]
    dropped = len(spec.actuators)
    for group in (spec.actuators, spec.sensors, spec.equalities, spec.tendons, spec.tuples, spec.keys):
        _delete(group, spec)
    for body in jointed:
        _delete(body.joints, spec)
    spec.compiler.fusestatic = 0
    also = f"; {counted(dropped, 'actuator')} dropped" if dropped else ""
    return f"frozen as {where} has them: {listed(roots)}{also}" if roots or dropped else ""


def listed(names: Sequence[str]) -> str:
    """Names with commas, not all of many."""
    more = len(names) - SHOWN
    return ", ".join(names[:SHOWN]) + (f" and {more} more" if more > 0 else "")


def _roots(model: mujoco.MjModel, bodies: Sequence[int]) -> list[int]:
    """The bodies of the worldbody that these are in, in the order of the model."""
    return sorted({int(model.body_rootid[body]) for body in bodies})


def _frames(spec: mujoco.MjSpec, path: Path) -> list[tuple[Array, Array]]:
    """Position and quaternion of what each body's own pose is relative to, in the body that holds it."""
    bare = spec.copy()
    _delete(bare.keys, bare)
    for body in bare.bodies[1:]:
        body.pos, body.quat, body.alt.type = [0, 0, 0], [1, 0, 0, 0], mujoco.mjtOrientation.mjORIENTATION_QUAT
    model = compile_spec(bare, path)
    return list(zip(model.body_pos.copy(), model.body_quat.copy(), strict=True))


def _relative(base: tuple[Array, Array], pose: tuple[Array, Array]) -> tuple[Array, Array]:
    """A pose in the frame of another one."""
    place, turn, back = np.zeros(3), np.zeros(4), np.zeros(4)
    mujoco.mju_negQuat(back, base[1])
    mujoco.mju_rotVecQuat(place, np.asarray(pose[0]) - base[0], back)
    mujoco.mju_mulQuat(turn, back, pose[1])
    return place, turn


def _delete(elements: Sequence[object], spec: mujoco.MjSpec) -> None:
    for element in list(elements):
        spec.delete(element)
