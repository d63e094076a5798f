"""Fit a scene's start and goal to its walls: less safety margin, or a smaller goal disc, where they have no clearance.

The planning radius is kept wherever the start allows it. Around a start inside the safety margin a disc is laid
(`Waiver`), in which a smaller planning radius counts, large enough that a path leads out of the margin. Clearance is
then the maximum of two 1-Lipschitz functions, so every certificate that rests on it still holds: of the usual one, and
of the minimum of the clearance with the smaller radius and the distance to the rim of that disc.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array, BoolArray
from pirrht.errors import SceneError
from pirrht.geometry.blocks import lattice
from pirrht.geometry.collision import SHORTEST, Collision
from pirrht.geometry.scene import ROUNDING, Goal, Scene, Waiver
from pirrht.geometry.tuning import TUNING


def fitted(scene: Scene, collision: Collision, *, start_counts: bool = True) -> Scene:
    """Return the scene with a start and a goal point that are free, unchanged if they already are.

    `collision` is of its world and footprint, without waivers at what is fitted. Unless the `start_counts`, waivers are
    kept. SceneError: the robot without its margin touches an obstacle at the start, or everywhere in the goal disc.
    """
    start, goal, body = scene.place, scene.goal, scene.body.radius
    waivers = [*scene.narrow] if start_counts else [*scene.waivers]
    if start_counts and float(collision.distance(start[None])[0]) < scene.robot_radius + SHORTEST:
        if (distance := float(collision.true_distance(start[None])[0])) < body - ROUNDING:
            away = [float(collision.obstacle_distance(i, start[None])[0]) for i in range(len(scene.obstacles))]
            lacks = f'{body - distance:.3g} m to "{scene.obstacles[int(np.argmin(away))].name}"'
            raise SceneError(_in_collision(scene, "start", start, f" (it lacks {lacks})"))
        waivers.append(_waiver(scene, collision, start, "start"))
    if float(collision.clearance(goal.center[None])[0]) <= 0.0:
        wide, part = (_free_part(scene, collision, radius) for radius in (scene.robot_radius, body))
        if part is None:
            raise SceneError(_in_collision(scene, "goal", goal.center, ", as everywhere in its disc"))
        goal = part if wide is None or wide.radius < TUNING.similar * part.radius else wide
        if collision.distance(goal.center[None])[0] < scene.robot_radius:
            waivers.append(_waiver(scene, collision, goal.center, "goal"))
    changed = goal is not scene.goal or len(waivers) > len(scene.waivers)
    return replace(scene, goal=goal, waivers=tuple(waivers)) if changed else scene


def _in_collision(scene: Scene, what: str, point: Array, more: str) -> str:
    where, body = f"{scene.name}: the {what} {formatting.exact(point)}", scene.body.radius
    return f"{where} is in collision for a robot of radius {body:g}{more}; move it or choose a smaller robot radius"


def _waiver(scene: Scene, collision: Collision, point: Array, what: str) -> Waiver:
    """Return the disc around a point (2,) [m] in which less margin counts; the largest one if no path leads out.

    SceneError: none does since an obstacle is under or over the robot wherever it goes; or it is a point in space.
    """
    if scene.dimension == 3:
        raise SceneError(_in_collision(scene, what, point, f" and a margin of {scene.margin:g}"))
    body = scene.body.radius
    clearance = float(collision.true_distance(point[None])[0]) - body
    radii = [body + min(share * clearance, clearance - SHORTEST) for share in (0.5, 0.25, 0.0)]  # kept of the clearance
    discs = [2.0 * (scene.margin - clearance) + TUNING.turning_reach * body]
    while discs[-1] < TUNING.max_reach * body:
        discs.append(2.0 * discs[-1])
    for radius, disc in product(radii, discs[:-1]):
        if _leads_out(collision, point, radius, disc):
            return Waiver(float(point[0]), float(point[1]), disc, scene.robot_radius - radius)
    _refuse_beneath(scene, collision, point)
    return Waiver(float(point[0]), float(point[1]), discs[-1], scene.robot_radius - radii[-1])


def _refuse_beneath(scene: Scene, collision: Collision, point: Array) -> None:
    """Refuse an obstacle under or over a point (2,) [m]: no direction leads away from it, as from a floor."""
    walls = collision.nearest_walls(point[None], range(len(scene.obstacles)), scene.robot_radius)
    if walls.which[0] >= 0 and not walls.away[0].any():
        name = scene.obstacles[walls.which[0]].name
        raise SceneError(
            f'{scene.name}: obstacle "{name}" lies under or over the robot at ({point[0]:g}, {point[1]:g}) and all '
            f"around, {walls.first[0]:.3g} m from its centre at a height of {scene.robot_height:g} m; the robot keeps "
            f"{scene.robot_radius:g} m: remove it if it is a floor, or choose a smaller robot radius or margin"
        )


def _leads_out(collision: Collision, point: Array, radius: float, disc: float) -> bool:
    """Return whether a lattice path leads from a point (2,) [m] out of the margin, inside a disc of a radius [m]."""
    from scipy.ndimage import label  # SciPy takes a tenth of a second to import, and few scenes need it

    cell, full = min(disc / 8.0, radius / 3.0), collision.footprint.radius
    count = int(np.ceil(disc / cell))
    places = point + cell * (lattice(2 * count + 1, 2 * count + 1) - count)
    away = np.hypot(*np.moveaxis(places - point, -1, 0))
    distance = collision.nearest_walls(
        places.reshape(-1, 2), range(len(collision.world.obstacles)), full + 2.0 * cell
    ).first.reshape(away.shape)
    inside = np.all((places > collision.world.lower) & (places < collision.world.upper), axis=-1)
    free = (away < disc) & (distance > radius) & inside
    free[count, count] = True
    pieces, _ = label(free)
    return bool(np.any((pieces == pieces[count, count]) & (distance > full + cell) & (away < TUNING.exit_share * disc)))


def _free_part(scene: Scene, collision: Collision, radius: float) -> Goal | None:
    """Return the largest disc inside the goal's that is centred where a robot radius [m] is free, None if none is."""
    from scipy.ndimage import label, maximum

    goal, count = scene.goal, TUNING.goal_lattice
    cell = goal.radius / count
    places = goal.center + cell * (lattice(*[2 * count + 1] * scene.dimension) - count)
    to_rim = goal.radius - np.hypot.reduce(places - goal.center, axis=-1)
    to_border = np.minimum(places - scene.lower, scene.upper - places).min(axis=-1)
    clearance = np.minimum(
        np.minimum(to_rim, to_border),
        collision.distance(places.reshape(-1, scene.dimension)).reshape(to_rim.shape) - radius,
    )
    pieces, found = label(clearance > SHORTEST)
    if not found:
        return None
    greatest = np.append(-np.inf, maximum(clearance, pieces, np.arange(1, found + 1)))[pieces]
    inside = (clearance >= TUNING.similar * greatest) & (greatest >= TUNING.similar * greatest.max())
    centers = places[inside]
    away = np.rint((goal.radius - to_rim[inside]) / cell)
    center = centers[np.lexsort((np.hypot.reduce(centers - scene.place, axis=-1), away))[0]]
    return Goal(center=center, radius=goal.radius - float(np.hypot.reduce(center - goal.center)))


def margin_left(scene: Scene, collision: Collision, start: Array) -> float | None:
    """Return a margin [m] that leaves a path from a point (d,) [m] to the goal, 0 for none, where this one does not.

    None: this one does, or a grid cannot tell. Only static obstacles count.
    """
    from scipy.ndimage import label

    span = (scene.upper - scene.lower).astype(float)
    spacing = float(np.prod(span) / TUNING.path_points) ** (1.0 / scene.dimension)
    shape = tuple(np.ceil(span / spacing).astype(int))
    points = (scene.lower + spacing * lattice(*shape)).reshape(-1, scene.dimension)
    begin = np.hypot.reduce(points - start, axis=-1) <= spacing
    goal = np.hypot.reduce(points - scene.goal.center, axis=-1) <= max(scene.goal.radius, spacing)

    def leads(passable: BoolArray) -> bool:
        pieces = label(passable.reshape(shape))[0].ravel()
        return bool(np.intersect1d(pieces[begin], pieces[goal]).any())  # piece 0 is blocked

    if leads(collision.clearance(points) > -spacing):
        return None
    free = collision.true_distance(points) - scene.body.radius - spacing  # between the points as well
    lowest, highest = 0.0, scene.margin
    for _ in range(TUNING.path_halvings):
        middle = 0.5 * (lowest + highest)
        lowest, highest = (middle, highest) if leads(free > middle) else (lowest, middle)
    return lowest
