"""The exact law next to runs: in recordings, on the terminal and in JSON, and driven in MuJoCo itself."""

import json

import numpy as np
import pytest
from drives import Drive, columns, logged
from rerun.chunk import RrdReader

from pirrht import Desirability, Outcome
from sim.cli import main
from sim.recording.stage import CONTROL, OPTIMUM
from sim.recording.writer import AHEAD
from sim.scenario import prepare

STATIC_BYTES = 540_000  # two views more than without a truth
SHORT = ["--noise", "0.3", "--vertices", "80", "--samples", "20", "--max-time", "0.05"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording with its exact solution, frames, and figures."""
    file, drive = tmp_path_factory.mktemp("truth") / "slit.rrd", Drive()
    grid = Desirability.of(drive.controller.problem, drive.space)
    frames = logged(drive.recorder(file, truth=True), drive.frames(grid=grid))
    return file, grid, frames, frames[-1].metrics.truth


def test_the_optimal_control_is_a_second_arrow_of_another_colour_and_the_same_scale(recorded):
    file, grid, frames, _ = recorded
    arrows = [two for two in columns(file)["/world/robot"]["Arrows3D:vectors"] if two]
    chosen = np.array([frame.plan.control for frame in frames])
    best = grid.control(np.array([frame.plan.state for frame in frames]))
    assert np.abs(chosen - best).max() > 0.02  # two arrows, not one
    np.testing.assert_allclose(np.array(arrows)[:, :, :2], AHEAD * np.stack([chosen, best], axis=1), atol=1e-6)
    looks = [c.to_record_batch() for c in RrdReader(str(file)).stream() if c.entity_path == "/world/robot"]
    (colors,) = [b.column("Arrows3D:colors").to_pylist()[0] for b in looks if "Arrows3D:colors" in b.schema.names]
    assert colors == [r << 24 | g << 16 | b << 8 | 255 for r, g, b in (CONTROL, OPTIMUM)]
    assert file.stat().st_size <= STATIC_BYTES + 480_000 * frames[-1].end_time


def test_value_and_distance_from_the_optimum_are_numbers_at_every_step(recorded):
    file, grid, frames, result = recorded
    table, states = columns(file), np.array([frame.plan.state for frame in frames])
    exact, best = grid.value(states), grid.control(states)
    np.testing.assert_allclose(np.ravel(table["/steps"]["exact_value"]), exact)
    np.testing.assert_allclose(table["/steps"]["exact_control"], best)
    estimates = [frame.plan.estimate for frame in frames]
    off = np.linalg.norm([frame.plan.control for frame in frames] - best, axis=1)
    error = [np.linalg.norm(e.control_error) for e in estimates]
    np.testing.assert_allclose(
        table["/why/optimum/control"]["Scalars:scalars"], np.column_stack([error, off]), rtol=1e-4
    )
    np.testing.assert_allclose(np.array(table["/why/value"]["Scalars:scalars"])[:, -1], exact, rtol=1e-4)
    value, spread = np.array([(e.value, e.value_error) for e in estimates]).T
    near = np.column_stack([value - spread, value + spread, value, exact]) - exact[:, None]
    np.testing.assert_allclose(table["/why/optimum/value"]["Scalars:scalars"], near, rtol=1e-4, atol=1e-9)
    assert (result["value"], result["mean_control_error"]) == (exact[0], pytest.approx(off.mean()))
    assert result["max_control_error"] == pytest.approx(off.max())


@pytest.mark.parametrize("method", ["pi-rrht", "optimal", "passive"])
def test_a_run_reports_how_far_from_the_optimum_it_was(tmp_path, capsys, method):
    files = ["--record", str(tmp_path / "a.rrd"), "--json", str(tmp_path / "a.json")]
    assert main(["run", "slit", *SHORT, "--truth", "--method", method, *files]) == 1
    assert "|u - u*|" in capsys.readouterr().out
    result, off = json.loads((tmp_path / "a.json").read_text()), columns(tmp_path / "a.rrd")["/why/optimum/control"]
    mean = np.array(off["Scalars:scalars"])[:, 1].mean()
    assert result["truth"]["mean_control_error"] == pytest.approx(mean, rel=1e-4)
    assert (mean < 1e-9) == (method == "optimal")
    if method == "optimal":
        assert result["truth"]["value"] == result["value_estimate"]


@pytest.mark.parametrize("words", ["slit --noise 0.01", "clutter", "slit --robot unicycle --noise 0.3 --preset paper"])
def test_where_no_grid_can_be_solved_the_run_does_not_begin(tmp_path, refused, words):
    file = tmp_path / "a.rrd"
    refused(["run", *words.split(), "--truth", "--record", str(file)], "grid")
    assert not file.exists()


@pytest.mark.thorough
def test_runs_under_the_exact_law_among_moving_obstacles_cost_what_it_predicts_and_arrive():
    """`pincer`, b = 0.3: the mean cost of 24 runs is v to 3 standard errors and 1 %; seeds 0 to 23."""
    scenario = prepare("pincer", given={"noise": 0.3, "method": "optimal"})
    truth = Desirability.of(scenario.problem, scenario.space)
    v, costs = float(truth.value(scenario.start)), []
    for seed in range(24):
        one = scenario.with_settings(seed=seed)
        for frame in one.drive(one.plant(), one.driver(truth=truth), grid=truth):
            np.testing.assert_allclose(frame.plan.control, frame.truth.control, atol=1e-9)
        costs += [frame.cost] if frame.outcome is Outcome.GOAL else []
    assert len(costs) >= 21
    assert np.mean(costs) == pytest.approx(v, abs=3.0 * np.std(costs) / np.sqrt(len(costs)) + 0.01 * v)
