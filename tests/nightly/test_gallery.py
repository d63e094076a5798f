"""The scenes of the gallery: made by their scripts, planned in with more than one way, driven to the goal, drawn."""

import re

import gallery
import make_scenes
import numpy as np
import pytest
from repository import ROOT
from thoroughly import thorough

from pirrht import OptionError, Outcome
from sim.drawing.ways import ways_in
from sim.film import Film
from sim.mjcf import load, models_folder
from sim.mjcf.names import names_of
from sim.recording.export import read
from sim.scenario import prepare

PAGES = {make().name: make for make in make_scenes.PAGES}
SHORT = {"period": 0.05, "classes": 4, "samples": 100}  # a drive of a second or so


def bare(text: str) -> str:
    """A scene without its meshes, whose triangles a library chooses."""
    return re.sub(r"<mesh [^>]*/>", "", text)


@pytest.mark.parametrize("name", PAGES)
def test_a_scene_is_what_its_script_writes(name):
    assert bare((models_folder() / "scenes" / f"{name}.xml").read_text()) == bare(PAGES[name]().text())


@pytest.mark.parametrize("name", [*PAGES, "slit"])
def test_a_scene_has_more_than_one_way_that_noise_may_favour(name):
    scenario = prepare(name)
    tree, shares = scenario.grown_tree(), []
    for noise in (scenario.settings.noise, 0.3):
        controller = scenario.with_settings(noise=noise).driver(tree)
        controller.begin(scenario.start)
        plan = controller.plan(scenario.start)
        assert len(plan.references) >= 2
        shares.append(plan.estimate.class_weights)
    first = [max(weights, key=lambda each: weights[each]) for weights in shares]
    assert first[0] != first[1] or max(sorted(weights.values())[-2] for weights in shares) > 0.01


def test_gusts_turn_a_drone_from_the_window_to_the_top_of_the_wall():
    scenario = prepare("gust")
    tree, ways = scenario.grown_tree(), dict[float, str]()
    for noise in (scenario.settings.noise, 0.5):
        plan = scenario.with_settings(noise=noise).driver(tree).plan(scenario.start)
        words = ways_in(plan.space, plan.references, names_of(scenario.loaded, plan.space))
        ways[noise] = dict(zip(plan.ids, words, strict=True))[plan.favourite]
    assert ways == {0.1: "through the opening in wall", 0.5: "over wall"}


@pytest.mark.parametrize("name", ["barn", *(thorough(name) for name in PAGES if name != "barn")])
def test_a_robot_reaches_the_goal_with_one_of_three_seeds_though_it_plans_seldom(name):
    tree = prepare(name).grown_tree()
    for seed in range(3):
        scenario = prepare(name, given={**SHORT, "seed": seed, "plan_seed": 0})
        *_, last = scenario.drive(scenario.plant(), scenario.driver(tree))
        if last.outcome is Outcome.GOAL:
            return
    pytest.fail(f"{name}: {last.outcome.name} with the last seed")


def test_the_script_draws_a_still_and_a_loop_of_a_scene(tmp_path, monkeypatch):
    image = pytest.importorskip("PIL.Image")
    try:
        Film(load("slit"), size=(8, 8)).close()
    except OptionError as error:
        pytest.skip(str(error))
    monkeypatch.setattr(gallery, "STILL", (160, 90))
    monkeypatch.setattr(gallery, "LOOP", (80, 45))
    assert gallery.main(["double_slit", "u_trap", "-o", str(tmp_path), "--shots", "3", "--max-time", "0.2"]) == 0
    for name in ("double_slit", "u_trap"):
        with image.open(tmp_path / f"{name}.webp") as still, image.open(tmp_path / f"{name}-drive.webp") as loop:
            assert still.size == (160, 90)
            assert (loop.size, loop.n_frames) == ((80, 45), 3)
            brightness = [float(np.asarray(one.convert("L")).mean()) for one in (still, loop)]
        assert np.ptp(brightness) < 20.0  # both show the same scene
    pytest.importorskip("matplotlib")
    assert gallery.main(["wind", "-o", str(tmp_path), "--shots", "2", "--max-time", "0.1"]) == 0
    with image.open(tmp_path / "wind.webp") as pair:
        halves = np.split(np.asarray(pair.convert("L"), float)[90:-30], 2, axis=1)  # without texts
    assert np.abs(halves[0] - halves[1]).max() > 50.0


def test_the_recording_in_the_documents_is_small_and_can_be_read():
    """A hosted viewer takes some 2 MB; it is a whole drive around the walls of `slit`."""
    file = ROOT / "docs" / "recordings" / "slit.rrd"
    assert file.stat().st_size < 2_000_000
    assert len(read(file).steps) > 300
