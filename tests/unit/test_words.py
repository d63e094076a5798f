"""The check of terms finds names, phrases and forms of docstrings, each at its line."""

import pytest
import words


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("class Aside: ...", [(1, "Aside")]),
        ("def plan(room): ...", [(1, "room")]),
        ("x = 1\nplan.room = x", [(2, "room")]),
        ("print(plan.room)", []),  # where it is defined it is found
        ('"""Return one value.\n\nIt is foretold.\n"""', [(3, "foretold")]),
        ("x = 1  # bodies that move", [(1, "bodies that move")]),
        ('x = f"{1} bodies that stand still"', [(1, "stand still")]),
        ('"""Where walls are."""', [(1, "Where")]),
        ('"""The same of walls."""', [(1, "The same")]),
        ('raise ValueError("give --samples")', [(1, "--samples")]),
        ('def f():\n    """Return x, as `--samples` sets it."""', []),
        ('"""Find a way. Tell classes apart. Look at walls. It wants no gate."""', []),
    ],
)
def test_retired_terms_are_found_at_their_lines(source: str, found: list[tuple[int, str]]):
    assert [(one.line, one.term) for one in words.findings(source)] == found


def test_the_name_of_a_module_counts():
    assert [one.term for one in words.findings("", "hurry")] == ["hurry"]


def test_the_method_follows_the_terms():
    assert words.main([]) == 0
