"""What psi is, as a picture: the exact value on the floor, and the optimal control as arrows, per noise level."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from figures import ground, style
from sim.scenario import Scenario

CELLS, ARROWS = 220, 22  # along x
LEVELS = 16  # lines of equal value


def draw(plt: Any, scenarios: Sequence[Scenario]) -> Any:
    """One panel per scenario, whose problems a grid must solve; a matplotlib figure."""
    scene = scenarios[0].loaded.scene
    size = scene.upper - scene.lower
    height = style.PAGE / len(scenarios) * float(size[1] / size[0]) + 0.35
    figure, panels = plt.subplots(1, len(scenarios), figsize=(style.PAGE, height), squeeze=False, layout="constrained")
    for index, (axes, scenario) in enumerate(zip(panels[0], scenarios, strict=True)):
        _panel(axes, scenario)
        ground.draw(axes, scenario.loaded.scene)
        ground.frame(axes, scene.lower, scene.upper)
        ground.robot(axes, scene, scenario.start)
        style.panel(axes, index, f"$b$ = {scenario.settings.noise:g}: $v = -\\lambda \\log \\psi$ and $u^*$")
        axes.set_axis_off()
    return figure


def _panel(axes: Any, scenario: Scenario) -> None:
    truth, scene = scenario.truth(), scenario.loaded.scene
    states, shape = _places(scenario, CELLS)
    free = np.asarray(scenario.space.collision.clearance(states)).reshape(shape) > 0.0
    value = np.where(free, np.asarray(truth.value(states)).reshape(shape), np.nan)
    edges = (*scene.lower[:1], *scene.upper[:1], *scene.lower[1:], *scene.upper[1:])
    top = float(np.nanpercentile(value, 98))
    axes.imshow(value, origin="lower", extent=edges, cmap="YlGnBu", vmin=0.0, vmax=top, alpha=0.8, zorder=0.5)
    x, y = (states[:, i].reshape(shape) for i in (0, 1))
    axes.contour(x, y, value, np.linspace(0.0, top, LEVELS), colors="white", linewidths=0.5, zorder=0.7)
    states, shape = _places(scenario, ARROWS)
    states = states[np.asarray(scenario.space.collision.clearance(states)) > 0.05]
    u = truth.control(states)
    u = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1.0)  # at walls it grows without bound
    axes.quiver(*states.T, *u.T, color=style.INK, scale=26, width=0.0028, zorder=3)


def _places(scenario: Scenario, count: int) -> tuple[Any, tuple[int, int]]:
    """Middles of cells (k, 2), `count` along x, and their grid's shape."""
    lower, upper = scenario.loaded.scene.lower, scenario.loaded.scene.upper
    step = float(upper[0] - lower[0]) / count
    x, y = (np.arange(a + step / 2, b, step) for a, b in zip(lower, upper, strict=True))
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    return grid.reshape(-1, 2), grid.shape[:2]
