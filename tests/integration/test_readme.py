"""Commands of README and docs are understood, links lead somewhere, and what two pages have in common agrees."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import benchmark
import numpy as np
import pytest
import trimesh
from documents import NAMES, PAGES, blocks, commands, links, models, named
from repository import ROOT, environment

import pirrht
from sim import cli
from sim.cli import parser
from sim.cli.commands import DEMO_LEVELS, demo, demo_sentences
from sim.mjcf import load, scene_names

WORLD = """<sdf version="1.6"><world name="posts"><model name="post"><static>true</static><pose>-2.2 8 0 0 0 0</pose>
<link name="post"><collision name="post">
<geometry><cylinder><radius>0.3</radius><length>1</length></cylinder></geometry>
</collision></link></model></world></sdf>"""


def run(code: str, folder: Path) -> str:
    known = {**environment(folder), "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=240, env=known
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


OFFICE = """<sdf version="1.7"><world name="office">
<model name="ground"><static>1</static><link name="l"><collision name="c"><geometry><plane><normal>0 0 1</normal>
<size>12 12</size></plane></geometry></collision></link></model>
<model name="desk"><static>1</static><pose>3 2.5 0.4 0 0 0</pose><link name="l"><collision name="c"><geometry><box>
<size>1 0.6 0.8</size></box></geometry></collision></link></model></world></sdf>"""
TASK = """<mujoco><worldbody><geom type="plane" size="4 3 0.1"/>
<geom name="shelf" type="box" size="0.3 1 0.5" pos="0 0 0.5"/>
<body name="agent" pos="-2 2 0.3"><joint name="x" type="slide" axis="1 0 0"/><geom size="0.3"/></body>
<body name="door" pos="1 -2 0.5"><joint name="hinge" axis="0 0 1"/><geom type="box" size="0.5 0.05 0.5"/></body>
</worldbody><actuator><motor joint="x"/></actuator></mujoco>"""
WALLS = [((-5, 2, 0), (5, 2.2, 1)), ((-5, -2.2, 0), (5, -2, 1)), ((1, -1, 0), (1.2, 1, 1))]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all that pages tell their reader to save, and a map and a world to import."""
    place = tmp_path_factory.mktemp("reader")
    for file in (ROOT / "scripts" / "examples" / "systems").iterdir():
        if file.is_file():
            shutil.copy(file, place)
    balloon, boat = (
        next(t for p in PAGES for t in blocks(p, "python") if f"class {n}(" in t) for n in ("Balloon", "Boat")
    )
    system = next(text for text in blocks(named("own-robot.md"), "") if text.startswith("BOAT = "))
    steps = boat[: boat.index("loaded = load(")]
    cells = np.full((100, 120), 254, np.uint8)
    cells[40:60, 50:60] = 0
    (place / "map.pgm").write_bytes(b"P5 120 100 255\n" + cells.tobytes())
    known = {f"{name}.xml": text for name, text in models().items()} | {
        "balloon.py": balloon,
        "my_boat.py": f"{steps}\nfrom sim.systems import System\n\n{system}",
        "map.yaml": "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\n"
        "free_thresh: 0.196\n",
        "WORLD.world": WORLD,
        "office.world": OFFICE,
        "task.xml": TASK,
        "worlds.json": blocks(named("moving.md"), "json")[0],
    }
    for name, text in known.items():
        (place / name).write_text(text)
    walls = [trimesh.creation.box(bounds=bounds) for bounds in WALLS]
    trimesh.util.concatenate(walls).export(place / "room.obj")
    return place


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


@pytest.mark.parametrize(
    ("little", "much", "line"),
    [
        (("goal", "0,0"), ("goal", "-1,0"), "went through the slit, with b = 0.3 around the slit, above"),
        (("collision", None), ("timeout", None), "went into a wall, with b = 0.3 nowhere in time"),
    ],
)
def test_sentences_of_the_demo_report_its_runs(little, much, line):
    first, second = demo_sentences(*({"outcome": end, "executed_class": name} for end, name in (little, much)))
    assert f"b = 0.1 the robot {line}" in first
    assert "exp(-cost / lambda)" in second


def test_a_scene_of_ones_own_has_a_class_on_each_side_of_an_obstacle(folder, capsys):
    assert cli.main(["plan", str(folder / "garden.xml"), "--vertices", "300"]) == 0
    assert len(re.findall(r"^-?\d+(?:,-?\d+)+ ", capsys.readouterr().out, re.M)) >= 2


NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


# -- words, links, pictures --------------------------------------------------------------------------------------


def test_the_readme_is_short_and_opens_with_a_moving_picture():
    text = named("README.md").read_text()
    assert len(text.encode()) < 6_500
    image = pytest.importorskip("PIL.Image")
    with image.open(ROOT / re.findall(r"!\[[^\]]*\]\((.*?)\)", text)[0]) as picture:
        assert picture.n_frames > 10
    assert text.index("scripts/demo.sh") < text.index("scripts/test.sh") < text.index("pirrht run")


def test_links_lead_to_files_and_every_picture_is_shown_and_all_together_are_small():
    targets = {(page.parent / target).resolve() for page in PAGES for target in links(page)}
    made = ROOT / "docs" / "changelog.md"  # by scripts/site_hook.py
    assert not [target for target in targets if target != made and not target.exists()]
    pictures = {path for path in (ROOT / "docs").rglob("*") if path.suffix in (".png", ".webp", ".gif", ".mp4")}
    assert not pictures - targets
    assert sum(path.stat().st_size for path in pictures) < 3_000_000


def test_every_page_is_in_the_navigation_and_reached_from_the_readme():
    listed = set(re.findall(r"([\w-]+\.md)", (ROOT / "mkdocs.yml").read_text()))
    assert listed == {page.name for page in PAGES[1:]} | {"changelog.md"}
    reached, waiting = set(), {"README.md"}
    while waiting:
        reached |= waiting
        found = {Path(target).name for name in waiting for target in links(named(name))}
        waiting = (found & set(NAMES)) - reached
    assert set(NAMES) - reached <= {"index.md"}


def test_the_gallery_shows_every_scene_with_its_own_sentence():
    import gallery

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


def test_every_table_of_results_names_its_command_and_its_version():
    sections = [text for text in re.split(r"^## ", named("results.md").read_text(), flags=re.M) if "|---|" in text]
    assert len(sections) > 3
    assert not [
        t.splitlines()[0] for t in sections if not (re.search(BENCHMARK, t) and re.search(f"version {VERSION}", t))
    ]


def test_benchmarks_that_pages_name_are_there():
    parts = {part for page in PAGES for part in re.findall(BENCHMARK, page.read_text())}
    assert len(parts) > 3
    assert {what for what, _ in parts} <= set(benchmark.TABLES)
    assert not [(what, part) for what, part in parts if part and part not in benchmark.PARTS.get(what, ())]
