"""Commands of README and docs are understood, links lead somewhere, pages agree, and each example runs."""

import re
import runpy
import shlex
import sys

import benchmark
import gallery
import pytest
from documents import NAMES, PAGES, commands, links, models, named
from repository import ROOT

import pirrht
from sim import cli
from sim.cli import parser
from sim.cli.commands import DEMO_LEVELS, demo, demo_sentences
from sim.mjcf import load, scene_names

EXAMPLES = {  # a line of what each prints
    "01_first_plan": "b = 0.3: v = 12.",
    "02_psi_on_the_floor": "GGG",
    "03_mppi_comparison": "pi-rrht  reached the goal in 3 of 3 runs",
    "04_own_scene": "exit status 0",
    "05_own_robot": "class 0,0",
    "06_own_controller": "b = 0.1: 10 of 10 reach the goal",
    "07_moving_obstacles": "2 s: the disc is predicted at (3.25, 2.29)",
    "08_sweep": "6 of 6 runs asked for are there",
    "09_occupancy_grid": "classes 1,0, 0,-1",
    "10_custom_proposal": "within",
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_of_at_most_eighty_lines_runs(name, tmp_path, monkeypatch, capsys):
    if name == "06_own_controller":
        pytest.importorskip("gymnasium")
    folder = ROOT / "scripts" / "examples"
    file = folder / f"{name}.py"
    assert len(file.read_text().splitlines()) <= 80
    assert {other.stem for other in folder.glob("*.py")} == EXAMPLES.keys()
    monkeypatch.setattr(sys, "argv", [str(file), str(tmp_path)])
    runpy.run_path(str(file), run_name="__main__")
    assert EXAMPLES[name] in capsys.readouterr().out


# -- commands ----------------------------------------------------------------------------------------------------

ALL = [pytest.param(line, id=f"{page.name}: {line}") for page in PAGES for line in dict.fromkeys(commands(page))]


@pytest.mark.parametrize("line", ALL)
def test_every_command_of_the_pages_is_one_that_is_understood(line):
    assert parser.read(shlex.split(line)[1:]).command in line


def test_the_demo_runs_twice_and_ends_with_two_sentences(capsys):
    assert demo(parser.read(["demo"]), ("--vertices", "60", "--samples", "10", "--max-time", "0.03")) == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if "noise: pirrht run" in line] == [
        f"{word} noise: pirrht run slit --noise {noise:g}" for word, noise in DEMO_LEVELS
    ]
    assert [line[:2] for line in lines[-2:]] == ["1.", "2."]


def test_sentences_of_the_demo_report_its_runs():
    runs = [{"outcome": "goal", "executed_class": name} for name in ("0,0", "-1,0")]
    first, second = demo_sentences(*runs)
    assert "b = 0.1 the robot went through the slit, with b = 0.3 around the slit, above." in first
    assert "exp(-cost / lambda)" in second
    assert "went into a wall, with" in demo_sentences({"outcome": "collision", "executed_class": None}, runs[1])[0]


def test_a_scene_of_ones_own_has_a_class_on_each_side_of_an_obstacle(tmp_path, capsys):
    (tmp_path / "garden.xml").write_text(models()["garden"])
    assert cli.main(["plan", str(tmp_path / "garden.xml"), "--vertices", "300"]) == 0
    assert len(re.findall(r"^-?\d+(?:,-?\d+)+ ", capsys.readouterr().out, re.M)) >= 2


# -- words, links, pictures --------------------------------------------------------------------------------------


def test_the_readme_is_short_and_opens_with_a_moving_picture():
    text = named("README.md").read_text()
    assert len(text.encode()) < 6_500
    with pytest.importorskip("PIL.Image").open(ROOT / re.findall(r"!\[[^\]]*\]\((.*?)\)", text)[0]) as picture:
        assert picture.n_frames > 10
    assert text.index("scripts/demo.sh") < text.index("scripts/test.sh") < text.index("pirrht run")


def test_every_page_is_in_the_navigation_and_links_lead_to_pages_files_and_small_pictures():
    listed = set(re.findall(r"([\w-]+\.md)", (ROOT / "mkdocs.yml").read_text()))
    assert listed == {page.name for page in PAGES[1:]} | {"changelog.md"}  # that one is made by scripts/site_hook.py
    targets = {(page.parent / target).resolve() for page in PAGES for target in links(page)}
    assert [one.name for one in targets if not one.exists()] in ([], ["changelog.md"])
    assert {page.name for page in set(PAGES) - targets} <= {"README.md", "index.md"}
    pictures = {path for path in (ROOT / "docs").rglob("*") if path.suffix in (".png", ".webp", ".gif", ".mp4")}
    assert pictures <= targets
    assert sum(path.stat().st_size for path in pictures) < 3_000_000


def test_the_gallery_shows_every_scene_with_its_own_sentence():
    assert named("gallery.md").read_text() == gallery.page()
    assert all(
        load(name).about.endswith((".", "?", ").")) and 20 < len(load(name).about) <= 120 for name in scene_names()
    )


# -- figures -----------------------------------------------------------------------------------------------------

VERSION = r"(?<![\d.])(\d+)\.(\d+)\.\d+(?![\d.])"
BENCHMARK = r"benchmark\.py (\w+)(?: --part (\w+))?"


@pytest.mark.parametrize("page", NAMES)
def test_versions_that_a_page_names_are_this_one_or_the_minor_one_before(page):
    major, minor = map(int, pirrht.__version__.split(".")[:2])
    named_here = {(int(a), int(b)) for a, b in re.findall(VERSION, named(page).read_text())}
    assert named_here <= {(major, minor), (major, minor - 1)}, "measure these figures again, or leave them out"


def test_every_table_of_results_names_its_version_and_a_benchmark_that_is_there():
    sections = [text for text in re.split(r"^## ", named("results.md").read_text(), flags=re.M) if "|---|" in text]
    assert len(sections) > 3
    assert all(re.search(BENCHMARK, text) and re.search(f"version {VERSION}", text) for text in sections)
    for what, part in {found for page in PAGES for found in re.findall(BENCHMARK, page.read_text())}:
        assert what in benchmark.TABLES
        assert not part or part in benchmark.PARTS.get(what, ())
