"""What is said where the exact value knows more than plans do."""

from __future__ import annotations

import pytest

from sim.cli.shared import unforeseen
from sim.scenario import prepare


@pytest.mark.parametrize(("predict", "lines"), [("velocity", 1), ("known", 0)])
def test_an_exact_value_beside_plans_that_do_not_know_motions_says_so(capsys, predict, lines):
    unforeseen(prepare("crossing", given={"predict": predict}))
    said = capsys.readouterr().out
    assert said.count("\n") == lines
    assert ("knows how bodies move" in said) == bool(lines)
