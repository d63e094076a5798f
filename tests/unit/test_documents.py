"""Documents name files, packages, equations' homes and tests that exist."""

import re
from importlib import import_module
from operator import attrgetter

from repository import ROOT

import pirrht
from pirrht import errors

TABLE = (ROOT / "docs" / "equations.md").read_text()
HOMES = sorted(set(re.findall(r"`([a-z_.0-9]+:[\w.]+)`", TABLE)))
TESTS = sorted(set(re.findall(r"`([\w/]+\.py:test_\w+)`", TABLE)))


def test_every_home_is_there():
    for home in HOMES:
        module, name = home.split(":")
        assert attrgetter(name)(import_module(f"pirrht.{module}")), home


def test_every_test_that_is_named_is_in_one_of_the_tiers():
    for test in TESTS:
        file, name = test.split(":")
        found = [ROOT / "tests" / tier / "pirrht" / file for tier in ("unit", "nightly")]
        assert any(path.exists() and f"def {name}(" in path.read_text() for path in found), test


def test_every_row_has_a_home():
    rows = [row for row in TABLE.splitlines() if row.startswith("| ") and not row.startswith("| what")]
    assert len(rows) > 50
    assert all(re.search(r"`[a-z_.0-9]+:[\w.]+`", row) or "*Twice by need*" in row for row in rows)


def test_the_page_of_the_api_has_every_public_name():
    listed = re.findall(r"^::: pirrht\.(\S+)$", (ROOT / "docs" / "api.md").read_text(), re.M)
    assert {*pirrht.__all__} <= {one.rpartition(".")[2] for one in listed} | {*dir(errors)}
    for home in listed:
        module, _, name = home.rpartition(".")
        assert hasattr(import_module(f"pirrht.{module}".rstrip(".")), name), home


# -- architecture --------------------------------------------------------------------------------------------------

PAGE = (ROOT / "docs" / "architecture.md").read_text()


def test_files_of_the_page_exist():
    named = re.findall(r"`([\w/]+\.py)`", PAGE)
    assert len(named) > 20
    for name in named:
        assert (ROOT / name if name.startswith(("sim/", "tests/", "scripts/")) else ROOT / "pirrht" / name).exists(), (
            name
        )


def test_the_picture_has_every_package():
    picture = PAGE.split("```")[1]
    for package in (ROOT / "pirrht").iterdir():
        if (package / "__init__.py").exists():
            assert f"{package.name}/" in picture, package.name
