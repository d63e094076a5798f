"""Shared parts of commands: read the scene, check where results go, grow the tree, show progress."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.exact.grid import Progress
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from sim.cli import tables, warm
from sim.files import check_writable
from sim.options import table as options
from sim.scenario import Scenario, prepare
from sim.text import counted, say

PAUSE = 0.2  # between two reports of how a tree grows [s]
MEANINGLESS = ("predict", "speed_limit")  # where nothing moves


def given(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what the user said, by setting."""
    return options.settings(arguments.command, vars(arguments))


def scenario_of(arguments: argparse.Namespace, *, loose: bool = False) -> Scenario:
    """The scene and the task as the command line has them, and in `arguments` what the scene says of the rest.

    Raises:
        OptionError, SceneError: something is wrong with them.
    """
    if arguments.start is not None and len(arguments.start) not in (2, 3):
        raise OptionError(
            f"--start has {counted(len(arguments.start), 'number')}; it must be X Y, and TH of what has a heading; "
            "drives begin at rest (`pirrht estimate --at` takes any state)"
        )
    said = vars(arguments)
    sampling = arguments.command != "plan" and arguments.method != "optimal"
    scenario = prepare(
        arguments.scene, **options.task(said), given=given(arguments), known=partial(warm.begin, sampling=sampling),
        loose=loose, driven=arguments.command not in ("plan", "estimate"),
    )  # fmt: skip
    if arguments.start is not None and len(arguments.start) == 3 and not scenario.problem.dynamics.angles:
        raise OptionError(f"--start has a heading, and {scenario.loaded.robot} has none; give X Y")
    for name in MEANINGLESS if not scenario.moving else ():
        if given(arguments).get(name) is not None:
            say(f"--{name.replace('_', '-')} changes nothing here: nothing moves in this scene")
    for note in scenario.loaded.notes:
        say(note)
    said.update(options.completed(arguments.command, said, scenario.loaded.scene.defaults))
    return scenario


def check_outputs(arguments: argparse.Namespace, *options: str) -> None:
    """Refuse files that could not be written, before any work is done.

    Raises:
        OptionError: one of them cannot.
    """
    for option in options:
        path: Path | None = getattr(arguments, option)
        if path is not None:
            check_writable(path, f"--{option}")


def planned(
    scenario: Scenario, at: Array | None = None, *, waits: bool = False
) -> tuple[HomologyTree, list[Reference]]:
    """The grown tree and the references at the start; its limit is wide enough there, or at another state (n,).

    Args:
        waits: whether there may be none among moving obstacles, since a drive waits for a way.
    """
    say(tables.fitting_lines(scenario))
    with progress_bar("plan", scenario.settings.vertices, " vertices") as bar:
        tree = scenario.grown_tree(lambda size: bar.update(size - bar.n), at)
    references = scenario.references(tree, waits=waits)
    if not references:
        say("no class reaches the goal from the start as bodies move: the robot waits for a way")
    if tree.limit > scenario.settings.limit and scenario.settings.tree is None:
        say(
            f"|1 - H_i| <= {scenario.settings.limit:g} leaves out ways that are not much longer than the shortest: "
            f"grown within {tree.limit:g} (--limit keeps to a limit)"
        )
    warm.notice().done("plan")
    return tree, references


@contextmanager
def solving() -> Iterator[Progress]:
    """A bar, on a terminal, of the exact value while a grid is solved for, which takes minutes where bodies move."""
    with progress_bar("exact value", 100.0, " %") as bar:
        yield lambda share: bar.update(100.0 * share - bar.n)


def as_they_stand(scenario: Scenario) -> None:
    """Say that a table of classes knows what plans do not."""
    if _foretells(scenario):
        say(
            f"classes above are those of the motions as they stand in the scene; plans of --predict "
            f"{scenario.settings.predict} find their own, and names may differ once bodies bend"
        )


def unforeseen(scenario: Scenario) -> None:
    """Say that the exact value knows what plans do not."""
    if _foretells(scenario):
        say(
            f"the exact value knows how bodies move, plans of --predict {scenario.settings.predict} do not: what they "
            "are off is what they cannot see"
        )


def _foretells(scenario: Scenario) -> bool:
    """Return whether plans do not know how bodies move."""
    return scenario.moving and scenario.settings.predict != "known"


def progress_bar(what: str, total: float, unit: str) -> Any:
    """A bar on a terminal, nothing in a pipe."""
    style = "{desc}: {percentage:3.0f}%|{bar}| {n:.4g}/{total:.4g}{unit} {postfix}"
    return tqdm(total=total, desc=what, unit=unit, leave=False, disable=None, bar_format=style)


def growing(bar: Any) -> Callable[[int], None]:
    """Return a callback that shows the number of vertices on a bar, some times a second."""
    last = time.monotonic()

    def report(vertices: int) -> None:
        nonlocal last
        if time.monotonic() - last > PAUSE:
            last = time.monotonic()
            bar.set_postfix_str(f"the tree grows: {vertices} vertices")

    return report
