"""Plan on an occupancy grid from NumPy, and again after the map has changed."""

import numpy as np

from pirrht import Controller, FreeSpace, Problem, Sampling, Scene, SingleIntegrator, StraightLine, grown_tree

CELL = 0.1  # side of a cell [m]
task = {"start": (0.5, 2.5), "goal": (5.5, 2.5, 0.25), "robot_radius": 0.15}
occupied = np.zeros((50, 60), dtype=bool)  # rows from below; of a ROS message `grid > 50`
occupied[6:22, 24:28] = occupied[28:44, 24:28] = True
scene = Scene.from_grid(occupied, CELL, **task)

problem = Problem(dynamics=SingleIntegrator(b=0.15), scene=scene, R=2 * np.eye(2))
space = FreeSpace.of(scene)
tree = grown_tree(space, StraightLine.of(problem), scene.start[:2], 400)
controller = Controller(problem, space, tree, Sampling(samples=100), rng=np.random.default_rng(1))
plan = controller.plan(scene.start[:2])
print(f"classes {', '.join(plan.ids)}; favourite {plan.favourite}, v = {plan.estimate.value:.3f}")

occupied[22:28, 24:28] = True  # somebody closes the gap
controller.update(Scene.from_grid(occupied, CELL, **task))
plan = controller.plan(scene.start[:2])
print(f"classes {', '.join(plan.ids)}; favourite {plan.favourite}, v = {plan.estimate.value:.3f}")
