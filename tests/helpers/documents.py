"""What README and docs show: their blocks, links and pictures."""

import re
from pathlib import Path

from repository import ROOT

PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
NAMES = [page.name for page in PAGES]


def blocks(page: Path, language: str) -> list[str]:
    """Fenced blocks of a language, "" for those of none, in the order of the page."""
    found = re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(), re.S | re.M)
    return [text for known, text in found if known == language]


def named(name: str) -> Path:
    """The page of a name."""
    return PAGES[NAMES.index(name)]


def commands(page: Path) -> list[str]:
    """Lines of blocks that call `pirrht`, without their comments; `pirrht COMMAND` of the help is none."""
    lines = [line for block in blocks(page, "") for line in block.splitlines() if line.startswith("pirrht ")]
    return [line.split("  #")[0].strip() for line in lines if not re.match(r"pirrht (COMMAND|--)", line)]


def models() -> dict[str, str]:
    """The MJCF that pages show, by the name of the model."""
    return {
        re.findall('model="(.*?)"', text)[0]: text for text in [text for page in PAGES for text in blocks(page, "xml")]
    }


def links(page: Path) -> list[str]:
    """Targets of links and pictures that are no addresses of the web, without their anchors."""
    targets = re.findall(r"\]\(([^)\s]+)\)", page.read_text())
    return [target.split("#")[0] for target in targets if "://" not in target and not target.startswith("#")]
