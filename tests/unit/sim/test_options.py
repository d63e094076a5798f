"""The table of options: complete, bounded, and all that parser, scenes, help and datasets know of options."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mjcf_samples import FLOOR, SITES, mjcf
from repository import ROOT
from sim.options.record import Option
from sim.options.table import BY_SETTING, IDENTIFYING, OPTIONS, check, options_of

import pirrht
from pirrht.control.baselines import Mppi
from pirrht.control.settings import ControlSettings
from pirrht.errors import OptionError
from sim import settings
from sim.cli import docs, main, parser
from sim.scenario import prepare
from sim.settings import PRESETS, Settings
from sim.systems import named, names

COMMANDS = tuple(parser.COMMANDS)
QUICK = ["--vertices", "30", "--samples", "4"]
PLACES = {"start", "goal", "at"}  # the scene knows what is too far
NUMBERS = [option for option in OPTIONS if option.number]
BOUNDED = [option for option in NUMBERS if option.bounds]
ODD = st.one_of(st.floats(), st.integers(), st.sampled_from([10**400, -(10**400), "x", "", None]))
WORDS = st.one_of(
    st.floats().map(str), st.integers().map(str), st.sampled_from(["1" + "0" * 400, "x", "", "1e999", "0x1"])
)


# -- every number, however hostile, is refused in one line or admitted -------------------------------------------------


def assert_one_line(error: OptionError, option: Option) -> None:
    assert option.flag in str(error)
    assert "\n" not in str(error)
    assert len(str(error)) < 1000


@given(option=st.sampled_from(BOUNDED), value=ODD)
def test_a_number_is_admitted_within_its_bounds_in_its_own_type_and_refused_in_one_line_elsewhere(option, value):
    bounds = option.bounds
    try:
        admitted = option.check([value, value] if option.count else value)
    except OptionError as error:
        assert_one_line(error, option)
        inside = isinstance(value, int | float) and bounds.admit(value)
        assert not inside or (option.kind is int and value != int(value))
        return
    for one in admitted if option.count else [admitted]:
        assert isinstance(one, option.kind | int)
        assert bounds.admit(one)
        assert one == value


@given(command=st.sampled_from(["plan", "run", "estimate", "sweep"]), data=st.data())
def test_a_number_as_it_is_typed_is_read_within_its_bounds_or_refused_in_one_line(command, data):
    options = [option for option in options_of(command) if option.number]
    option, word = data.draw(st.sampled_from(options)), data.draw(WORDS)
    words = [word] * (option.count if isinstance(option.count, int) else 1)
    needed = ["--at", "1", "2.5"] if command == "estimate" and option.name != "at" else []
    try:
        arguments = parser.read([command, "slit", *needed, f"--{option.name}", *words])
    except OptionError as error:
        assert_one_line(error, option)
        return
    value = getattr(arguments, option.dest)
    for one in value if isinstance(value, list) else [value]:
        assert isinstance(one, option.kind)
        assert option.bounds is None or option.bounds.admit(one)


@pytest.mark.parametrize("option", BOUNDED, ids=lambda option: f"{option.commands[0]}-{option.name}")
def test_both_bounds_are_allowed(option):
    pair = [option.kind(option.bounds.low), option.kind(option.bounds.high)]
    for value in [pair] if option.count else pair:
        assert option.check(value) == value


# -- bounds -----------------------------------------------------------------------------------------------------------


def test_every_number_but_places_has_bounds_with_a_reason():
    for option in NUMBERS:
        if option.name not in PLACES:
            assert option.bounds is not None, option.name
            assert option.bounds.low < option.bounds.high < np.inf, option.name
            assert len(option.bounds.why.split()) >= 5, option.name


def test_a_plan_that_fits_into_no_memory_is_refused_before_it_is_made():
    scenario = prepare("slit")
    size = settings.Size(
        states=2, controls=2, obstacles=2, classes=3, distance=4.5, speed=1.0, temperature=0.02, rate=1.0
    )
    settings.check(scenario.settings, size, 8 * settings.GIB)
    for changes, option in (({"samples": 1_000_000}, "--samples"), ({"vertices": 1_000_000}, "--vertices")):
        large = Settings(**changes)
        needed = size.tree(large) if option == "--vertices" else size.sampling(large)
        settings.check(large, size, 2.1 * needed)
        with pytest.raises(OptionError, match=rf"{needed / settings.GIB:.3g} GiB.*{option}"):
            settings.check(large, size, 1.9 * needed)


@pytest.mark.parametrize(("temperature", "remedy"), [(3e3, "raise --dt or lower --noise"), (3e6, "lower --noise")])
def test_a_longer_step_is_asked_for_only_where_one_is_long_enough(temperature, remedy):
    """Paths of 40 lambda / q: 100 000 steps of 10 s at most are enough for 10^6 s."""
    size = settings.Size(
        states=2, controls=2, obstacles=2, classes=3, distance=4.5, speed=1.0, temperature=temperature, rate=1.0
    )
    with pytest.raises(OptionError, match=rf"are possible; {remedy}$"):
        settings.check(Settings(dt=0.1), size, 8 * settings.GIB)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("--dt 0.00001", "--dt 1e-05: a path of 9.8 s has 9.8e+05 steps"),
        ("--noise 100", "or lower --noise"),
        ("--max-time 80000 --period 0.002", "--max-time 80000 is 4e+07 periods"),
        ("--grow 9000", "--grow 9000 adds up to"),
        ("--classes 10000 --limit 100", "GiB of memory"),
        ("--method mppi --horizon 9000 --dt 0.01", "or lower --horizon"),
    ],
)
def test_what_would_never_end_is_refused_with_what_to_change(words, what, capsys):
    assert main(["run", "slit", *words.split()]) == 2
    assert what in capsys.readouterr().err


# -- what follows from the table --------------------------------------------------------------------------------------


def test_every_setting_is_an_option_and_the_other_way_round():
    assert {field.name for field in fields(Settings)} == set(BY_SETTING)
    for name, option in BY_SETTING.items():
        value = getattr(Settings(), name)
        assert option.kind is bool or value is None or isinstance(value, option.kind)


def test_what_is_slow_to_import_is_said_again_and_the_same():
    assert Settings().consistency == ControlSettings().consistency
    assert Settings().horizon == inspect.signature(Mppi).parameters["horizon"].default


@pytest.mark.parametrize("command", COMMANDS)
def test_no_option_of_a_command_is_there_twice_and_its_help_says_it(command, capsys):
    options = options_of(command)
    assert len({option.dest for option in options}) == len(options)
    with pytest.raises(SystemExit):
        main([command, "--help"])
    short = capsys.readouterr().out
    with pytest.raises(SystemExit):
        main([command, "--help-all"])
    full = capsys.readouterr().out
    typed = {option.metavar if option.positional else option.flag: option.common for option in options}
    assert all(flag in full for flag in typed)
    assert all(flag in short for flag, common in typed.items() if common)


def test_the_help_of_run_fits_on_a_screen_and_names_what_people_use_daily(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    lines = parser.help_of("run", everything=False).splitlines()
    assert len(lines) <= 60
    daily = (
        "robot start goal noise speed seed method samples vertices preset real-time record view video png json help-all"
    )
    assert not [name for name in daily.split() if f"--{name}" not in "\n".join(lines)]


def test_the_help_has_a_row_for_each_robot_and_the_precedence_of_settings():
    text = parser.help_of("run", everything=False)
    for name in names():
        assert f"{named(name).settings.samples}" in re.search(rf"^{named(name).robots} .*$", text, re.M).group(0)
    assert "Precedence: command line, preset, scene (custom numerics pirrht_NAME), robot." in text


@pytest.mark.parametrize("preset", ["fast", "accurate"])
def test_a_preset_scales_the_numbers_of_each_robot(preset):
    for robot, samples, vertices in (("puck", 200, 1000), ("unicycle", 300, 2000)):
        chosen = prepare("slit", robot=robot, preset=preset).settings
        factor = PRESETS[preset].factors["samples"]
        assert (chosen.samples, chosen.vertices) == (factor * samples, PRESETS[preset].factors["vertices"] * vertices)


def test_the_page_of_the_command_line_is_up_to_date():
    assert (ROOT / "docs" / "cli.md").read_text() == docs.page(), "run `python -m sim.cli.docs`"


def test_the_version_has_one_source(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"pirrht {pirrht.__version__}\n"
    assert f'"{pirrht.__version__}"' not in (ROOT / "pyproject.toml").read_text()


def test_what_identifies_a_dataset_is_what_results_depend_on():
    free = {option.dest for option in options_of("sweep")} - IDENTIFYING
    grid = {"scenes", "methods", "noise", "seeds"}  # each run's own, told beside the settings
    assert free - grid == {"threads", "jobs", "scheduler", "json", "output", "again"}


def test_the_papers_preset_is_what_options_say_of_it():
    assert PRESETS["paper"].fixed.keys() == {
        *("dt", "period", "exit", "steps", "weights", "guide", "allocation", "draws", "between"),
    }
    assert prepare("slit", preset="paper").settings.samples == 200
    assert prepare("slit", robot="unicycle", preset="paper").settings.samples == 300


def test_checks_do_not_need_a_scene():
    with pytest.raises(OptionError, match="--repeat is 0"):
        check("estimate", {"repeat": 0})
    check("estimate", {"repeat": None, "at": [1.0, 2.0]})


# -- what a scene says ------------------------------------------------------------------------------------------------


def scene_with(folder: Path, **numerics: float) -> str:
    """The slit with other defaults."""
    text = (ROOT / "models" / "scenes" / "slit.xml").read_text()
    lines = "".join(f'<numeric name="pirrht_{name}" data="{value}"/>' for name, value in numerics.items())
    scene = folder / "own.xml"
    scene.write_text(text.replace("<custom>", f"<custom>{lines}"))
    return str(scene)


def test_a_scene_says_how_often_an_estimate_is_repeated_and_the_command_line_wins(tmp_path, capsys):
    words = ["estimate", scene_with(tmp_path, repeat=3), "--at", "1", "2.5", "--method", "passive", *QUICK]
    assert main(words) == 0
    assert capsys.readouterr().out.splitlines()[-2].split()[0] == "2"
    assert main([*words, "--repeat", "2"]) == 0
    assert capsys.readouterr().out.splitlines()[-2].split()[0] == "1"


@pytest.mark.parametrize(("said", "hz"), [([], 25.0), (["--record-hz", "50"], 50.0)])
def test_a_scene_says_how_often_a_recording_is_drawn_and_the_command_line_wins(tmp_path, monkeypatch, said, hz):
    from sim.cli import run_command

    seen = {}
    monkeypatch.setattr(run_command, "_recorder", lambda arguments, *_: seen.update(hz=arguments.record_hz))
    words = ["run", scene_with(tmp_path, record_hz=25), "--method", "passive", "--max-time", "0.02", *QUICK]
    assert main([*words, *said]) == 1
    assert seen["hz"] == hz


def test_without_a_word_of_the_scene_five_pictures_a_second_are_recorded(monkeypatch):
    from sim.cli import run_command

    seen = {}
    monkeypatch.setattr(run_command, "_recorder", lambda arguments, *_: seen.update(hz=arguments.record_hz))
    assert main(["run", "slit", "--method", "passive", "--max-time", "0.02", *QUICK]) == 1
    assert seen["hz"] == 5.0


@pytest.mark.parametrize("name", ["rounds", "memory"])
def test_an_option_that_is_gone_is_refused_in_a_scene_by_that_word(tmp_path, capsys, name):
    assert main(["plan", scene_with(tmp_path, **{name: 2})]) == 2
    assert f'custom numeric "pirrht_{name}" is gone: ' in capsys.readouterr().err


def test_a_scene_wins_over_the_robot_and_the_command_line_over_both(tmp_path):
    scene = scene_with(tmp_path, horizon=4.5)
    assert prepare("slit").settings.horizon == 3.0
    assert prepare(scene).settings.horizon == 4.5
    assert prepare(scene, given={"horizon": 2.0}).settings.horizon == 2.0


@pytest.mark.parametrize(
    ("element", "what"),
    [
        ('<geom name="rock" size="0.2" pos="nan 5 0"/>', 'geom "rock" has pos="nan 5 0"'),
        ('<body name="crate" euler="0 0 NaN"><geom size="0.2"/></body>', 'body "crate" has euler="0 0 NaN"'),
        ('<geom size="-nan" pos="5 5 0"/>', 'geom has size="-nan"'),
        ('<geom name="far" size="0.2" pos="1e9 5 0"/>', 'geom "far" has a place or size of 1e+09 m'),
    ],
)
def test_what_is_no_number_in_a_scene_is_refused_by_element_and_file(tmp_path, capsys, element, what):
    scene = tmp_path / "odd.xml"
    scene.write_text(mjcf(FLOOR + SITES + element))
    assert main(["plan", str(scene), *QUICK]) == 2
    told = capsys.readouterr().err
    assert f"{scene}: {what}" in told
    assert told.count("\n") == 1


def test_what_is_no_number_in_an_included_file_is_refused_with_that_file(tmp_path, capsys):
    part, scene = tmp_path / "part.xml", tmp_path / "whole.xml"
    part.write_text('<mujoco><worldbody><geom name="rock" size="0.2" pos="nan 5 0"/></worldbody></mujoco>')
    scene.write_text(mjcf(FLOOR + SITES).replace("<worldbody>", '<include file="part.xml"/><worldbody>', 1))
    assert main(["plan", str(scene), *QUICK]) == 2
    assert f'{part}: geom "rock" has pos="nan 5 0"' in capsys.readouterr().err


def test_a_geom_may_be_called_nan(tmp_path, capsys):
    scene = tmp_path / "grandmother.xml"
    scene.write_text(mjcf(FLOOR + SITES + '<geom name="nan" type="cylinder" size="0.5 0.5" pos="5 5 0.5"/>'))
    assert main(["plan", str(scene), *QUICK]) == 0


@pytest.mark.parametrize(("words", "told"), [([], ""), (["--predict", "velocity"], "--predict changes nothing here")])
def test_an_option_for_bodies_that_move_says_so_where_none_does(capsys, words, told):
    assert main(["plan", "slit", "--vertices", "60", *words]) == 0
    said = capsys.readouterr().out
    assert told in said
    assert said.count("changes nothing") == bool(words)
