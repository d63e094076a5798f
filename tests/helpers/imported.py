"""What a module imports, read off its text."""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import cache
from pathlib import Path


@cache
def imported(file: Path) -> frozenset[str]:
    """Everything that a file imports, wherever in it, by full name."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "by full name"
            assert node.module is not None
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return frozenset(names)


def reached(module: str, inner: Callable[[str], frozenset[str]]) -> frozenset[str]:
    """Modules that one imports, directly or not; itself only in a circle. `inner` tells what each imports itself."""
    seen: set[str] = set()
    waiting = [module]
    while waiting:
        new = inner(waiting.pop()) - seen
        seen |= new
        waiting += new
    return frozenset(seen)
