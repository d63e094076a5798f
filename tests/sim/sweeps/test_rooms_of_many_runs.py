"""Sweeps, reports and imports are libraries: the command line imports them, and they nothing of it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from repository import ROOT

FILES = sorted(file for room in ("sweeps", "report", "importing") for file in (ROOT / "sim" / room).glob("*.py"))


def imported(file: Path) -> set[str]:
    """Every module that a file names in an import, late ones included."""
    nodes = list(ast.walk(ast.parse(file.read_text())))
    named = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    froms = [node for node in nodes if isinstance(node, ast.ImportFrom)]
    return named | {f"{node.module}.{alias.name}" for node in froms for alias in node.names}


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}.{file.stem}")
def test_no_room_of_many_runs_knows_the_command_line(file):
    assert not {name for name in imported(file) if name.startswith(("sim.cli", "argparse"))}


def test_the_command_line_reaches_sweeps_on_one_way_only():
    """commands -> sweep_commands -> sweeps; nothing leads back."""
    assert not {name for name in imported(ROOT / "sim/cli/sweep_commands.py") if name.startswith("sim.cli")}
