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


MOVING = """

**Pale outlines**: where the plan takes bodies that move to be in half a second, in one, and so on, the paler the later;
a plan that knows how they move is right about it, one that sees how fast they are takes them to go straight on.

**Space-time**: the same with time upward. The floor is the map, the thin frame above it is now, and the yellow thread
tells when the robot was where. Each **purple tube** is where a body is at every time; grey walls stand, and the goal is
the green pillar. The best paths of the classes are braids around the tubes: what passes a body before it runs on one
side of its tube, what passes behind it on the other. Thin: the heaviest samples. At the best speed a path rises as
steeply as it goes ahead; upright it waits."""


def legend(subject: Subject) -> str:
    """What the colours and lines of the drive mean, and the settings, in Markdown."""
    optimum = OPTIMAL if subject.look.truth else ""
    moving = MOVING if subject.moves else ""
    rows = "\n".join(f"| {name} | {_text(value)} |" for name, value in properties(subject.settings).items())
    return f"""\
**Thick lines**: the best path of each homology class, with its share of the weight.

**Thin lines**: sampled paths in the colour of their own class; the brighter, the heavier.
Grey ones hit an obstacle, left the workspace or ran out of time.

**White arrow**: the control chosen now.{optimum}

**White line**: the way that the samples of the heaviest class went on average; paler lines: those of other classes.
In a fallback, what is followed instead.

Plans and samples are drawn {subject.look.hz:g} times a second; the panel *Why* says of which moment they are.

**Yellow line**: the path driven.{moving}

A class such as `0,-1` counts whole turns around obstacles 1, 2, ... against the straight
line to the goal, counter-clockwise positive; with many obstacles `+5 -12` names those with a turn.

| setting | value |
|---|---|
{rows}
"""


def key(subject: Subject) -> str:
    """Return what the numbers, letters and colours on the map mean, in Markdown."""
    rows = [f"**{sign}** {name}" for sign, name, _ in subject.marks if name != f"obstacle {sign}"]
    if len(rows) < len(subject.marks):
        rows.append("Other numbers: as in *obstacle 1*.")
    moving = " *Lilac*: what moves." if subject.moves else ""
    signs = f"*Yellow*: the robot and its path. *White*: the path of most weight, and the control.{moving}"
    return "  \n".join([signs, *rows])


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
