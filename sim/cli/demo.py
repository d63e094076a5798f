"""The command `demo`: both noise levels of the paper's first example one after the other, and what to make of them."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

SCENE = "slit"
LEVELS = (("little", 0.1), ("much", 0.3))  # noise b [m/sqrt(s)]
WAYS = {"0,0": "through the slit", "-1,0": "around the slit, above", "0,1": "around the slit, below"}
MORE: tuple[str, ...] = ()  # words that the drives are given beside


def demo(run: Callable[[list[str]], int], tell: Callable[[str], None]) -> int:
    """Drive at both noise levels.

    Args:
        run: makes a command out of its words, and returns its exit status.
        tell: prints a line.

    Returns:
        0 if both drives reached the goal, 1 if not.
    """
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for word, noise in LEVELS:
            tell(f"{word} noise: pirrht run {SCENE} --noise {noise:g}")
            tell("")
            file = Path(folder) / f"{word}.json"
            run(["run", SCENE, "--noise", f"{noise:g}", "--json", str(file), *MORE])
            found.append(json.loads(file.read_text()))
            tell("")
    for line in sentences(found):
        tell(line)
    return 0 if all(one["outcome"] == "goal" for one in found) else 1


def sentences(found: list[dict[str, Any]]) -> list[str]:
    """The two sentences to take along, from the JSON of both drives."""
    (little, few), (much, many) = ((noise, went(one)) for (_, noise), one in zip(LEVELS, found, strict=True))
    return [
        f"1. The plan was the same; with noise b = {little:g} the robot went {few}, with b = {much:g} {many}.",
        "2. Noise decides what a way is worth, the mean of exp(-cost / lambda) over what may happen on it: a short way "
        "on which most samples hit a wall loses to a longer one on which they arrive.",
    ]


def went(one: dict[str, Any]) -> str:
    """Put the path of a run into words."""
    if one["outcome"] != "goal":
        return {"collision": "into a wall", "timeout": "nowhere in time"}[one["outcome"]]
    return WAYS.get(one["executed_class"], f"by class {one['executed_class']}")
