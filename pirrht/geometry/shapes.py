"""Compute distances from boxes, cylinders, spheres, capsules, ellipsoids and convex meshes.

FCL computes most of these numbers one at a time, through four Python calls; a clearance field needs a million. Its
distances are hollow inside of meshes and too great by up to millimetres from ellipsoids.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.geometry.scene import Kind, Obstacle
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import as_tuple, borrowing, inlined, kernel, part

PROBE = TUNING.probe
FORMS = (Kind.BOX, Kind.CYLINDER, Kind.SPHERE, Kind.CAPSULE, Kind.ELLIPSOID)


class Solids(NamedTuple):
    """M obstacles as arrays, and the F triangles of their meshes."""

    form: NDArray[np.int64]  # (M,) index in FORMS, -1 for a mesh
    size: Array  # (M, 3) MuJoCo's sizes [m]
    position: Array  # (M, 3) centres [m]
    rotation: Array  # (M, 3, 3) body axes in world coordinates, as columns
    low: Array  # (M, 3) boxes around them [m]
    high: Array  # (M, 3) [m]
    face: NDArray[np.int64]  # (M + 1,) where the triangles of each begin
    corner: Array  # (F, 3, 3) corners of triangles, counter-clockwise from outside [m]
    normal: Array  # (F, 3) their unit normals

    @classmethod
    def of(cls, obstacles: Sequence[Obstacle]) -> "Solids":
        """Gather M obstacles into arrays (M, ...) [m]."""
        M = len(obstacles)
        boxes = np.array([_box(o) for o in obstacles]).reshape(M, 2, 3)
        hulls = [np.zeros((0, 3, 3))] * (M + 1)
        for i, o in enumerate(obstacles):
            if o.kind is Kind.MESH:
                vertices, faces = hull_of(o)
                hulls[i + 1] = (vertices @ o.rotation.T + o.position)[faces]
        corner = np.concatenate(hulls)
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        return cls(
            np.array([FORMS.index(o.kind) if o.kind in FORMS else -1 for o in obstacles], dtype=np.int64),
            np.array([o.size for o in obstacles], dtype=float).reshape(M, 3),
            np.array([o.position for o in obstacles], dtype=float).reshape(M, 3),
            np.array([o.rotation for o in obstacles], dtype=float).reshape(M, 3, 3),
            np.ascontiguousarray(boxes[:, 0]),
            np.ascontiguousarray(boxes[:, 1]),
            np.cumsum([len(hull) for hull in hulls]),
            corner,
            normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300),
        )


def hull_of(obstacle: Obstacle) -> tuple[Array, IntArray]:
    """Return corners (k, 3) [m] and triangles (l, 3) of a mesh in its own frame, counter-clockwise from outside."""
    assert obstacle.vertices is not None
    assert obstacle.faces is not None
    vertices = np.ascontiguousarray(obstacle.vertices, dtype=float)
    faces = np.array(obstacle.faces, dtype=np.int64)
    a, b, c = vertices[faces].swapaxes(0, 1)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), a - vertices.mean(axis=0)) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces


def _box(obstacle: Obstacle) -> tuple[Array, Array]:
    """Return corners of a box along the axes that contains the solid, 2 x (3,) [m]."""
    a, b, c = (float(s) for s in obstacle.size)
    if obstacle.kind is Kind.MESH:
        assert obstacle.vertices is not None
        low = obstacle.vertices.min(axis=0)
        high = obstacle.vertices.max(axis=0)
    else:
        extents = {Kind.CYLINDER: (a, a, b), Kind.SPHERE: (a, a, a), Kind.CAPSULE: (a, a, a + b)}
        high = np.array(extents.get(obstacle.kind, (a, b, c)))
        low = -high
    middle = obstacle.position + obstacle.rotation @ (0.5 * (low + high))
    extent = np.abs(obstacle.rotation) @ (0.5 * (high - low)) + PROBE
    return middle - extent, middle + extent


@inlined
def outside(form, a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance from a solid to a point in its own frame, at most 0 inside [m]."""
    if form == 0:
        x = max(abs(x) - a, 0.0)
        y = max(abs(y) - b, 0.0)
        z = max(abs(z) - c, 0.0)

        return math.sqrt(x * x + y * y + z * z)
    if form == 1:
        r = max(math.sqrt(x * x + y * y) - a, 0.0)
        h = max(abs(z) - b, 0.0)

        return math.sqrt(r * r + h * h)
    if form == 4:
        ex, ey, ez = _off_ellipsoid(a, b, c, x, y, z)
        return math.sqrt(ex * ex + ey * ey + ez * ez)
    if form == 3:
        z = max(abs(z) - b, 0.0)
    return math.sqrt(x * x + y * y + z * z) - a


@kernel
def _off_ellipsoid(a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return the vector from an ellipsoid's nearest point, in its frame, zero inside [m], by Newton's method."""
    t = max(max(a * (abs(x) - a), b * (abs(y) - b)), max(c * (abs(z) - c), 0.0))
    while True:
        p = a * a + t
        q = b * b + t
        r = c * c + t

        fx = (a * x / p) ** 2
        fy = (b * y / q) ** 2
        fz = (c * z / r) ** 2

        step = 0.5 * (fx + fy + fz - 1.0) / (fx / p + fy / q + fz / r + 1e-300)
        if not step > 1e-15 * p:
            return t * x / p, t * y / q, t * z / r
        t += step


@borrowing
def _off_hull(solids, m, x, y, z):  # type: ignore[no-untyped-def]
    """Return the vector from the nearest point of mesh m to a point (x, y, z), zero inside [m].

    It lies on a triangle that is seen from there; the distance of a triangle's plane is less than that of the triangle.
    """
    best, near = math.inf, (0.0, 0.0, 0.0)
    for f in range(solids.face[m], solids.face[m + 1]):
        corner = solids.corner[f]
        nx, ny, nz = as_tuple(solids.normal[f], 3)
        height = nx * (x - corner[0, 0]) + ny * (y - corner[0, 1]) + nz * (z - corner[0, 2])
        if height <= 0.0 or height >= best:
            continue
        above = True
        for k in range(3):
            a = corner[k]
            b = corner[(k + 1) % 3]

            ex = b[0] - a[0]
            ey = b[1] - a[1]
            ez = b[2] - a[2]

            wx = x - a[0]
            wy = y - a[1]
            wz = z - a[2]

            if nx * (ey * wz - ez * wy) + ny * (ez * wx - ex * wz) + nz * (ex * wy - ey * wx) < 0.0:
                above = False
                s = min(max((ex * wx + ey * wy + ez * wz) / (ex * ex + ey * ey + ez * ez), 0.0), 1.0)
                wx = wx - s * ex
                wy = wy - s * ey
                wz = wz - s * ez
                d = math.sqrt(wx * wx + wy * wy + wz * wz)
                if d < best:
                    best, near = d, (wx, wy, wz)
        if above:
            best, near = height, (height * nx, height * ny, height * nz)
    return near


@part
def _in_frame(solids, m, x, y, z):  # type: ignore[no-untyped-def]
    """Return a point (x, y, z) in solid m's own frame [m]."""
    dx = x - solids.position[m, 0]
    dy = y - solids.position[m, 1]
    dz = z - solids.position[m, 2]

    R = solids.rotation[m]
    return (
        R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz,
        R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz,
        R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz,
    )


@borrowing
def distance_from(solids, m, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance from solid m of `Solids` to a point (x, y, z) [m]; 0 inside."""
    if solids.form[m] < 0:
        ex, ey, ez = _off_hull(solids, m, x, y, z)
        return math.sqrt(ex * ex + ey * ey + ez * ez)
    size = solids.size[m]
    x, y, z = _in_frame(solids, m, x, y, z)
    return max(outside(solids.form[m], size[0], size[1], size[2], x, y, z), 0.0)


@kernel
def distances(solids, members, points, height, out):  # type: ignore[no-untyped-def]
    """Write distances from the nearest of the members to points, out (k,) [m]; 0 inside.

    Points (k, 2) are at a height, those in space (k, 3) have their own [m].
    """
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        z = height if points.shape[1] == 2 else points[i, 2]
        best = math.inf
        for m in members:
            if square_to(solids.low, solids.high, m, x, y) < best * best:
                best = min(best, distance_from(solids, m, x, y, z))
        out[i] = best if best > PROBE else 0.0


@part
def square_to(low, high, m, x, y):  # type: ignore[no-untyped-def]
    """Return the square of the distance from (x, y) to the box around a solid seen from above [m^2]."""
    dx = max(max(low[m, 0] - x, x - high[m, 0]), 0.0)
    dy = max(max(low[m, 1] - y, y - high[m, 1]), 0.0)

    return dx * dx + dy * dy


@inlined
def offset_of(form, a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return the vector from a solid's nearest point to a point outside, in the solid's own frame [m]."""
    if form == 0:
        return x - min(max(x, -a), a), y - min(max(y, -b), b), z - min(max(z, -c), c)
    if form == 1:
        r = math.sqrt(x * x + y * y)
        share = 1.0 - a / r if r > a else 0.0
        return share * x, share * y, z - min(max(z, -b), b)
    if form == 4:
        return _off_ellipsoid(a, b, c, x, y, z)
    if form == 3:
        z = z - min(max(z, -b), b)
    share = 1.0 - a / math.sqrt(x * x + y * y + z * z)
    return share * x, share * y, share * z


@borrowing
def offset_from(solids, m, x, y, z):  # type: ignore[no-untyped-def]
    """Return the vector from solid m's nearest point to a point (x, y, z) outside [m]."""
    if solids.form[m] < 0:
        return _off_hull(solids, m, x, y, z)
    size = solids.size[m]
    R = solids.rotation[m]
    x, y, z = _in_frame(solids, m, x, y, z)
    ex, ey, ez = offset_of(solids.form[m], size[0], size[1], size[2], x, y, z)
    return (
        R[0, 0] * ex + R[0, 1] * ey + R[0, 2] * ez,
        R[1, 0] * ex + R[1, 1] * ey + R[1, 2] * ez,
        R[2, 0] * ex + R[2, 1] * ey + R[2, 2] * ez,
    )
