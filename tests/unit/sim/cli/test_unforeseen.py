"""What is said where the exact value knows more than plans do."""

from __future__ import annotations

import pytest

from sim.cli.shared import as_they_stand, unforeseen
from sim.result import settings_json
from sim.scenario import prepare


@pytest.mark.parametrize(("predict", "lines"), [("velocity", 1), ("known", 0)])
def test_an_exact_value_beside_plans_that_do_not_know_motions_says_so(capsys, predict, lines):
    unforeseen(prepare("crossing", given={"predict": predict}))
    said = capsys.readouterr().out
    assert said.count("\n") == lines
    assert ("knows how bodies move" in said) == bool(lines)


def test_only_where_plans_foretell_a_table_says_that_it_does_not(capsys):
    as_they_stand(prepare("crossing", given={"predict": "known"}))
    as_they_stand(prepare("slit"))
    assert capsys.readouterr().out == ""
    as_they_stand(prepare("crossing", given={"predict": "velocity"}))
    said = capsys.readouterr().out
    assert "as they stand" in said
    assert "--predict velocity" in said


def test_json_of_settings_tells_what_plans_know_of_what_moves():
    assert settings_json(prepare("crossing", given={"predict": "velocity"}))["predict"] == "velocity"
    assert "predict" not in settings_json(prepare("slit"))
