"""A plan in a small room, so that whatever must be compiled or loaded is before any clock runs.

As a program, `python -m sim.rehearsal` compiles for a command that compiles at the same time: of the pickled pair that
it reads, a scene and options of a run, it first makes what the command needs last. It ends with its standard input.
"""

import gc
import os
import pickle
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from pirrht.control.settings import TREELESS
from pirrht.estimation.assembly import path_integral
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import trace
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene
from pirrht.geometry.space import at_states
from pirrht.jit import cache
from sim.drive import episode
from sim.drive.executor import Plant
from sim.scenario import Scenario, prepare

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


CART = Footprint.rectangle(0.4, 0.2)
PILLAR = replace(BOX, size=np.array([0.3, 0.3, 1.5]), position=np.array([2.0, 2.6, 1.0]))
HALL = replace(
    ROOM, lower=np.zeros(3), upper=np.array([4.0, 4.0, 2.0]), start=np.array([0.7, 2.0, 1.0]), obstacles=(PILLAR,),
    goal=Goal(center=np.array([3.3, 2.0, 1.0]), radius=0.3),
)  # fmt: skip
FLYER = Mover(
    name="flyer", solids=(replace(DISC, kind=Kind.SPHERE, position=np.zeros(3)),),
    motion=Motion(rows=np.array([[0.0, 2.0, 0.5, 1.0, 1.0, 0.0, 0.0, 0.0], [3.0, 2.0, 1.6, 1.0, 1.0, 0.0, 0.0, 0.0]])),
)  # fmt: skip


def room_of(scene: Scene) -> Scene:
    """Return the small room, or one in space; an obstacle moves there, or the robot has corners, as in the scene."""
    if scene.dimension == 3:
        return replace(HALL, movers=(FLYER,) * bool(scene.movers))
    room = replace(ROOM, movers=(WALKER,) * bool(scene.movers))
    return room if scene.footprint.is_disc else replace(room, footprint=CART)


def small_of(scenario: Scenario) -> Scenario:
    """Put the robot into a small room under its settings."""
    room, s = room_of(scenario.loaded.scene), scenario.settings
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
        trace(np.zeros(3), np.zeros(1), np.ones(1), 1.0)  # as of the favourite, where motions are predicted
        static = small.space.static
        reads = small.problem.dynamics.reads(static.kernels.turns)
        at_states(static.kernels, reads).clearance(static, small.start)  # of the state that a plan by the clock is for
        if tree.homology.J:
            tree.homology.winding(np.zeros((2, tree.homology.markers.shape[1] + 1)))


def compile_last(scene: str | Path, given: Mapping[str, Any]) -> None:
    """Compile for a run what samples need, then the rest: whoever plans meanwhile comes to them last."""
    small = small_of(prepare(scene, given=given, room=room_of))
    path = np.zeros((2, small.space.scene.dimension + 1))
    if small.settings.method not in TREELESS:
        integral = path_integral(small.problem, small.space, small.sampling, homology=small.homology)
        small.homology.along(path)
        if small.homology.J:
            small.homology.winding(path)
        integral.warm_up(optima=False)  # when others plan, they need the optima next
        integral.warm_up()
    rehearse(small, driving=True)


def helper(scene: str | Path, given: Mapping[str, Any]) -> subprocess.Popen[bytes] | None:
    """Begin `compile_last` in another process; None where that is of no use: one core, or nothing is kept on disk."""
    if len(os.sched_getaffinity(0)) < 2 or not cache.kept():
        return None
    command = [sys.executable, "-P", "-m", "sim.rehearsal"]  # -P: nothing is imported from the current folder
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True,  # which Ctrl-C does not reach
    )  # fmt: skip
    assert process.stdin is not None
    with suppress(BrokenPipeError):
        process.stdin.write(pickle.dumps((scene, given)))
        process.stdin.flush()
    return process


def _end_with_input() -> None:
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    task = pickle.load(sys.stdin.buffer)
    Thread(target=_end_with_input, daemon=True).start()
    gc.disable()  # collecting takes a tenth of the time, and the end of the process frees all
    compile_last(*task)
