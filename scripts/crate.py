"""A world from Python in which a crate appears in front of the robot, which replans to another class."""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from pirrht import Controller, FreeSpace, HomologyTree, Problem, Sampling, Scene, SingleIntegrator, StraightLine

WALLS = [[2.2, 0.6, 2.6, 2.2], [2.2, 2.8, 2.6, 4.4]]  # x0, y0, x1, y1 [m]; between them is the shortest path
CRATE = [2.9, 2.1, 3.5, 2.9]
APPEARS, LONGEST = 0.8, 20.0  # when the crate does, and how long a run may take [s]
PERIOD, STEP = 0.02, 0.002  # between plans, and of the equation [s]


def room(*boxes: list[float]) -> Scene:
    """The room with these boxes in it."""
    return Scene.from_boxes(
        boxes, lower=(0, 0), upper=(6, 5), start=(0.5, 2.5), goal=(5.5, 2.5, 0.25), robot_radius=0.2
    )


def main() -> int:
    """Run once and draw the plans before and after the crate; the exit status is 0 if it was not hit."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument("--noise", type=float, default=0.15, help="b of dx = u dt + b dw")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--png", type=Path, default=Path("crate.png"))
    options = parser.parse_args()
    for_tree, for_samples, for_plant = (np.random.default_rng(s) for s in np.random.SeedSequence(options.seed).spawn(3))

    scene = room(*WALLS)
    problem = Problem(dynamics=SingleIntegrator(b=options.noise), scene=scene, R=2 * np.eye(2))
    space = FreeSpace.of(scene)
    tree = HomologyTree(space, StraightLine.of(problem), limit=0.8, rng=for_tree)
    tree.grow(600)
    controller = Controller(problem, space, tree, Sampling(dt=0.1, first=PERIOD, samples=200), rng=for_samples)

    x, driven, plans = scene.start[:2], [scene.start[:2]], []
    while not scene.goal.contains(x) and controller.space.clearance(x) > 0.0 and controller.run.clock.time < LONGEST:
        plan = controller.plan(x)
        if not plans and controller.run.clock.time >= APPEARS:
            controller.update(room(*WALLS, CRATE))  # a new tree; classes keep their names
            plans += [plan, plan := controller.plan(x)]
        states = []
        for k in range(round(PERIOD / STEP)):
            noise = np.sqrt(STEP) * for_plant.standard_normal(2)
            x = problem.dynamics.step(x, plan.at(x, k * STEP), noise, STEP)
            states.append(x)
        controller.observe(np.array(states), PERIOD)
        driven += states
    print(f"from class {plans[0].favourite} to {plans[1].favourite}, driven {controller.driven_id()}")

    _, axes = plt.subplots(1, 2, figsize=(12, 4.3), layout="constrained")
    for when, plan, axis in zip(("before", "after"), plans, axes, strict=True):
        plan.plot(axes=axis).set_title(f"{when} the crate")
    axes[1].plot(*np.array(driven).T, color="k", lw=1)
    plt.savefig(options.png)
    return 0 if scene.goal.contains(x) else 1


if __name__ == "__main__":
    raise SystemExit(main())
