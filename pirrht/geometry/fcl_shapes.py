"""Build obstacles and robots as objects of FCL."""

from __future__ import annotations

from typing import Any

import fcl
import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.scene import Kind, Obstacle


def ball(center: Array, radius: float) -> Any:
    """Return a sphere about center (3,) of a radius [m]."""
    return fcl.CollisionObject(fcl.Sphere(radius), fcl.Transform(center))


def capsule(radius: float, middle: Array, span: Array) -> Any:
    """Return the capsule that a sphere of a radius [m] sweeps along span (2,) [m] about `middle` (3,) [m]."""
    length = float(np.hypot(span[0], span[1]))
    if length < 1e-9:
        return ball(middle, radius)
    c, s = span[0] / length, span[1] / length
    along_z = np.array([[-s, 0.0, c], [c, 0.0, s], [0.0, 1.0, 0.0]])  # the capsule's own axis is z
    return fcl.CollisionObject(fcl.Capsule(radius, length), fcl.Transform(along_z, middle))


def tree_of(objects: list[Any]) -> Any:
    """Return a tree of bounding boxes around k objects of FCL, which answers for all of them at once."""
    manager = fcl.DynamicAABBTreeCollisionManager()
    manager.registerObjects(objects)
    manager.setup()
    return manager


def _pose(obstacle: Obstacle) -> Any:
    return fcl.Transform(np.asarray(obstacle.rotation, dtype=float), np.asarray(obstacle.position, dtype=float))


def solid_of(obstacle: Obstacle) -> Any:
    """Return an obstacle as a convex solid in world coordinates [m]; `collide` is right for it."""
    a, b, c = (float(s) for s in obstacle.size)
    match obstacle.kind:
        case Kind.BOX:
            shape = fcl.Box(2 * a, 2 * b, 2 * c)
        case Kind.CYLINDER:
            shape = fcl.Cylinder(a, 2 * b)
        case Kind.SPHERE:
            shape = fcl.Sphere(a)
        case Kind.CAPSULE:
            shape = fcl.Capsule(a, 2 * b)
        case Kind.ELLIPSOID:
            shape = fcl.Ellipsoid(a, b, c)
        case Kind.MESH:
            vertices, faces = _hull(obstacle)
            counted = np.hstack([np.full((len(faces), 1), 3), faces])
            shape = fcl.Convex(vertices, len(faces), counted.ravel())
    return fcl.CollisionObject(shape, _pose(obstacle))


def shell_of(obstacle: Obstacle) -> Any:
    """Return the surface of a mesh of corners (k, 3) [m] and triangles (l, 3), from which distances are right."""
    vertices, faces = _hull(obstacle)
    shape = fcl.BVHModel()
    shape.beginModel(len(vertices), len(faces))
    shape.addSubModel(vertices, faces)
    shape.endModel()
    return fcl.CollisionObject(shape, _pose(obstacle))


def _hull(obstacle: Obstacle) -> tuple[Array, IntArray]:
    """Return corners and triangles of a mesh, seen counter-clockwise from outside."""
    assert obstacle.vertices is not None
    assert obstacle.faces is not None
    vertices = np.ascontiguousarray(obstacle.vertices, dtype=float)
    faces = np.array(obstacle.faces, dtype=np.int64)
    a, b, c = vertices[faces].swapaxes(0, 1)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), a - vertices.mean(axis=0)) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces
