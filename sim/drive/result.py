"""Figures of a run: their names, units and sentences, for the JSON of `run`, rows of sweeps and scores."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column of a table, or a figure of a record."""

    name: str
    kind: str  # of Arrow: string, float64 or int64
    unit: str
    text: str


def columns(table: str) -> tuple[Column, ...]:
    """Read the columns of a table with name, kind, unit ("-" for none) and text in every line."""
    split = (line.split(None, 3) for line in table.strip().splitlines())
    return tuple(Column(name=name, kind=kind, unit=unit.strip("-"), text=text) for name, kind, unit, text in split)


FIGURES = columns("""
outcome            string  -     goal, collision or timeout; null if the run ended with an error
time               float64 s     simulated time of the run
cost               float64 cost  integral of q + u'Ru/2 up to the exit, phi not included
path_length        float64 m     driven, without the path's noise: by chords, less what noise adds to them
noisy_path_length  float64 m     driven with the noise of every physics step: grows with their number
steps              int64   1     control steps
vertices           int64   1     of the tree
min_clearance      float64 m     least free distance around the robot, or a ball that holds it; 0 after a collision
value_estimate     float64 cost  v at the start: estimated, of optimal exact; infinite if no sample survived
executed_class     string  -     homology class of the driven path; null unless the goal was reached
class_switches     int64   1     control steps whose class of greatest weight differs from the one before
class_reversals    int64   1     times that a class of nine tenths of the weight followed on another such one
fallbacks          int64   1     control steps without a reference or a surviving sample: the robot is blocked
blocked_time       float64 s     simulated time of those steps
doubtful_plans     int64   1     control steps whose plan rests on fewer than 10 effective samples
least_ess          float64 1     least effective sample size of a plan; null for methods without samples
least_ess_time     float64 s     simulated time of that plan
""")


def explained() -> str:
    """Return all figures as text, one per line."""
    width = max(len(f.name) for f in FIGURES)
    units = {f.name: "" if f.unit in ("", "1") else f"[{f.unit}] " for f in FIGURES}
    return "\n".join(f"  {f.name:{width}}  {units[f.name]}{f.text}" for f in FIGURES)
