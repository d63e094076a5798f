"""Notebooks as programs: their cells of code, one after the other, in one namespace."""

import json
import sys
from pathlib import Path


def code_of(notebook: Path) -> str:
    """All cells of code as one program, each under a comment that tells its number."""
    cells = json.loads(notebook.read_text())["cells"]
    parts = [f"# cell {i}\n{''.join(c['source'])}\n" for i, c in enumerate(cells) if c["cell_type"] == "code"]
    return "\n".join(parts)


if __name__ == "__main__":
    exec(compile(code_of(Path(sys.argv[1])), sys.argv[1], "exec"), {"__name__": "__main__"})
