"""Solve psi on a grid: the value and the optimal control at places of the floor, as text."""

import numpy as np

from pirrht import Desirability, FreeSpace, Problem, Scene, SingleIntegrator

scene = Scene.from_boxes(
    [[2.2, 1.5, 3.8, 2.27], [2.2, 2.73, 3.8, 3.5]],
    lower=(0, 0), upper=(6, 5), start=(0.5, 2.5), goal=(5.5, 2.5, 0.25), robot_radius=0.2,
)  # fmt: skip
ARROWS = "→↗↑↖←↙↓↘"
for b in (0.1, 0.3):
    problem = Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2 * np.eye(2))
    exact = Desirability.of(problem, FreeSpace.of(scene))
    v = exact.value(scene.start[:2])
    print(f"\noptimal direction at b = {b:g} (# is a wall, G the goal); v at the start: {v:.3f}")
    for y in np.arange(4.75, 0.0, -0.25):
        row = ""
        for x in np.arange(0.25, 6.0, 0.25):
            place = np.array([x, y])
            if scene.goal.contains(place):
                row += "G"
            elif not np.isfinite(exact.value(place)):
                row += "#"
            else:
                ux, uy = exact.control(place)
                row += ARROWS[round(np.arctan2(uy, ux) / (np.pi / 4)) % 8]
        print(row)
