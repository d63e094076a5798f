"""What a robot with a lidar knows of a scene when it starts: its first scan."""

from dataclasses import replace

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.mapping.believed import Believed
from pirrht.mapping.occupancy import OccupancyMap
from sim.drive.executor import Executor
from sim.scenario.scenario import Scenario


def first_seen(scenario: Scenario, at: Array | None = None) -> tuple[Scenario, Believed | None]:
    """Return a scenario among what the first scan shows, from its start or another state (n,), and what that is.

    A scene that is known stays as it is, and nothing is believed. SceneError: the map covers all of the goal.
    """
    if scenario.settings.sense == "map":
        return scenario, None
    plant = scenario.plant()
    assert isinstance(plant, Executor)
    assert plant.senses is not None
    if at is not None:
        plant.reset(at)

    known = scenario.problem.scene
    grid = OccupancyMap(known.lower, known.upper, cell=scenario.settings.cell)
    *_, scan = plant.senses.take()
    grid.integrate(scan, free_around=known.footprint.inscribed)

    problem = scenario.system.problem(grid.scene(known), scenario.settings)
    space = FreeSpace.of(problem.scene, scenario.space.grain)
    now = replace(scenario, problem=problem, space=space, spare=[], collision=None)
    return now, Believed.of(grid, scan, plant.senses.error)
