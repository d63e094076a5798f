"""A rectangle in random rooms with a gap that only headings along it fit: MuJoCo meets what plans know."""

from pathlib import Path

import numpy as np
import pytest

from pirrht import NoReference
from pirrht.moving.collision import MovingObstacles
from pirrht.outcome import Outcome
from sim.mjcf.footprint import collision_of
from sim.scenario import Scenario, prepare

CONTACT = 2e-3  # by which distances of contacts differ [m]
FEW = {"vertices": 500, "samples": 60, "period": 0.1, "max_time": 12.0, "limit": 0.8}


MOVING = (
    '<custom><numeric name="pirrht_motion_bar" data="0 2.2 0.4 0  2 2.4 2 3  4 2.2 0.4 5"/></custom>',
    '<body name="bar" mocap="true" pos="2.2 0.4 0.2"><geom name="bar" type="box" size="0.2 0.06 0.2"/></body>',
)


def room(folder: Path, seed: int, custom: str = "", bodies: str = "") -> Path:
    """A wall with a gap between two halves with a box each, and a bar that moves."""
    rng = np.random.default_rng([seed, 62])
    width = rng.uniform(0.48, 0.7)
    low = rng.uniform(0.5, 1.3)
    rows = [(1.6, 0.0, 1.7, low), (1.6, low + width, 1.7, 2.4)]
    for left in (0.9, 2.2):
        x, y = left + rng.uniform(-0.1, 0.1), rng.choice([0.1, 2.1])
        rows.append((x, y, x + rng.uniform(0.1, 0.3), y + rng.uniform(0.1, 0.3)))
    boxes = "".join(
        f'<geom name="b{k}" type="box" pos="{0.5 * (a + c)} {0.5 * (b + d)} 0.3" '
        f'size="{0.5 * (c - a)} {0.5 * (d - b)} 0.3"/>'
        for k, (a, b, c, d) in enumerate(rows)
    )
    start, goal = f"0.6 {rng.uniform(0.8, 1.6)} 0", f"2.7 {rng.uniform(0.8, 1.6)} 0"
    file = folder / f"room{seed}.xml"
    file.write_text(
        f"""<mujoco>{custom}<worldbody>{bodies}<site name="workspace" type="box" pos="1.6 1.2 1" size="1.6 1.2 1"/>
        <site name="start" pos="{start}" euler="0 0 {rng.uniform(-60, 60)}"/>
        <site name="goal" type="cylinder" pos="{goal}" size="0.25 0.01"/>{boxes}</worldbody></mujoco>"""
    )
    return file


def met(scenario: Scenario) -> tuple[Outcome, float, float]:
    """How a run ends, and the least clearance of its body before its last step, and at that."""
    scene, body = scenario.loaded.scene, scenario.loaded.scene.body
    frames = list(scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())))
    poses = np.vstack([frame.advance.states for frame in frames])[:, scenario.problem.dynamics.reads(True)]
    clear = collision_of(scene.world, body).clearance(poses)
    if scene.movers:
        crowd, times = MovingObstacles(scene.movers, body), scenario.physics_step * np.arange(1, len(poses) + 1)
        clear = np.minimum(clear, [*map(crowd.clearance, poses, times)])
    return frames[-1].outcome, float(clear[:-1].min()), float(clear[-1])


@pytest.mark.parametrize("robot", ["rover", "diffdrive", "unicycle", "car"])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("moving", [(), MOVING], ids=["standing", "moving"])
def test_a_rectangle_touches_nothing_but_what_its_footprint_does(tmp_path, seed, robot, moving):
    given = {"robot": robot, "footprint": "0.7x0.4@0.05", "margin": 0.0, "seed": seed}
    scenario = prepare(room(tmp_path, seed, *moving), given={**given, **FEW, **({"rho": 0.4} if robot in HELD else {})})
    try:
        outcome, before, last = met(scenario)
    except NoReference:
        pytest.skip("no path")
    assert before > -CONTACT
    assert (last <= CONTACT) == (outcome is Outcome.COLLISION)


HELD = ("unicycle", "diffdrive")  # robots with a turning radius
