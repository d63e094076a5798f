"""Addresses of models and meshes in Gazebo's files, and the folders that are searched for them.

Nothing is downloaded: an address of Gazebo Fuel counts as the name of a model on this machine. An address that leads
out of the searched folders is refused.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from urllib.parse import unquote

from pirrht.errors import SceneError

VARIABLES = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "GAZEBO_MODEL_PATH")
_ABOVE = 3  # folders from that of a file upward
_INSIDE = ("", "models", "fuel_models")  # folders in each of them


def folders_of(environment: Mapping[str, str]) -> list[Path]:
    """List the model folders that Gazebo's environment variables name."""
    return [Path(part) for name in VARIABLES for part in environment.get(name, "").split(os.pathsep) if part]


@dataclass(frozen=True, slots=True)
class ModelPaths:
    """Where models and meshes are searched for."""

    source: Path  # of the world
    folders: tuple[Path, ...] = ()  # searched before those around the file and the world

    def find(self, uri: str, file: Path) -> Iterator[Path]:
        """Yield what exists at an address written in a file, the likeliest first."""
        roots = self._roots(file)
        paths = [(root, _normal(root / name)) for name in self._names(uri, file) for root in roots]
        inside = [path for root, path in paths if path.is_relative_to(root)]
        if not inside:
            self._refuse(uri, file, "leads out of the folders of models; write model://NAME")
        yield from (path for path in inside if os.path.exists(path))  # False for names too long

    def missing(self, uri: str, file: Path) -> NoReturn:
        """Raise the SceneError of an address without a file, with the folders that were searched."""
        searched = ", ".join(str(root) for root in self._roots(file) if root.is_dir())
        remedy = f"name the folder that holds it among the models or in {VARIABLES[0]}; nothing is downloaded"
        self._refuse(uri, file, f"is in none of {searched}; {remedy}")

    def _refuse(self, uri: str, file: Path, reason: str) -> NoReturn:
        where = "" if file == self.source else f" of {file}"
        raise SceneError(" ".join(f"{self.source}: {uri[:200]!r}{where} {reason}".split()))

    def _roots(self, file: Path) -> list[Path]:
        around = [
            folder / name for one in (file, self.source) for folder in _normal(one).parents[:_ABOVE] for name in _INSIDE
        ]
        roots = dict.fromkeys(_normal(folder) for folder in (*self.folders, *around))
        return [root for root in roots if root != Path(root.anchor)]

    def _names(self, uri: str, file: Path) -> list[str]:
        """Names relative to a searched folder, or absolute ones."""
        scheme, found, rest = uri.partition("://")
        rest = unquote(rest)
        if not found:
            return [str(_normal(file.parent / uri))]
        if scheme == "file":
            return [rest, str(_normal(file.parent / rest))]
        if scheme in ("model", "package"):
            return [rest.lstrip("/")]
        name, *inner = rest.partition("/models/")[2].split("/")
        if scheme not in ("http", "https") or not name:
            self._refuse(uri, file, "names no model on this machine; write model://NAME")
        if inner and (inner[0].isdigit() or inner[0] == "tip"):  # the version
            inner = inner[1:]
        inner = inner[1:] if inner[:1] == ["files"] else inner
        return ["/".join((form, *inner)) for form in (name, name.lower(), name.lower().replace(" ", "_"))]


def _normal(path: Path) -> Path:
    """Make a path absolute, without the parts . and .., links left as they are."""
    return Path(os.path.abspath(path))  # resolve() would follow links
