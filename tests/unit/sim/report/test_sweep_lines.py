"""As a sweep ends, methods are held against each other on equal seeds only."""

from __future__ import annotations

from typing import Any

from report_samples import record

from sim.cli.tables import sweep_table


def cells(text: str) -> list[dict[str, str]]:
    """The rows of a table whose cells hold no two spaces in a row."""
    header, _, *rows = text.splitlines()
    ends = [end for end, (a, b) in enumerate(zip(header, header[1:] + " ", strict=True), 1) if a != " " == b]
    ends = [end for end in ends if header[end : end + 2].isspace() or end == len(header)]
    starts = [0, *ends[:-1]]
    names = [header[start:end].strip() for start, end in zip(starts, ends, strict=True)]
    split = [[row[a:b].strip() for a, b in zip(starts, ends, strict=True)] for row in rows]
    return [dict(zip(names, found, strict=True)) for found in split]


def drives(method: str, costs: dict[int, float], **changes: Any) -> list[dict]:
    return [record(method, seed, cost=cost, **changes) for seed, cost in costs.items()]


def test_a_method_that_arrives_with_easy_seeds_only_is_held_against_the_others_of_these_seeds():
    ours = drives("pi-rrht", {0: 8.0, 1: 8.0, 2: 20.0})
    theirs = [*drives("passive", {0: 9.0, 1: 8.5}), record("passive", 2, "collision", cost=1.0)]
    base, passive = cells(sweep_table([*ours, *theirs]))
    assert (base["cost"], base["over pi-rrht"]) == ("12.000", "-")
    assert (passive["cost"], passive["over pi-rrht"]) == ("8.750", "+0.750")  # though its mean is the lesser one
