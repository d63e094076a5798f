"""The long tests of integration/test_readme.py."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys

import pytest
from documents import NAMES, PAGES, blocks, commands, named
from integration.test_readme import (
    NOTEBOOKS,
    folder,  # noqa: F401
    run,
)
from notebooks import code_of
from repository import ROOT, environment
from thoroughly import first, thorough

from sim import cli

SMALL = {  # words that make a command a matter of a moment
    "plan": ("--vertices", "80"),
    "run": ("--vertices", "80", "--samples", "10", "--max-time", "0.03"),
    "estimate": ("--vertices", "80", "--samples", "20", "--repeat", "1"),
    "sweep": ("--vertices", "80", "--samples", "10", "--max-time", "0.03", "--seeds", "0:1", "--jobs", "1"),
}


SHOWN = re.compile(r"--(serve|view|connect|scheduler)\b")  # these wait for somebody


ELSEWHERE = {"pirrht demo"}  # a test of its own runs it


PAGE = "README.md"  # of others, the thorough suite


@pytest.mark.parametrize("page", [n if n == PAGE else thorough(n) for n in NAMES])
def test_every_command_of_a_page_runs_in_the_order_of_the_page(page, folder, monkeypatch, capsys):
    """With few vertices and samples, and only a moment of driving."""
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(folder)
    for line in dict.fromkeys(commands(named(page))):
        words = shlex.split(line)[1:]
        if SHOWN.search(line) or line in ELSEWHERE or (words[0] == "play" and "--headless" not in words):
            continue
        _optional(words)
        if "--script" in words:
            (folder / words[words.index("--script") + 1]).write_text('[{"at": 0.05, "push": [0.0, 0.2]}]')
        status = cli.main([*words, *_small(words)])
        assert status in ((0, 1) if words[0] in ("run", "sweep") else (0,)), capsys.readouterr().err


def _small(words: list[str]) -> list[str]:
    """What a command is given beside; a car that accelerates has guides that take long to compile."""
    more = list(SMALL.get(words[0], ()))
    return ["--vertices", "30", *more[2:]] if "--convergence" in words else more


def _optional(words: list[str]) -> None:
    if "--video" in words or (words[0] == "run" and "--png" in words):
        pytest.importorskip("av")
    if "--png" in words:
        pytest.importorskip("matplotlib")


# -- snippets ----------------------------------------------------------------------------------------------------


def test_the_first_snippet_drives_and_names_the_favourite_class(tmp_path):
    lines = run(blocks(named("README.md"), "python")[0], tmp_path).splitlines()
    assert lines[-1] in ("class 1 0", "class 0 -1", "class 0 0")


API = "\n".join(blocks(named("api.md"), "python"))  # one script, from top to bottom
SNIPPETS = [
    pytest.param(text, id=f"{page.name} {i}")
    for page in PAGES[1:]
    for i, text in enumerate([API] if page.name == "api.md" else blocks(page, "python"), 1)
    if "class Boat(" not in text
]


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_every_other_snippet_runs(snippet, folder):
    if "gym" in snippet:
        pytest.importorskip("gymnasium")
    run(re.sub(r"range\(\d+\)", "range(2)", snippet), folder)


@pytest.mark.thorough
def test_a_system_of_ones_own_reaches_the_goal(folder):
    (boat,) = (text for text in blocks(named("own-robot.md"), "python") if "class Boat(" in text)
    assert run(boat, folder).strip() == "GOAL"


@pytest.mark.parametrize("notebook", first(NOTEBOOKS), ids=lambda path: path.stem)
def test_a_notebook_runs_from_its_first_cell_to_its_last(notebook, tmp_path):
    pytest.importorskip("matplotlib")
    said = run(code_of(notebook), tmp_path)
    assert "GOAL after" in said


def test_the_site_is_built_without_a_warning(tmp_path):
    pytest.importorskip("mkdocs")
    pytest.importorskip("mkdocstrings_handlers.python")
    pytest.importorskip("material")
    pytest.importorskip("latex2mathml")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        env=environment(),
    )
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "site" / "api.html").read_text()
    for name in ("Problem", "HomologyTree", "Controller", "Desirability", "prepare"):
        assert f">{name}<" in text
    assert (tmp_path / "site" / "changelog.html").is_file()
    assert text.count("<math") > 15
    assert text.count('<span class="doc-section-title">Examples:</span>') > 5
    assert ">Example<" not in text  # a box whose prompts are quotations
    assert "<math" in (tmp_path / "site" / "method.html").read_text()
    assert (tmp_path / "site" / "search" / "search_index.js").is_file()
    assert not re.findall(r'<script src="https?:', text)
