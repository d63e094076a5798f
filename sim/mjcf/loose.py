"""A scene whose standing bodies can be moved while a robot drives: each becomes a mocap body of its own."""

from __future__ import annotations

import mujoco

PREFIX = "loose/"  # of a body that was made for a geom of the worldbody
GOAL = PREFIX + "goal"  # the body that shows the goal's disc, and touches nothing
_KEPT = (
    *("type", "size", "pos", "quat", "fromto", "contype", "conaffinity", "condim", "priority", "friction"),
    *("solmix", "solref", "solimp", "margin", "gap", "rgba", "material", "meshname", "group", "fitscale"),
)  # of a geom that gets a body; its orientation may be told in other ways, too
_WAYS = ("axisangle", "xyaxes", "zaxis", "euler", "type")


def loosen(spec: mujoco.MjSpec) -> None:
    """Let whatever stands in a scene be moved; floors, decoration and bodies with a motion stay as they are."""
    for body in spec.worldbody.bodies:
        if not body.mocap and not any(True for _ in body.joints):
            body.mocap = True
    for number, geom in enumerate(list(spec.worldbody.geoms)):
        if geom.type != mujoco.mjtGeom.mjGEOM_PLANE and (geom.contype or geom.conaffinity):
            _move(spec, geom, geom.name or f"geom{number}")
    goal = spec.worldbody.add_body(name=GOAL, mocap=True)
    goal.add_geom(
        name=GOAL, type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.1, 0.01, 0.0], rgba=[0.25, 0.65, 0.35, 0.7],
        contype=0, conaffinity=0,
    )  # fmt: skip


def _move(spec: mujoco.MjSpec, geom: mujoco.MjsGeom, name: str) -> None:
    """Give a geom of the worldbody a mocap body where it stands."""
    body = spec.worldbody.add_body(name=PREFIX + name, mocap=True)
    own = body.add_geom()
    for attribute in _KEPT:
        setattr(own, attribute, getattr(geom, attribute))
    for way in _WAYS:
        setattr(own.alt, way, getattr(geom.alt, way))
    spec.delete(geom)
    own.name = name
    if own.fromto[0] == own.fromto[0]:  # not a number where the ends are not told
        body.pos = [(a + b) / 2 for a, b in zip(own.fromto[:3], own.fromto[3:], strict=True)]
        own.fromto = [v - c for v, c in zip(own.fromto, [*body.pos, *body.pos], strict=True)]
    else:
        body.pos, own.pos = own.pos, [0.0, 0.0, 0.0]
