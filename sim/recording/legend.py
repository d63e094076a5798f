"""What the colours and lines of a recording mean, and the settings that the drive was made with."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib.metadata import version

from sim.recording.subject import Subject

OPTIMAL = """

**Green arrow**: the optimal control, solved for on a grid. **Floor**: the exact value, from pale at the goal to dark
where the way is dear, in bands of equal cost; **small arrows** on it: the optimal control there, of a robot with a
heading the best heading. In the table *exact* is each class' share of psi, by paths drawn under the optimal control."""


def legend(subject: Subject) -> str:
    """What the colours and lines of the drive mean, and the settings, in Markdown."""
    optimum = OPTIMAL if subject.look.truth else ""
    rows = "\n".join(f"| {name} | {_text(value)} |" for name, value in properties(subject.settings).items())
    return f"""\
**Thick lines**: the best path of each homology class, with its share of the weight.

**Thin lines**: sampled paths in the colour of their own class; the brighter, the heavier.
Grey ones hit an obstacle, left the workspace or ran out of time.

**White arrow**: the control chosen now.{optimum}

**White line**: the way that the samples of the heaviest class went on average; paler lines: those of other classes.
In a fallback, what is followed instead.

Plans and samples are drawn {subject.look.hz:g} times a second; the panel *Why* says of which moment they are.

**Yellow line**: the path driven.

A class such as `0,-1` counts whole turns around obstacles 1, 2, ... against the straight
line to the goal, counter-clockwise positive; with many obstacles `+5 -12` names those with a turn.

| setting | value |
|---|---|
{rows}
"""


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def properties(settings: Mapping[str, object]) -> dict[str, object]:
    """Settings and versions as numbers and texts."""
    plain = {
        name: value if isinstance(value, int | float | str) else str(value)
        for name, value in settings.items()
        if value is not None
    }
    packages = {name: version(name) for name in ("mujoco", "numpy", "rerun-sdk")}
    return {**plain, "python": platform.python_version(), **packages}
