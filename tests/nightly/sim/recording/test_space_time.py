"""The long tests of integration/sim/recording/test_space_time.py."""

import pytest
from drives import logged
from thoroughly import first

from sim.recording.recorder import Recorder, Sinks
from sim.scenario import prepare


@pytest.mark.parametrize("name", first(["closing_door", "crossing", "pincer"]))
def test_a_recording_among_moving_bodies_takes_half_a_megabyte_a_second(tmp_path, name):
    scenario = prepare(name)  # to the end: a drive's first moments cost more, for then tubes are drawn
    tree = scenario.grown_tree()
    driver, file = scenario.driver(tree), tmp_path / "drive.rrd"
    recorder = Recorder(scenario.loaded, tree, driver.path_integral, Sinks(file=file), settings={})
    frames = logged(recorder, scenario.drive(scenario.plant(), driver))
    assert file.stat().st_size < 525_000 * frames[-1].end_time
