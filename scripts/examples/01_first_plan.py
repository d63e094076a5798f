"""Plan once in a world of two walls: homology classes, their references, shares, value and control with errors."""

import numpy as np

from pirrht import Controller, FreeSpace, HomologyTree, Problem, Sampling, Scene, SingleIntegrator, StraightLine

scene = Scene.from_boxes(
    [[2.2, 1.5, 3.8, 2.27], [2.2, 2.73, 3.8, 3.5]],  # x0, y0, x1, y1 [m]
    lower=(0, 0), upper=(6, 5), start=(0.5, 2.5), goal=(5.5, 2.5, 0.25), robot_radius=0.2,
)  # fmt: skip
for b in (0.1, 0.3):  # dx = u dt + b dw
    problem = Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2 * np.eye(2))
    space = FreeSpace.of(scene)
    tree = HomologyTree(space, StraightLine.of(problem), limit=0.8, rng=np.random.default_rng(0))
    tree.grow(600)
    controller = Controller(problem, space, tree, Sampling(samples=200), rng=np.random.default_rng(1))
    plan = controller.plan(scene.start[:2])
    estimate = plan.estimate
    print(f"b = {b:g}: v = {estimate.value:.3f} +- {estimate.value_error:.3f}, u = {np.round(plan.control, 3)}")
    for reference in plan.references:
        share = estimate.class_weights.get(reference.id, 0.0)
        print(f"  class {reference.id}: cost {reference.cost:.3f}, share {share:.3f}")
