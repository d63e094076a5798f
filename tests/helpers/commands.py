"""Commands in a folder of their own, as a user types them."""

import json
import subprocess
import sys
from pathlib import Path

from repository import environment


def _done(folder: Path, words: tuple[str, ...], status: int) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, timeout=900, env=environment()
    )
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    return done


def call(folder: Path, *words: str, status: int = 0) -> str:
    """What a command in that folder prints."""
    return _done(folder, words, status).stdout


def refused(folder: Path, *words: str) -> str:
    """What `pirrht` says of words that it cannot use."""
    return _done(folder, ("-m", "sim.cli", *words), 2).stderr


def reported(folder: Path, *words: str, status: int = 0) -> dict:
    """The JSON of a command."""
    call(folder, "-m", "sim.cli", *words, "--json", "reported.json", status=status)
    found: dict = json.loads((folder / "reported.json").read_text())
    return found
