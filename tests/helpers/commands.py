"""Commands in a folder of their own, as a user types them."""

import json
import subprocess
import sys
from pathlib import Path

from repository import environment


def call(folder: Path, *words: str, status: int = 0) -> str:
    """What a command in that folder prints, or what it answers to words that it cannot use (status 2)."""
    process, pipe = [sys.executable, *words], subprocess.PIPE
    done = subprocess.run(process, cwd=folder, stdout=pipe, stderr=pipe, text=True, timeout=900, env=environment())
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr if status == 2 else done.stdout


def reported(folder: Path, *words: str, status: int = 0) -> dict:
    """The JSON of a command."""
    call(folder, "-m", "sim.cli", *words, "--json", "reported.json", status=status)
    found: dict = json.loads((folder / "reported.json").read_text())
    return found
