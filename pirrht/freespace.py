"""Examine a scene for planner and sampler: free space, and obstacles to wind around."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.ball import Ball
from pirrht.geometry.blocks import build_field
from pirrht.geometry.checks import checked_state
from pirrht.geometry.collision import Collision
from pirrht.geometry.disc import Disc
from pirrht.geometry.fitting import fitted, margin_left
from pirrht.geometry.hulls import HullCollision
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.passages import NO_PASSAGES, Passages, find_passages
from pirrht.geometry.polygon import Polygon
from pirrht.geometry.scene import Goal, Scene
from pirrht.geometry.space import BLOCKED, FREE, UNSURE, Space, at_states
from pirrht.geometry.tuning import TUNING
from pirrht.geometry.world import Moving, NoMoving, World
from pirrht.moving.in_space import MovingSolids
from pirrht.moving.obstacles import MovingObstacleArrays
from pirrht.topology.choice import continued_in, obstacles_of, signature_of
from pirrht.topology.obstacles import Component
from pirrht.topology.signature import Signature


class Member(NamedTuple):
    """A kind of robots."""

    collision: type[Collision]  # exact distances of (world, footprint)
    # Clearances of the inscribed disc or ball from obstacles that count, and those of the robot; of a grain [m].
    fields: Callable[[Scene, Collision, Sequence[int], float | None], tuple[Any, Space]]


def _disc(scene: Scene, collision: Collision, members: Sequence[int], grain: float | None) -> tuple[Disc, Disc]:
    cells = {} if grain is None else {"cells": max(TUNING.cells_per_disc, collision.least_radius / grain)}
    disc = Disc.over(build_field(collision, members, **cells))
    return disc, disc


def _polygon(scene: Scene, collision: Collision, members: Sequence[int], grain: float | None) -> tuple[Disc, Polygon]:
    if grain is None:
        return _disc(scene, collision, members, None)[0], Polygon.of(scene.world, scene.footprint, members)
    polygon = Polygon.of(scene.world, scene.footprint, members, grain)
    return Disc.over(polygon.inscribed()), polygon


def _ball(scene: Scene, collision: Collision, members: Sequence[int], grain: float | None) -> tuple[Ball, Ball]:
    ball = Ball.of(collision, members)
    return ball, ball


MEMBERS = {
    "disc": Member(Collision, _disc), "polygon": Member(HullCollision, _polygon), "ball": Member(Collision, _ball),
}  # fmt: skip


def _member(scene: Scene) -> Member:
    return MEMBERS["ball" if scene.dimension == 3 else scene.footprint.kind]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeSpace:
    """A scene together with its collision checker, clearance field and topological obstacles.

    Only `scene` and `homology` depend on its task. `FreeSpace.of(scene)` takes a second or so; `with_task` is quick.
    """

    scene: Scene
    collision: Collision
    field: Any  # clearances of the inscribed disc, a `Field`, or of a ball
    obstacles: tuple[Component, ...]  # the M components that can be encircled, in the order of all signatures
    homology: Signature  # about static and moving obstacles, with bases at 1 m/s
    static: Space  # where the footprint is free of static obstacles and border
    moving: Moving  # J moving obstacles, of which field and collision know nothing
    # Of a map that a robot makes: clearances may be too low by about so much, and FCL is not asked where they do not
    # tell [m]. None: the scene is known.
    grain: float | None = None

    def __repr__(self) -> str:
        return f"FreeSpace({formatting.name(self.scene.name)}: {len(self.obstacles)} to wind around)"

    @classmethod
    def of(cls, scene: Scene, grain: float | None = None) -> FreeSpace:
        """Examine a scene; the markers of its encircled obstacles, (M, d) [m], become those of `homology`.

        A coarse `grain` [m] makes it quick, for a map that changes all the time. None: as exact as a known scene is.
        SceneError: the start or all of the goal is in collision, or the workspace is too large for the robot.
        """
        scene, collision = _checked(replace(scene, waivers=scene.narrow))
        parts = obstacles_of(collision)
        encircled = tuple(part for part in parts if part.marker is not None)
        return cls._of(scene, collision, parts, encircled, grain=grain)

    def updated(self, scene: Scene) -> FreeSpace:
        """Examine a scene with the same goal and other obstacles, so that classes keep their names.

        Each obstacle keeps its number, its place in (M,) turns, while its marker is covered; new ones come last, or
        where one had gone before. The start may be covered: the robot is under way. SceneError as of `of` otherwise.
        """
        scene, collision = _checked(scene, start_counts=False)
        named = len(self.homology.markers) if self.homology.named is None else self.homology.named
        parts = obstacles_of(collision)
        encircled, moved = continued_in(parts, self.obstacles, collision, named, self.collision)
        return self._of(scene, collision, parts, encircled, named, self.grain, moved)

    @classmethod
    def _of(
        cls, scene: Scene, collision: Collision, parts: Sequence[Component], encircled: tuple[Component, ...],
        named: int | None = None, grain: float | None = None, moved: tuple[int, ...] = (),
    ) -> FreeSpace:  # fmt: skip
        try:
            members = sorted({i for part in parts for i in part.members})
            field, static = _member(scene).fields(scene, collision, members, grain)
        except SceneError as error:
            raise SceneError(f"{scene.name}: {error}") from None
        homology = signature_of(scene, encircled, named, moved)

        return cls(
            scene=scene, collision=collision, field=field, obstacles=encircled, homology=homology,
            static=static, moving=moving_of(scene), grain=grain,
        )  # fmt: skip

    def with_task(self, *, start: Array | None = None, goal: Goal | None = None) -> FreeSpace:
        """Return the space with another start (3,) [m, m, rad] or goal; nothing is sampled again.

        Only where a start or goal has less than the safety margin around it is the scene examined again. SceneError:
        one of them lies outside the workspace or is in collision.
        """
        scene = self.scene
        scene = replace(scene, start=scene.start if start is None else start, goal=scene.goal if goal is None else goal)
        if self.scene.waivers != scene.narrow or (scene := fitted(scene, self.collision)).waivers != scene.narrow:
            return FreeSpace.of(scene, self.grain)
        return replace(self, scene=scene, homology=self.homology.with_goal(scene.goal.center.astype(float)))

    def refuse_start(self, x: Array) -> None:
        """Refuse a state x (n,) where no run can begin: outside the workspace, or in collision (SceneError)."""
        fitted(replace(self.scene, start=np.append(x[: self.scene.dimension], 0.0)[:3]), self.collision)

    def with_movers(self, movers: Sequence[Mover], moving: Moving | None = None) -> FreeSpace:
        """Return the static world and task among other moving obstacles, whose arrays may be given."""
        scene = replace(self.scene, movers=tuple(movers))
        homology = self.homology.with_moving(scene.movers, scene.footprint)
        return replace(self, scene=scene, homology=homology, moving=moving_of(scene) if moving is None else moving)

    def with_blockers(self, movers: Sequence[Mover]) -> FreeSpace:
        """Return the static world and its classes among obstacles that move and make none."""
        scene = replace(self.scene, movers=tuple(movers))
        return replace(self, scene=scene, moving=moving_of(scene))

    def with_prediction(self, movers: Sequence[Mover]) -> FreeSpace:
        """Return the space with predicted motions of its movers; one thread at a time may query both of them."""
        return self.with_movers(movers, self.moving.with_motions(movers))

    @property
    def world(self) -> World:
        """Take the snapshot of what is free at (x, t), lengths in [m]."""
        return World.of(self.static, self.scene.goal, self.moving)

    def free(self, x: Array, reads: tuple[int, ...] | None = None) -> bool:
        """Return whether the robot may be at a state x (n,), whose position, and heading if known, lie at indices.

        None: the position comes first, and there is no heading.
        """
        reads = reads or tuple(range(self.scene.dimension))
        status = at_states(self.static.kernels, reads).certify(self.static, x)
        asks = status == UNSURE and self.grain is None
        return bool(status == FREE or (asks and self.collision.free(x[None, list(reads)])[0]))

    def segments_free(self, points: Array) -> bool:
        """Return whether the line through points (k, d) [m], headed along it, is free; FCL judges what is in doubt."""
        piece = self.static.kernels.certify_piece
        tails = points[:-1]
        heads = points[1:]
        ends = zip(tails.tolist(), heads.tolist(), strict=True)
        verdicts = np.array([piece(self.static, tuple(a), tuple(b), True) for a, b in ends], dtype=int)
        unsure = verdicts == UNSURE
        if self.grain is not None:
            return bool(np.all(verdicts == FREE))
        return bool(np.all(verdicts != BLOCKED) and np.all(self.collision.segments_free(tails[unsure], heads[unsure])))

    def in_goal(self, x: Array) -> bool:
        """Return whether the position (d,) [m] of a state x (n,) lies in the goal."""
        return bool(self.scene.goal.contains(x[: self.scene.dimension]))

    def passages(self) -> Passages:
        """Find the places where obstacles face each other with clearance for the robot between; none in space."""
        return find_passages(self.field, self.collision) if self.scene.dimension == 2 else NO_PASSAGES

    def margin_left(self, x: Array) -> float | None:
        """Return a margin [m] that leaves a path from a state x (n,) to the goal, 0 for none, where this one does not.

        None: this one does, or a grid cannot tell. Only static obstacles count.
        """
        return margin_left(self.scene, self.collision, x[: self.scene.dimension])

    def clearance(self, x: Array) -> float:
        """Return the exact clearance at a state or pose x: x, y [m] and, for a polygon, the heading [rad]; in [m]."""
        count = self.static.kernels.position + self.static.kernels.turns
        pose = checked_state(x[:count], count, f"a robot in {formatting.name(self.scene.name)}")
        return float(self.collision.clearance(pose[None])[0])


def collision_of(scene: Scene) -> Collision:
    """Make the collision checker of a scene's robot: a disc, a polygon that turns with the heading, or a ball."""
    return _member(scene).collision(scene.world, scene.footprint)


def moving_of(scene: Scene) -> Moving:
    """Gather the moving obstacles of a scene; in a static one, none."""
    if not scene.movers:
        return NoMoving()
    return MovingSolids.of(scene) if scene.dimension == 3 else MovingObstacleArrays.of(scene)


def _checked(scene: Scene, *, start_counts: bool = True) -> tuple[Scene, Collision]:
    """Return a scene with waivers of the safety margin where it needs them, and its collision checker."""
    collision = collision_of(scene)
    scene = fitted(scene, collision, start_counts=start_counts)
    scene = collision.fitted(scene) if start_counts else scene
    return scene, collision_of(scene) if scene.waivers else collision
