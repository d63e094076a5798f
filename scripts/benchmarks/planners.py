"""Growing our tree, and OMPL's PRM* and RRT* in C++, to as many vertices on the same scene.

OMPL asks Python whether a motion is free. The answer comes from the same compiled certificate as ours, and the time
inside of it is measured: what is left is OMPL without any collision checks, but with the crossings into Python.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from benchmarks.peers import HINT, missing
from benchmarks.timing import row
from numba import njit

from pirrht.geometry.disc import certify_piece
from pirrht.geometry.field import Grid, clearance
from pirrht.geometry.space import FREE
from sim.scenario import Scenario, prepare

NUMBERS = (1000, 10_000)  # vertices
REPEATS = {1000: 5, 10_000: 3}
PLANNERS = ("PRMstar", "RRTstar")
Result = tuple[list[list[str]], dict[str, Any]]


def rows(options: argparse.Namespace) -> Result:
    """Table and JSON: seconds, microseconds per vertex, and how many times ours that is."""
    name = options.scene or "slit"
    _tree(name, 200)
    table, values = [], {}
    for number in NUMBERS:
        runs: dict[str, list[dict[str, float]]] = {"ours": []}
        for _ in range(REPEATS[number]):
            runs["ours"].append(_tree(name, number))
            for planner in () if missing("ompl") else PLANNERS:
                runs.setdefault(planner, []).append(_ompl(prepare(name), planner, number))
        medians = {
            who: {k: float(np.median([run[k] for run in found])) for k in found[0]} for who, found in runs.items()
        }
        values[str(number)] = medians
        table += _rows(number, medians)
    if missing("ompl"):
        table += [[f"OMPL's {planner}", "-", "-", "-", "-", "-", HINT] for planner in PLANNERS]
    growth = _per_vertex(values[str(NUMBERS[-1])]["ours"]) / _per_vertex(values[str(NUMBERS[0])]["ours"])
    values["per_vertex_growth"] = growth
    table.append([f"cost per vertex, {NUMBERS[-1]} over {NUMBERS[0]}", "-", "-", f"{growth:.2f}", "-", "-", "ours"])
    return table, values


def _rows(number: int, medians: dict[str, dict[str, float]]) -> list[list[str]]:
    ours, table = medians["ours"], []
    table.append(
        row(
            f"{number} vertices: ours", ours["seconds"], 1.0, rate=_rate(ours),
            note=f"{ours['edges']:.0f} edges, {ours['classes']:.0f} classes; with scene and references "
            f"{ours['whole']:.2f} s, {ours['fcl_calls']:.0f} FCL calls",
        )
    )  # fmt: skip
    for planner, found in medians.items():
        if planner != "ours":
            found["ours_over"] = _per_vertex(ours) / _per_vertex(found)
            found["ours_over_net"] = _per_vertex(ours) / _per_vertex(found, "net")
            table.append(
                row(
                    f"{number} vertices: OMPL's {planner}", found["seconds"], 1.0 / found["ours_over"],
                    rate=_rate(found),
                    note=f"{found['edges']:.0f} edges, one class; {1e3 * found['inside']:.0f} ms in callbacks; "
                    f"a vertex of ours takes {found['ours_over']:.1f} x, without the callbacks "
                    f"{found['ours_over_net']:.1f} x",
                )
            )  # fmt: skip
    return table


def _per_vertex(found: dict[str, float], which: str = "seconds") -> float:
    return found[which] / found["vertices"]


def _rate(found: dict[str, float]) -> str:
    return f"{1e6 * _per_vertex(found):.0f} us a vertex"


def _tree(name: str, vertices: int) -> dict[str, float]:
    """Our own planner: seconds of growing the tree, and of everything from a loaded scene to the references."""
    began = time.perf_counter()
    scenario = prepare(name, given={"vertices": vertices})
    middle = time.perf_counter()
    tree = scenario.grown_tree()
    grown = time.perf_counter() - middle
    references = tree.references(scenario.start)
    return {
        "seconds": grown,
        "whole": time.perf_counter() - began,
        "vertices": tree.size,
        "edges": int(tree.graph.size[1]),
        "classes": len(references),
        "fcl_calls": scenario.space.collision.calls,
    }


def _ompl(scenario: Scenario, planner: str, vertices: int) -> dict[str, float]:
    """One run of a planner of OMPL until it has so many vertices (RRT*: so many iterations)."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_ERROR)
    scene, inside = scenario.problem.scene, [0]
    free, valid = _certificates(scenario, inside)
    bounds, space = base.RealVectorBounds(2), base.RealVectorStateSpace(2)
    for axis in range(2):
        bounds.setLow(axis, float(scene.lower[axis]))
        bounds.setHigh(axis, float(scene.upper[axis]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)

    class Motions(base.MotionValidator):  # type: ignore[misc]
        """Answers with the certificate of the clearance field."""

        def checkMotion(self, one: Any, other: Any) -> bool:
            return free(one[0], one[1], other[0], other[1])

    motions = Motions(information)
    information.setStateValidityChecker(lambda state: valid(state[0], state[1]))
    information.setMotionValidator(motions)
    information.setup()
    definition = base.ProblemDefinition(information)
    ends = [information.allocState() for _ in range(2)]
    for state, point in zip(ends, (scene.start, scene.goal.center), strict=True):
        state[0], state[1] = float(point[0]), float(point[1])
    definition.setStartAndGoalStates(*ends, float(scene.goal.radius))
    definition.setOptimizationObjective(base.PathLengthOptimizationObjective(information))
    search = getattr(geometric, planner)(information)
    search.setProblemDefinition(definition)
    search.setup()
    asked = [0]

    def enough() -> bool:
        asked[0] += 1
        return (search.milestoneCount() if planner == "PRMstar" else asked[0]) >= vertices

    # PRM*'s `solve` looks for paths on a second thread, which would wait for Python's lock for ever.
    grow = search.growRoadmapPtc if planner == "PRMstar" else search.solve
    began = time.perf_counter()
    grow(base.PlannerTerminationCondition(enough))
    seconds = time.perf_counter() - began
    data = base.PlannerData(information)
    search.getPlannerData(data)
    return {
        "seconds": seconds,
        "inside": 1e-9 * inside[0],
        "net": seconds - 1e-9 * inside[0],
        "vertices": data.numVertices(),
        "edges": data.numEdges(),
    }


def _certificates(scenario: Scenario, inside: list[int]) -> tuple[Callable[..., bool], Callable[..., bool]]:
    """Whether a segment and whether a point is free, adding the nanoseconds spent to `inside`."""
    field = Grid(*scenario.space.field)  # plain numbers, which become constants of the compiled code

    @njit
    def segment(ax, ay, bx, by):  # type: ignore[no-untyped-def]
        return certify_piece(field, (ax, ay), (bx, by)) == FREE

    @njit
    def point(x, y):  # type: ignore[no-untyped-def]
        return clearance(field, x, y) > 0.0

    def timed(function: Any) -> Callable[..., bool]:
        function(*([1.0] * (4 if function is segment else 2)))

        def ask(*numbers: float) -> bool:
            began = time.perf_counter_ns()
            answer = bool(function(*numbers))
            inside[0] += time.perf_counter_ns() - began
            return answer

        return ask

    return timed(segment), timed(point)
