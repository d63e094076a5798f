"""The long tests of integration/test_readme.py: every command and snippet of a page runs, and the site is built."""

import json
import re
import shlex
import shutil

import numpy as np
import pytest
import trimesh
from commands import call
from documents import NAMES, PAGES, blocks, commands, models, named
from repository import ROOT
from thoroughly import first, thorough

from sim import cli

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
WALLS = [((-5, 2, 0), (5, 2.2, 2)), ((-5, -2.2, 0), (5, -2, 2)), ((1, -1, 0), (1.2, 1, 2))]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory):
    """A folder with all that pages tell their reader to save, and a map and a world to import."""
    place = tmp_path_factory.mktemp("reader")
    for file in (ROOT / "scripts" / "examples" / "systems").iterdir():
        if file.is_file():
            shutil.copy(file, place)
    balloon, boat = (
        next(t for p in PAGES for t in blocks(p, "python") if f"class {n}(" in t) for n in ("Balloon", "GroundTrack")
    )
    cells = np.full((100, 120), 254, np.uint8)
    cells[40:60, 50:60] = 0
    (place / "map.pgm").write_bytes(b"P5 120 100 255\n" + cells.tobytes())
    known = {f"{name}.xml": text for name, text in models().items()} | {
        "balloon.py": balloon,
        "my_boat.py": boat,
        "map.yaml": "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\n"
        "free_thresh: 0.196\n",
        "WORLD.world": OFFICE,
        "task.xml": TASK,
        "worlds.json": '{"36": {"obstacles": [{"name": "a", "radius": 0.4, "keys": [[0, 0, 5], [4, 0, -5]]}]}}',
    }
    for name, text in known.items():
        (place / name).write_text(text)
    trimesh.util.concatenate([trimesh.creation.box(bounds=bounds) for bounds in WALLS]).export(place / "room.obj")
    return place


SMALL = {  # words that make a command a matter of a moment
    "plan": ("--vertices", "80"),
    "run": ("--vertices", "80", "--samples", "10", "--max-time", "0.03"),
    "estimate": ("--vertices", "80", "--samples", "20", "--repeat", "1"),
    "sweep": ("--vertices", "80", "--samples", "10", "--max-time", "0.03", "--seeds", "0:1", "--jobs", "1"),
}
SHOWN = re.compile(r"--(serve|view|connect|scheduler)\b|pirrht demo$")  # these wait, or have a test of their own


@pytest.mark.parametrize("page", [n if n == "README.md" else thorough(n) for n in NAMES])
def test_every_command_of_a_page_runs_in_the_order_of_the_page(page, folder, monkeypatch, capsys):
    """With few vertices and samples, and only a moment of driving."""
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(folder)
    for line in dict.fromkeys(commands(named(page))):
        words = shlex.split(line)[1:]
        if SHOWN.search(line) or (words[0] == "play" and "--headless" not in words):
            continue
        if "--video" in words or (words[0] == "run" and "--png" in words):
            pytest.importorskip("av")
        if "--png" in words:
            pytest.importorskip("matplotlib")
        if "--script" in words:
            (folder / words[words.index("--script") + 1]).write_text('[{"at": 0.05, "push": [0.0, 0.2]}]')
        status = cli.main([*words, *SMALL.get(words[0], ())])
        assert status in ((0, 1) if words[0] in ("run", "sweep") else (0,)), capsys.readouterr().err


# -- snippets ----------------------------------------------------------------------------------------------------


API = "\n".join(blocks(named("api.md"), "python"))  # one script, from top to bottom
ENDS = {blocks(named("README.md"), "python")[0]: "class (1,0|0,-1|0,0)"}  # last lines
SNIPPETS = [
    pytest.param(text, id=f"{page.name} {i}")
    for page in PAGES
    for i, text in enumerate([API] if page.name == "api.md" else blocks(page, "python"), 1)
]


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_every_snippet_runs(snippet, folder):
    if "gym" in snippet:
        pytest.importorskip("gymnasium")
    lines = call(folder, "-c", re.sub(r"range\(\d+\)", "range(2)", snippet)).splitlines()
    assert all(re.fullmatch(last, lines[-1]) for part, last in ENDS.items() if part in snippet)


NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("notebook", first(NOTEBOOKS), ids=lambda path: path.stem)
def test_a_notebook_runs_from_its_first_cell_to_its_last(notebook, tmp_path):
    pytest.importorskip("matplotlib")
    cells = [cell["source"] for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    assert "GOAL after" in call(tmp_path, "-c", "\n".join(map("".join, cells)))


def test_the_site_is_built_without_a_warning(tmp_path):
    for module in ("mkdocs", "mkdocstrings_handlers.python", "material", "latex2mathml"):
        pytest.importorskip(module)
    call(ROOT, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site"))
    text = (tmp_path / "site" / "api.html").read_text()
    assert all(f">{name}<" in text for name in ("Problem", "HomologyTree", "Controller", "Desirability", "prepare"))
    assert (tmp_path / "site" / "changelog.html").is_file()
    assert text.count("<math") > 15
    assert text.count('<span class="doc-section-title">Examples:</span>') > 5
    assert ">Example<" not in text  # a box whose prompts are quotations
    assert "<math" in (tmp_path / "site" / "method.html").read_text()
    assert (tmp_path / "site" / "search" / "search_index.js").is_file()
    assert not re.findall(r'<script src="https?:', text)


def test_the_site_typesets_formulas_of_docstrings_and_pages_and_leaves_code_as_it_is():
    pytest.importorskip("mkdocs")
    pytest.importorskip("latex2mathml")
    from site_hook import FORMULAS, on_page_markdown, typeset

    sources = " ".join(re.sub(r"\s+", " ", file.read_text()) for file in sorted((ROOT / "pirrht").rglob("*.py")))
    assert not [formula for formula in FORMULAS if formula not in sources]
    text = "<h3>phi</h3><p>v = -lambda log\npsi of <code>phi</code> and <code>lambda R^-1 = s s'</code>, log_psi</p>"
    found = typeset(text)
    assert found.count("<math") == 2
    assert all(kept in found for kept in ("<h3>phi</h3>", "<code>phi</code>", "log_psi"))
    assert '<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">' in on_page_markdown("a\n\n$$ x^2 $$\n")
