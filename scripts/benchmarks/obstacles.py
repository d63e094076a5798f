"""Planning and a control step against the number of obstacles, cylinders on a jittered lattice."""

import argparse
import time

import numpy as np
from benchmarks.moving_text import prepared

from sim.rehearsal import rehearse

NUMBERS = (10, 100, 1000)
SIDE = 24.0  # [m]
RADIUS, ROBOT = 0.02, 0.15  # of cylinders and robot [m]; a thousand leave room to pass
CLASSES = 8
REPEATS = 3


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of the figures."""
    values = {M: _times(M, options.drive) for M in NUMBERS}
    first = values[NUMBERS[0]]
    table = [
        [
            str(M), f"{look:.2f}", f"{plan:.2f}", f"{plan / first[1]:.2f}", f"{step:.2f}", f"{step / first[2]:.2f}",
            str(references),
        ]
        for M, (look, plan, step, references) in values.items()
    ]  # fmt: skip
    header = ["cylinders", "prepare [s]", "planning [s]", "ratio", "control step [ms]", "ratio", "references"]
    names = ("prepare_seconds", "plan_seconds", "step_ms")
    return header, table, {str(M): dict(zip(names, v[:3], strict=True)) for M, v in values.items()}


def _times(M: int, drive: float) -> tuple[float, float, float, int]:
    """Medians of the seconds of examining a scene and of planning, milliseconds of a control step, and references."""
    text, moments = field(M, np.random.default_rng(M)), []
    for seed in range(REPEATS + 1):  # the first one loads
        given = {"seed": seed, "classes": CLASSES, "vertices": 2000, "rho": 0.3}
        began = time.perf_counter()
        scenario = prepared("field", text, robot="unicycle", radius=ROBOT, given=given)
        ready = time.perf_counter()
        tree = scenario.grown_tree()
        references = tree.references(scenario.start)
        moments.append((began, ready, time.perf_counter()))
    preparing, planning = np.median(np.diff(moments[1:], axis=1), axis=0).tolist()
    rehearse(scenario, driving=True)
    timed = scenario.with_settings(max_time=drive)
    frames = list(timed.drive(timed.plant(), timed.driver(tree)))
    step = 1e3 * float(np.median([frame.plan_seconds for frame in frames]))
    return preparing, planning, step, len(references)


def field(M: int, rng: np.random.Generator) -> str:
    """MJCF of M separate cylinders in a square."""
    per_side = int(np.ceil(np.sqrt(M)))
    pitch = SIDE / per_side
    cells = rng.permutation(per_side**2)[:M]
    slack = 0.5 * pitch - RADIUS - ROBOT - 0.01
    geoms = []
    for i, cell in enumerate(cells):
        x, y = (np.array(divmod(int(cell), per_side)) + 0.5) * pitch + rng.uniform(-slack, slack, 2)
        ends = [np.hypot(x - near, y - SIDE / 2) for near in (0.5, SIDE - 0.5)]
        if min(ends) < 0.6:
            y = -1.0  # out of the workspace: the number of geoms stays
        geoms.append(f'<geom name="c{i}" type="cylinder" pos="{x:.4f} {y:.4f} 0.2" size="{RADIUS} 0.2"/>')
    return f"""<mujoco model="field"><worldbody>
    {"".join(geoms)}
    <site name="start" pos="0.5 {SIDE / 2} 0"/>
    <site name="goal" type="cylinder" pos="{SIDE - 0.5} {SIDE / 2} 0" size="0.4 0.01"/>
    <site name="workspace" type="box" pos="{SIDE / 2} {SIDE / 2} 0.5" size="{SIDE / 2} {SIDE / 2} 0.5"/>
    </worldbody></mujoco>"""
