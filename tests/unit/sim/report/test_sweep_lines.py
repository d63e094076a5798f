"""As a sweep ends, methods are held against each other on equal seeds only."""

from __future__ import annotations

from typing import Any

import pytest
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


def test_costs_of_other_noise_and_other_scenes_are_no_pairs():
    ours = drives("pi-rrht", {0: 8.0})
    others = [*drives("passive", {0: 9.0}, noise=0.2), *drives("passive", {0: 9.0}, scene="clutter")]
    assert "over" not in sweep_table([*ours, *others])


@pytest.mark.parametrize("methods", [("pi-rrht",), ("passive", "optimal")])
def test_where_there_is_nothing_to_compare_no_column_says_so(methods):
    assert "over" not in sweep_table([one for method in methods for one in drives(method, {0: 8.0, 1: 9.0})])


def test_a_run_without_an_end_is_counted_and_compares_with_none():
    ours = [record("pi-rrht", 0, cost=8.0), record("pi-rrht", 1, None, cost=None)]
    base, passive = cells(sweep_table([*ours, *drives("passive", {0: 8.5, 1: 3.0})]))
    assert (base["runs"], base["error"], passive["over pi-rrht"]) == ("2", "1", "+0.500")
