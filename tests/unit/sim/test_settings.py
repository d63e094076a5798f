"""Settings and options: bounded, and all that parser, scenes, help and datasets know of options."""

import inspect
import re
from contextlib import nullcontext
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from repository import ROOT

import pirrht
from pirrht import Mppi, OptionError
from pirrht.control.settings import ControlSettings
from sim.cli import docs, main, parser
from sim.options import DAILY, GIB, OPTIONS, check_size, options_of
from sim.recording.viewer import Look
from sim.scenario import prepare
from sim.settings import BY_SCENE, BY_SETTING, IDENTIFYING, Option, Settings, refuse_unused
from sim.systems import named, names

QUICK = ["--vertices", "30", "--samples", "4"]
BOUNDED = [option for option in OPTIONS if option.bounds]
ODD = st.one_of(st.floats(), st.integers(), st.sampled_from([10**400, -(10**400), "x", "", None]))
WORDS = st.one_of(st.floats().map(str), st.integers().map(str), st.sampled_from(["1" + "0" * 400, "x", "", "0x1"]))


# -- every number, however hostile, is refused in one line or admitted -------------------------------------------------


def assert_one_line(error: OptionError, option: Option) -> None:
    assert option.flag in str(error)
    assert re.fullmatch(".{,999}", str(error))


def admits(option: Option, value: float) -> bool:
    low, high = option.bounds or (-np.inf, np.inf)
    return option.bounds is None or low <= value <= high or (option.infinite and value == np.inf)


@given(option=st.sampled_from(BOUNDED), value=ODD)
def test_a_number_is_admitted_within_its_bounds_in_its_own_type_and_refused_in_one_line_elsewhere(option, value):
    try:
        admitted = option.check([value, value] if option.count else value)
    except OptionError as error:
        assert_one_line(error, option)
        inside = isinstance(value, int | float) and admits(option, value)
        assert not inside or (option.kind is int and value != int(value))
        return
    for one in admitted if option.count else [admitted]:
        assert isinstance(one, option.kind | int)
        assert admits(option, one)
        assert one == value


@given(command=st.sampled_from(["plan", "run", "estimate", "sweep"]), data=st.data())
def test_a_number_as_it_is_typed_is_read_within_its_bounds_or_refused_in_one_line(command, data):
    option = data.draw(st.sampled_from([option for option in options_of(command) if option.kind in (int, float)]))
    words = [data.draw(WORDS)] * (option.count if isinstance(option.count, int) else 1)
    needed = ["--at", "1", "2.5"] if command == "estimate" and option.name != "at" else []
    try:
        value = getattr(parser.read([command, "slit", *needed, f"--{option.name}", *words]), option.dest)
    except OptionError as error:
        assert_one_line(error, option)
        return
    for one in value if isinstance(value, list) else [value]:
        assert isinstance(one, option.kind)
        assert admits(option, one)


def test_every_number_but_places_is_bounded():
    """The scene knows what is too far."""
    assert all(option.bounds[0] < option.bounds[1] < np.inf for option in BOUNDED)
    assert {o.name for o in OPTIONS if o.kind in (int, float) and not o.bounds} == {"start", "goal", "at"}


@pytest.mark.parametrize(("name", "bytes"), [("samples", 8.0 * 3 * 19), ("vertices", 8.0 * 2 + 480.0)])
def test_a_plan_that_fits_into_no_memory_is_refused_before_it_is_made(slit, name, bytes):
    """Half of the memory must hold more than `bytes` for each sample of three classes, or each vertex."""
    check_size(slit, 8 * GIB)
    large = SimpleNamespace(
        settings=replace(slit.settings, **{name: 1_000_000}), problem=slit.problem, loaded=slit.loaded,
        system=slit.system, space=slit.space, classes_at_start=slit.classes_at_start,
    )  # fmt: skip
    with pytest.raises(OptionError, match=rf" GiB of memory.*--{name}"):
        check_size(large, 2e6 * bytes)
    check_size(large, 64 * GIB)


def test_what_one_of_several_methods_uses_is_not_refused():
    refuse_unused({"guide": "feedback", "horizon": 2.0, "consistency": None}, ["pi-rrht", "mppi"])
    refuse_unused({"guide": "open-loop", "draws": "independent"}, ["mppi"])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"method": "optimal"}, "--sense lidar needs a plant in MuJoCo and a method that replans"),
        ({"method": "mppi", "unknown": 1.0}, "--unknown is a price of references, and --method mppi has none"),
        ({"method": "mppi"}, None), ({"method": "pursuit", "unknown": 1.0}, None),
    ],
)  # fmt: skip
def test_whatever_replans_can_do_without_a_map(given, words):
    with pytest.raises(OptionError, match=words) if words else nullcontext():
        Settings(sense="lidar", **given)


# -- what follows from the records ------------------------------------------------------------------------------------


def test_defaults_are_of_the_kind_of_their_option_and_those_of_the_method():
    for name, option in BY_SETTING.items():
        value = getattr(Settings(), name)
        assert option.kind is bool or value is None or isinstance(value, option.kind)
    assert Settings().consistency == ControlSettings().consistency
    assert Settings().look_ahead == ControlSettings().look_ahead
    assert Settings().horizon == inspect.signature(Mppi).parameters["horizon"].default


@pytest.mark.parametrize("command", parser.COMMANDS)
def test_no_option_of_a_command_is_there_twice_and_its_help_lists_it(command, capsys):
    options = options_of(command)
    assert len({option.dest for option in options}) == len(options)
    shown = []
    for word in ("--help", "--help-all"):
        with pytest.raises(SystemExit):
            main([command, word])
        shown.append(capsys.readouterr().out)
    assert all(option.flag in shown[1] for option in options)
    assert all(option.flag in shown[0] for option in options if option.name in DAILY)


def test_the_help_of_run_fits_on_a_screen_and_names_what_people_use_daily(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(["run", "--help"])
    text = capsys.readouterr().out
    assert len(text.splitlines()) <= 62
    assert all(word in text for word in ("--help-all", "--footprint"))
    assert "Precedence: command line, preset, scene (custom numerics pirrht_NAME), robot." in text
    for system in map(named, names()):
        for robot in system.robots:
            assert re.search(rf"^{robot} .* {system.settings.samples} ", text, re.M)


def test_a_preset_scales_the_numbers_of_each_robot_and_the_papers_has_its_own_number_of_samples():
    for robot, samples, vertices in (("puck", 200, 1000), ("unicycle", 300, 2000)):
        assert prepare("slit", robot=robot, preset="paper").settings.samples == samples
        for preset, more, larger in (("fast", 0.25, 0.5), ("accurate", 4, 2)):
            chosen = prepare("slit", robot=robot, preset=preset).settings
            assert (chosen.samples, chosen.vertices) == (more * samples, larger * vertices)


def test_the_page_of_the_command_line_is_up_to_date():
    assert (ROOT / "docs" / "cli.md").read_text() == docs.page(), "run `python -m sim.cli.docs`"


def test_the_page_of_json_files_is_up_to_date():
    assert (ROOT / "docs" / "json.md").read_text() == docs.json_page(), "run `python -m sim.cli.docs`"


def test_the_version_has_one_source(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"pirrht {pirrht.__version__}\n"
    assert f'"{pirrht.__version__}"' not in (ROOT / "pyproject.toml").read_text()


def test_what_identifies_a_dataset_is_what_results_depend_on():
    free = {option.dest for option in options_of("sweep") if option.role == "command"} | {"threads"}
    grid = {"scenes", "methods", "noise", "seeds"}  # each run's own, reported next to the settings
    assert free - grid == {"threads", "jobs", "scheduler", "json", "output", "again"}
    assert {field.name for field in fields(Settings)} | set(BY_SCENE) == IDENTIFYING | {"threads"}


# -- numbers of a scene -----------------------------------------------------------------------------------------------


def scene_with(folder, **numerics: float) -> str:
    """The slit with other defaults."""
    text = (ROOT / "models" / "scenes" / "slit.xml").read_text()
    lines = "".join(f'<numeric name="pirrht_{name}" data="{value}"/>' for name, value in numerics.items())
    (folder / "own.xml").write_text(text.replace("<custom>", f"<custom>{lines}"))
    return str(folder / "own.xml")


def test_a_scene_wins_over_the_robot_and_the_command_line_over_both(tmp_path):
    scene = scene_with(tmp_path, horizon=4.5)
    found = [prepare(*task).settings.horizon for task in (("slit",), (scene,))]
    assert [*found, prepare(scene, given={"horizon": 2.0}).settings.horizon] == [3.0, 4.5, 2.0]


@pytest.mark.parametrize(("words", "hz"), [([], 25.0), (["--record-hz", "50"], 50.0), (["slit"], 5.0)])
def test_a_scene_decides_numbers_of_a_command_alone(tmp_path, monkeypatch, words, hz):
    shown = []
    monkeypatch.setattr(Look, "check", lambda self, space: shown.append(self.hz))
    scene = [] if words == ["slit"] else [scene_with(tmp_path, record_hz=25)]
    assert main(["run", *scene, *words, "--method", "passive", "--max-time", "0.02", *QUICK]) == 1
    assert shown == [hz]
