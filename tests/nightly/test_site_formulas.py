"""The site typesets the formulas of docstrings: each that it knows is in one, and code stays as it is."""

from __future__ import annotations

import re

import pytest
from repository import ROOT

pytest.importorskip("mkdocs")
pytest.importorskip("latex2mathml")

from site_hook import FORMULAS, on_page_markdown, typeset


@pytest.mark.parametrize("formula", FORMULAS)
def test_a_formula_is_written_in_some_docstring(formula):
    sources = " ".join(re.sub(r"\s+", " ", file.read_text()) for file in sorted((ROOT / "pirrht").rglob("*.py")))
    assert formula in sources


def test_running_text_is_typeset_and_code_headings_and_names_are_not():
    text = "<h3>phi</h3><p>v = -lambda log\npsi of <code>phi</code> and <code>lambda R^-1 = s s'</code>, log_psi</p>"
    found = typeset(text)
    assert found.count("<math") == 2
    assert "<h3>phi</h3>" in found
    assert "<code>phi</code>" in found
    assert "log_psi" in found


def test_pages_write_formulas_in_latex():
    assert '<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">' in on_page_markdown("a\n\n$$ x^2 $$\n")
