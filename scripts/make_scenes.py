"""Writes the scenes of the gallery that are made, not drawn by hand: `python scripts/make_scenes.py [FOLDER]`."""

import sys
from collections.abc import Callable
from pathlib import Path

from worlds import buildings, choices, grown, mapped
from worlds.page import Page

from sim.files import replaced
from sim.mjcf import models_folder

PAGES: tuple[Callable[[], Page], ...] = (
    choices.double_slit,
    choices.drunken_bridge,
    choices.u_trap,
    buildings.office,
    buildings.warehouse,
    grown.forest,
    mapped.house,
    grown.barn,
)


def main(words: list[str]) -> int:
    """Write every scene to a folder, that of the built-in ones if none is named."""
    folder = Path(words[0]) if words else models_folder() / "scenes"
    for make in PAGES:
        page = make()
        file = folder / f"{page.name}.xml"
        with replaced(file, "FOLDER") as stream:
            stream.write(page.text().encode())
        print(file)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
