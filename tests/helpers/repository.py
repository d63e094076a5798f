"""Where the repository lies, for tests that run a command or read a file of it."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def environment(*folders: Path) -> dict[str, str]:
    """That of a process which finds the packages of this repository, the helpers here, and modules of some folders."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (ROOT, Path(__file__).parent, *folders)))}
