"""Scenes of other people, edited before they are compiled: bodies are left out, welded where they are, or set loose.

A scene that says nothing of its looks gets light, and the colours of those that are built in. What a file does say
stays. The site `workspace` bounds the plan and is no thing: it is never drawn.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from pirrht.errors import SceneError
from sim.mjcf.library import compile_spec, delete, listed
from sim.mjcf.obstacles import MOTIONS, mesh_of, moved_by, moved_geoms
from sim.text import counted

PREFIX = "loose/"  # of a body that was made for a geom of the worldbody
GOAL = PREFIX + "goal"  # the body that shows the goal's disc, and touches nothing
_KEPT = (
    *("type", "size", "pos", "quat", "fromto", "contype", "conaffinity", "condim", "priority", "friction"),
    *("solmix", "solref", "solimp", "margin", "gap", "rgba", "material", "meshname", "group", "fitscale"),
)  # of a geom that gets a body; its orientation may be in other attributes, too
_TURNS = ("axisangle", "xyaxes", "zaxis", "euler", "type")
SITES = {"start": (0.20, 0.45, 0.75, 0.8), "goal": (0.25, 0.65, 0.35, 0.7)}

HIDDEN = 3  # group of geoms that collide and are not drawn
FLOOR = (0.83, 0.845, 0.86, 1.0)
WALL = (0.27, 0.33, 0.42, 1.0)
MOVING = (0.50, 0.36, 0.62, 1.0)

PLAIN = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's colour of what has none
DARK = (0.1, 0.4, 0.5)  # its light at the eye: ambient, diffuse, specular; alone it leaves walls black
LIGHT = (0.42, 0.42, 0.0)


def leave_out(spec: mujoco.MjSpec, names: Sequence[str]) -> str:
    """Remove bodies with all that is in them or refers to them; return a line that names what was removed."""
    gone: set[str] = set()
    names = list(dict.fromkeys(names))
    before = len(spec.actuators)

    for name in names:
        body = spec.body(name) if name != "world" else None
        if body is None and name not in gone:
            known = listed([f'"{one.name}"' for one in spec.worldbody.bodies if one.name]) or "none with a name"
            raise SceneError(f'there is no body "{name}" to leave out; those of the worldbody are {known}')
        if body is not None:
            gone |= {name, *(inner.name for inner in body.find_all("body"))}
            spec.delete(body)
    for eye in [*spec.cameras, *spec.lights]:  # MuJoCo removes the rest of what refers to a body
        if eye.targetbody in gone:
            eye.targetbody, eye.mode = "", mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    delete(spec, spec.skins, spec.tuples)  # what they refer to may be in files of their own
    dropped = before - len(spec.actuators)
    return f"left out: {listed(names)}" + (f" and {counted(dropped, 'actuator')}" if dropped else "")


def freeze(spec: mujoco.MjSpec, moving: Collection[str], path: Path) -> str:
    """Weld bodies where the first keyframe, else the default pose, has them; drop what would act on them or measure.

    Bodies that are `moving` keep their motions. Returns a line on what was done; empty where nothing moves.
    """
    model = compile_spec(spec, path)
    data, where = mujoco.MjData(model), "the default pose"
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
        where = f'keyframe "{model.key(0).name}"' if model.key(0).name else "the first keyframe"
    mujoco.mj_kinematics(model, data)
    jointed = {body.id: body for body in spec.bodies if list(body.joints)}
    roots = sorted({int(model.body_rootid[number]) for number in jointed})
    called = [spec.bodies[root].name or f"unnamed body {root}" for root in roots]
    for number, body in (jointed | {b.id: b for b in spec.bodies if b.mocap and b.name not in moving}).items():
        holder = int(model.body_parentid[number])
        place = np.zeros(3)
        turn = np.zeros(4)
        back = np.zeros(4)

        mujoco.mju_negQuat(back, data.xquat[holder])
        mujoco.mju_rotVecQuat(place, data.xpos[number] - data.xpos[holder], back)
        mujoco.mju_mulQuat(turn, back, data.xquat[number])
        body.set_frame(body.parent.add_frame())  # its pose is relative to the body that holds it
        body.pos, body.quat, body.alt.type = place, turn, mujoco.mjtOrientation.mjORIENTATION_QUAT
    dropped = len(spec.actuators)
    delete(spec, spec.actuators, spec.sensors, spec.equalities, spec.tendons, spec.tuples, spec.keys)
    delete(spec, *(body.joints for body in jointed.values()))
    spec.compiler.fusestatic = 0
    also = f"; {counted(dropped, 'actuator')} dropped" if dropped else ""
    return f"frozen as {where} has them: {listed(called)}{also}" if roots or dropped else ""


def loosen(spec: mujoco.MjSpec) -> None:
    """Make static bodies and geoms movable by mocap; floors, decoration and bodies with a motion stay as they are."""
    for body in spec.worldbody.bodies:
        body.mocap = body.mocap or not list(body.joints)
    for number, geom in enumerate(list(spec.worldbody.geoms)):
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE or not (geom.contype or geom.conaffinity):
            continue
        name = geom.name or f"geom{number}"
        body = spec.worldbody.add_body(name=PREFIX + name, mocap=True)
        own = body.add_geom(**{attribute: getattr(geom, attribute) for attribute in _KEPT})
        for turn in _TURNS:
            setattr(own.alt, turn, getattr(geom.alt, turn))
        spec.delete(geom)
        own.name, body.pos, own.pos = name, own.pos, [0.0, 0.0, 0.0]
        if own.fromto[0] == own.fromto[0]:  # not a number where it has no ends
            body.pos = np.reshape(own.fromto, (2, 3)).mean(axis=0)
            own.fromto = own.fromto - np.tile(body.pos, 2)
    goal = spec.worldbody.add_body(name=GOAL, mocap=True).add_geom(name=GOAL, type=mujoco.mjtGeom.mjGEOM_CYLINDER)

    goal.size = [0.1, 0.01, 0.0]
    goal.rgba = [0.25, 0.65, 0.35, 0.7]
    goal.contype = 0
    goal.conaffinity = 0


def part_meshes(spec: mujoco.MjSpec, model: mujoco.MjModel, concave: Mapping[int, str]) -> list[str]:
    """Give bodies convex parts of their meshes that are `concave`, which no longer collide; return lines on that.

    `concave` has what messages call the meshes, by geom. A mesh that is one part stays as it is.
    """
    geoms = {geom.id: geom for geom in spec.geoms} if concave else {}
    notes = list[str]()

    for number, label in concave.items():
        from sim.mjcf.convex import convex_parts  # trimesh is slow to import, and few scenes have meshes

        geom = geoms[number]
        vertices, faces = mesh_of(model, number)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[number])
        corners = vertices @ turn.reshape(3, 3).T + model.geom_pos[number]  # in the frame of its body
        parts, more = convex_parts(corners[faces], label)
        if len(parts) < 2:
            continue
        for k, part in enumerate(parts, start=1):
            name = f"{geom.name or f'geom{number}'} #{k}"
            spec.add_mesh(name=name, uservert=part.ravel())
            own = geom.parent.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, group=HIDDEN)
            own.contype, own.conaffinity = geom.contype, geom.conaffinity
        geom.contype = geom.conaffinity = 0
        notes += more or [f"{label}: MuJoCo collides with its {len(parts)} convex parts, and so do plans"]
    return notes


def dress(model: mujoco.MjModel) -> None:
    """Give a model looks where it has none."""
    plain, bare = (np.all(np.isclose(rgba, PLAIN), axis=-1) for rgba in (model.site_rgba, model.geom_rgba))
    for site, name in ((i, model.site(i).name) for i in range(model.nsite)):
        if name == "workspace":
            model.site_rgba[site, 3], model.site_matid[site] = 0.0, -1
        elif name in SITES and model.site_matid[site] < 0 and plain[site]:
            model.site_rgba[site] = SITES[name]
    bare = (model.geom_matid < 0) & bare
    flat = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    motions = [name for i in range(model.nnumeric) if (name := model.numeric(i).name).startswith(tuple(MOTIONS))]
    moving = moved_geoms(model, map(moved_by, motions))
    model.geom_rgba[bare] = np.select([flat[bare, None], moving[bare, None]], [FLOOR, MOVING], WALL)
    head = model.vis.headlight
    if model.nlight == 0 and np.allclose([head.ambient[0], head.diffuse[0], head.specular[0]], DARK):
        head.ambient[:], head.diffuse[:], head.specular[:] = LIGHT
