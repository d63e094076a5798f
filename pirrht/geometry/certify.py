"""Certify that planar curves are free, by the clearance of poses along them.

Clearance is 1-Lipschitz in the position, and in the heading with the footprint's reach: along a curve it changes by at
most 1 + reach |curvature| per meter. So a stretch of a pose's clearance over that is free. A march from stretch to
stretch, each begun where the last one ended, certifies what it covers (paper, `ObstacleFree`).
"""

import math
from functools import cache
from typing import Any, NamedTuple

from pirrht.geometry.arcs import point_along
from pirrht.geometry.space import BLOCKED, FREE, LEAST_STEP, UNSURE
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import inlined, kernel


class Certificates(NamedTuple):
    """Kernels of `SpaceKernels` that certify."""

    certify: Any
    piece: Any
    curve: Any
    turn: Any  # on the spot, of poses with a heading


@cache
def certificates(clearance: Any, refused: Any, turns: bool) -> Certificates:
    """Build the certificates of a member by its clearance.

    Args:
        clearance: kernel (static, pose).
        refused: kernel (static, pose) that returns BLOCKED or UNSURE for a pose that is not certified.
        turns: whether poses have a heading; then `static.reach` [m] is how far from the centre the footprint goes.
    """

    @inlined
    def headed(x, y, theta):  # type: ignore[no-untyped-def]
        return x, y, theta

    @inlined
    def bare(x, y, theta):  # type: ignore[no-untyped-def]
        return x, y

    @inlined
    def turned_pace(static, speed, rate):  # type: ignore[no-untyped-def]
        return 1.0 / (speed + static.reach * abs(rate))

    @inlined
    def pace(static, speed, rate):  # type: ignore[no-untyped-def]
        return 1.0

    pose_of, pace_of = (headed, turned_pace) if turns else (bare, pace)
    stride = TUNING.stride if turns else 1.0

    @inlined
    def covered(static, x, y, theta, ux, uy, rate, length, patient, speed=1.0):  # type: ignore[no-untyped-def]
        """Judge a piece that sets out along (ux, uy) at a heading, or without `speed` turns there at a rate.

        Certified stretches must cover it: to either side of a pose, each of which is tried some way ahead of the last.
        """
        s, reached, verdict, per = 0.0, 0.0, FREE, pace_of(static, speed, rate)
        while True:
            px, py = point_along(x, y, theta, ux, uy, rate, s) if speed > 0.0 else (x, y)
            pose = pose_of(px, py, theta + rate * s)
            c = clearance(static, pose)
            if s > reached and s - per * c > reached:
                s = reached
                continue
            if c < LEAST_STEP:
                if refused(static, pose) == BLOCKED:
                    return BLOCKED
                if not patient:
                    return UNSURE
                verdict, c = UNSURE, 0.5 * static.spacing
            if s >= length:
                return verdict
            reached = min(s + per * c, length)
            s = min(s + stride * per * c, length)

    @kernel
    def certify(static, pose):  # type: ignore[no-untyped-def]
        return FREE if clearance(static, pose) > 0.0 else refused(static, pose)

    @kernel
    def piece(static, tail, head, patient=True):  # type: ignore[no-untyped-def]
        dx = head[0] - tail[0]
        dy = head[1] - tail[1]
        length = math.sqrt(dx**2 + dy**2)
        per = 1.0 / length if length > 0.0 else 0.0
        theta = math.atan2(dy, dx) if turns else 0.0
        return covered(static, tail[0], tail[1], theta, per * dx, per * dy, 0.0, length, patient)

    @kernel
    def curve(static, start, curvature, length, patient=True):  # type: ignore[no-untyped-def]
        x, y = start[0], start[1]
        theta = start[2]
        verdict = FREE
        for p in range(length.shape[0]):
            ux, uy = math.cos(theta), math.sin(theta)
            found = covered(static, x, y, theta, ux, uy, curvature[p], length[p], patient)
            if found == BLOCKED or (found == UNSURE and not patient):
                return found
            verdict = min(verdict, found)
            x, y = point_along(x, y, theta, ux, uy, curvature[p], length[p])
            theta += curvature[p] * length[p]
        return verdict

    @kernel
    def turn(static, pose, angle, patient=True):  # type: ignore[no-untyped-def]
        rate = math.copysign(1.0, angle)
        return covered(static, pose[0], pose[1], pose[2], 0.0, 0.0, rate, abs(angle), patient, 0.0)

    return Certificates(certify, piece, curve, turn)
