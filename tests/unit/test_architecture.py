"""The page on architecture names files that exist, and every package."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
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
