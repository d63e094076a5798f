"""The exact solution in a recording: what is painted on the floor, and psi class by class."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from drives import Drive, columns, logged
from rerun.chunk import RrdReader

from pirrht.exact.desirability import Desirability
from sim.recording import geoms, reasons, stage
from sim.recording.recorder import Recorder, Sinks
from sim.recording.viewer import Look


@pytest.fixture(scope="module")
def solved():
    drive = Drive()
    return drive, Desirability.of(drive.controller.problem, drive.space, spacing=0.05)


@pytest.fixture(scope="module")
def floor(solved):
    drive, grid = solved
    return geoms.painted(grid, drive.space, 0.0, 60).astype(float).sum(axis=2)


def pixel(floor, x, y):
    """Brightness over a point of the 6 m x 5 m floor, north being up."""
    height, width = floor.shape
    return floor[height - 1 - int(y / 5.0 * height), int(x / 6.0 * width)]


def test_the_floor_is_pale_at_the_goal_and_the_darker_the_dearer(floor):
    assert floor.shape == (50, 60)
    along = [pixel(floor, x, 2.5) for x in (5.5, 4.7, 2.0, 0.3)]
    assert all(a > b for a, b in zip(along, along[1:], strict=False))


def test_where_the_robot_may_not_be_nothing_is_painted(floor):
    blocked = float(sum(geoms.BLOCKED))
    assert pixel(floor, 3.4, 2.8) == blocked
    assert pixel(floor, 3.4, 2.85) == blocked  # touching the wall
    assert pixel(floor, 3.4, 2.5) != blocked  # between the walls


def test_of_a_robot_with_a_heading_the_best_one_counts():
    def value(states, time):
        return 1.0 - np.cos(states[:, 2] - np.pi / 2)

    grid = SimpleNamespace(problem=SimpleNamespace(dynamics=SimpleNamespace(states=("x", "y", "heading"))), value=value)
    np.testing.assert_allclose(geoms.values(grid, np.zeros((3, 2)), 0.0), 0.0, atol=1e-12)


def test_classes_that_differ_by_moving_bodies_alone_are_added_up_where_a_plan_does_not_tell_them_apart(solved):
    drive, _ = solved
    start = drive.scene.start[:2]
    drive.controller.begin(start)
    plan = drive.controller.plan(start)
    grid = SimpleNamespace(shares=lambda x, samples, t: {"0,0,0": 0.5, "0,0,1": 0.3, "0,1,0": 0.2})
    found = reasons.shares_of(grid, plan, 0.0)
    assert found == {"0,0": pytest.approx(0.8), "0,1": pytest.approx(0.2), "-1,0": 0.0}
    bare = replace(plan, references=(replace(plan.references[0], winding=()),), ids=("-",))
    assert reasons.shares_of(grid, bare, 0.0) == {"-": pytest.approx(1.0)}


def test_a_recording_with_a_truth_has_the_floor_and_exact_shares(solved, tmp_path):
    _, grid = solved
    drive, file = Drive(), tmp_path / "a.rrd"
    integral = drive.controller.path_integral
    look, settings = Look(truth=True), {"scene": "slit", "seed": 0, "method": "pi-rrht"}
    recorder = Recorder(drive.loaded, drive.tree, integral, Sinks(file=file), look, settings=settings, grid=grid)
    logged(recorder, drive.frames(0.02, grid=grid))
    assert stage.VALUE in {chunk.entity_path for chunk in RrdReader(str(file)).stream() if chunk.is_static}
    assert "| exact |" in columns(file)["/why/page"]["TextDocument:text"][0][0]
