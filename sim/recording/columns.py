"""The table that `pirrht export` makes of a recording: its columns, their units and what they mean."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column, or several of one kind."""

    name: str  # in the table; K stands for 1, 2, ... and ID for a class
    unit: str
    text: str


COLUMNS = (
    Column(name="step", unit="1", text="number of the control step, from 0"),
    Column(name="time", unit="s", text="simulated time at its start"),
    Column(name="duration", unit="s", text="simulated time it took"),
    Column(name="x", unit="m", text="position at its start"),
    Column(name="y", unit="m", text="position at its start"),
    Column(name="heading", unit="rad", text="heading of a car at its start, counter-clockwise from x"),
    Column(name="control_K", unit="m/s or 1", text="u at its start: velocity of a point, steering of a car"),
    Column(name="noise_K", unit="sqrt(s)", text="sum of the Brownian increments over the step"),
    Column(name="end_x", unit="m", text="position at its end"),
    Column(name="end_y", unit="m", text="position at its end"),
    Column(name="end_heading", unit="rad", text="heading of a car at its end"),
    Column(name="cost", unit="cost", text="integral of q + u'Ru/2 from the start of the drive to the end of the step"),
    Column(name="length", unit="m", text="driven up to the end of the step, without the path's noise (path_length)"),
    Column(name="clearance", unit="m", text="room around the robot at the start of the step"),
    Column(name="value", unit="cost", text="estimate of v = -lambda log psi; infinite if no sample survived"),
    Column(name="value_error", unit="cost", text="its standard error; 0 if exact, infinite if unknown"),
    Column(name="control_error_K", unit="m/s or 1", text="standard error of u; 0 if exact, infinite if unknown"),
    Column(name="doubtful", unit="1", text="1 where v and u rest on fewer than 10 effective samples"),
    Column(name="exact_value", unit="cost", text="v, solved for on a grid (`run --truth`)"),
    Column(name="exact_control_K", unit="m/s or 1", text="the optimal control u* (`run --truth`)"),
    Column(name="weight:ID", unit="1", text="share of psi of a homology class; NaN if no sample survived"),
    Column(name="ess:ID", unit="1", text="effective sample size of a homology class"),
    Column(name="vertices", unit="1", text="of the tree that the plan was made with"),
    Column(name="plan_ms", unit="ms", text="wall time of the plan"),
    Column(name="outcome", unit="", text="goal, collision or timeout in the last row, empty before"),
)


def described(name: str) -> Column:
    """The description of a column of the table."""
    for column in COLUMNS:
        if re.fullmatch(column.name.replace("_K", r"_\d+").replace(":ID", ":.+"), name):
            return column
    return Column(name=name, unit="", text="")


def explained() -> str:
    """All columns as text, one per line."""
    width, unit = (max(len(text) for text in texts) for texts in zip(*((c.name, c.unit) for c in COLUMNS), strict=True))
    lines = (f"  {c.name:{width}}  {f'[{c.unit}]' if c.unit else '':{unit + 2}}  {c.text}" for c in COLUMNS)
    return "\n".join(lines)
