"""A plan in a small room, so that whatever must be compiled or loaded is before any clock runs."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from pirrht.control.settings import TREELESS
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene
from sim.drive import episode
from sim.drive.executor import Plant
from sim.scenario import Scenario

VERTICES, SAMPLES, PERIODS = 30, 20, 2
BOX = Obstacle(
    name="box", kind=Kind.BOX, size=np.full(3, 0.3), position=np.array([2.0, 2.6, 0.3]), rotation=np.eye(3)
)  # fmt: skip
ROOM = Scene(
    name="rehearsal", lower=np.zeros(2), upper=np.full(2, 4.0), robot_radius=0.2, start=np.array([0.7, 2.0, 0.0]),
    obstacles=(BOX,), goal=Goal(center=np.array([3.3, 2.0]), radius=0.3),
)  # fmt: skip
DISC = replace(BOX, kind=Kind.CYLINDER, size=np.array([0.2, 0.3, 0.0]), position=np.array([0.0, 0.0, 0.3]))
WALKER = Mover(
    name="walker", solids=(DISC,), motion=Motion(rows=np.array([[0.0, 2.0, 0.5, 0.0], [3.0, 2.0, 1.6, 0.0]]))
)  # fmt: skip


def small_of(scenario: Scenario) -> Scenario:
    """Put the robot into a small room under its settings; an obstacle moves there if some do in the scene."""
    room, s = replace(ROOM, movers=(WALKER,) * scenario.moving), scenario.settings
    few = replace(s, vertices=VERTICES, samples=min(s.samples, SAMPLES), tree=None, target_error=None, budget=None)
    return replace(scenario, settings=few, problem=replace(scenario.problem, scene=room), space=FreeSpace.of(room))


def rehearse(scenario: Scenario, *, driving: bool = False) -> None:
    """Do once, elsewhere, what tree and references need, and a run of a few steps if `driving`; results stay."""
    small, s = small_of(scenario), scenario.settings
    with suppress(Exception):  # a robot that cannot turn in so small a room, say: what matters will come up again
        tree = None if s.method in TREELESS else small.grown_tree()
        references = [] if tree is None else small.references(tree)
        if not driving or s.method == "optimal":
            return
        driver = small.driver(tree)
        driver.path_integral.warm_up()
        plant = Plant(small.problem, period=s.period, physics_step=s.period)
        list(episode.run(plant, driver, small.start, np.random.default_rng(0), max_time=PERIODS * s.period))
        if tree is None:
            return
        first = references[0]  # now and then runs hold a control sequence, query FCL about an edge, and rename classes
        first.trajectory.tape(driver.path_integral.grid(first.cost))
        tree.checker.motion.free(first.path, 0, small.space)
        if tree.homology.J:
            tree.homology.winding(np.zeros((2, 3)))
