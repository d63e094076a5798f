"""SDF files and the models that they include, joined into one tree of elements.

An `<include>` becomes the model that it names, with the name, pose and `<static>` of the include. Addresses of
collision meshes become absolute paths.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

from defusedxml.common import DTDForbidden
from defusedxml.ElementTree import fromstring

from pirrht.errors import SceneError
from sim.importing.limits import content_of
from sim.importing.model_paths import ModelPaths
from sim.importing.sdf_poses import DEEPEST

MOST_ELEMENTS = 300_000  # of a world with all that it includes; those of the BARN data set have 20 000
MOST_LEVELS = 256  # of elements in elements: a copy of many thousands exhausts the stack
BUILT_IN = ("ground_plane", "sun")
_CONFIGS = ("model.config", "manifest.xml")
_PARTS = ("model", "actor", "light")  # what a file of a model holds


def parse(path: Path, what: str) -> ET.Element:
    """Read the root element of an XML file of bearable size, without document types.

    Raises:
        SceneError: names the path and what is required.
    """
    data = content_of(path, what)
    try:
        root: ET.Element = fromstring(data, forbid_dtd=True)
    except DTDForbidden as error:
        raise SceneError(f"{path}: <!DOCTYPE {error.name}> could declare entities; remove that declaration") from None
    except (ET.ParseError, ValueError, LookupError) as error:
        raise SceneError(f"{path}: not XML: {error}; correct it there") from None
    level = [root]
    for _ in range(MOST_LEVELS):
        level = [part for element in level for part in element]
    if level:
        raise SceneError(f"{path}: elements are nested deeper than {MOST_LEVELS}; flatten them")
    return root


def read_world(paths: ModelPaths) -> ET.Element:
    """Read the world element of a file, with everything that it includes.

    A file of models without a world counts as a world that holds them.

    Raises:
        SceneError: unreadable, malformed, no world or several, or an include that is missing, includes itself or
            leads out of the searched folders.
    """
    path = paths.source
    root = parse(path, "an SDF world file")
    known = root.tag in ("sdf", "gazebo")
    worlds, models = (root.findall(tag) if known else [] for tag in ("world", "model"))
    if len(worlds) != 1 and (worlds or not models):
        scene = "this is a scene already: give it to pirrht run" if root.tag == "mujoco" else "write one <sdf><world>"
        raise SceneError(f"{path}: {len(worlds)} elements <world> in <{root.tag}>; {scene}")
    if not worlds:
        worlds = [ET.Element("world", name=path.stem)]
        worlds[0].extend(models)
    _Includes(paths).expand(worlds[0], path)
    return worlds[0]


@dataclass(slots=True)
class _Includes:
    """Models by file, read once."""

    paths: ModelPaths
    elements: int = 0
    models: dict[Path, ET.Element | None] = field(default_factory=dict)  # None: being read

    def expand(self, element: ET.Element, file: Path) -> None:
        """Replace the includes of a world or model, nested ones as well, and find its collision meshes."""
        self._count(element)
        for uri in element.iterfind(".//collision/geometry/mesh/uri"):
            text = (uri.text or "").strip()
            uri.text = str(
                next((p for p in self.paths.find(text, file) if p.is_file()), None) or self.paths.missing(text, file)
            )
        for parent in list(element.iter()):
            includes = {index: part for index, part in enumerate(parent) if part.tag == "include"}
            for index, include in includes.items():
                parent[index] = self._included(include, file)
            if includes:
                _number(parent, set(includes))

    def _included(self, include: ET.Element, file: Path) -> ET.Element:
        uri = (include.findtext("uri") or "").strip()
        if not uri:
            raise SceneError(f"{file}: an <include> has no <uri>; write <uri>model://NAME</uri>, or remove it")
        path = next((p for found in self.paths.find(uri, file) for p in self._file_of(found)), None)
        if path is None and _builtin(uri):
            return ET.Element("light")
        path = path or self.paths.missing(uri, file)
        if path not in self.models:
            self.models[path] = None
            if list(self.models.values()).count(None) > DEEPEST:
                raise SceneError(f"{self.paths.source}: includes are nested deeper than {DEEPEST}; flatten them")
            self.models[path] = self._read(path)
        known = self.models[path]
        if known is None:
            raise SceneError(f"{self.paths.source}: {path} includes itself by {uri!r}; remove one of these includes")
        self._count(known)
        model = deepcopy(known)
        _override(model, include)
        return model

    def _read(self, path: Path) -> ET.Element:
        root = parse(path, "an SDF model file")
        parts = [part for part in root if part.tag in _PARTS] if root.tag in ("sdf", "gazebo") else []
        if len(parts) != 1:
            raise SceneError(f"{path}: {len(parts)} elements <model> in <{root.tag}>; write one <sdf><model>")
        self.expand(parts[0], path)
        return parts[0]

    def _file_of(self, path: Path) -> Iterator[Path]:
        """The SDF file of a model's folder: that of the highest version in its model.config."""
        if path.is_file():
            yield path
            return
        for name in _CONFIGS:
            if (path / name).is_file():
                files = parse(path / name, "a model.config").findall("sdf")
                if not files:
                    raise SceneError(f"{path / name}: it names no <sdf>; write <sdf>model.sdf</sdf>")
                newest = max(files, key=lambda sdf: _version(sdf.get("version", "")))
                yield from self.paths.find((newest.text or "").strip(), path / name)
        if (path / "model.sdf").is_file():
            yield path / "model.sdf"
        for version in sorted((p for p in path.glob("*") if p.name.isdecimal()), key=lambda p: -int(p.name)):
            yield from self._file_of(version)  # of the cache of Gazebo Fuel

    def _count(self, element: ET.Element) -> None:
        self.elements += sum(1 for _ in element.iter())
        if self.elements > MOST_ELEMENTS:
            raise SceneError(f"{self.paths.source}: with its includes it has more than {MOST_ELEMENTS} elements")


def _builtin(uri: str) -> bool:
    """Whether Gazebo's ground plane or sun is meant, which need no file: the floor of a scene is there anyway."""
    return uri.replace("%20", " ").rstrip("/").rpartition("/")[2].lower().replace(" ", "_") in BUILT_IN


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(".") if part.isdecimal())


def _override(model: ET.Element, include: ET.Element) -> None:
    """Give a model the name, pose and other properties that its include names."""
    name, frame = include.findtext("name"), include.findtext("placement_frame")
    if name and name.strip():
        model.set("name", name.strip())
    if frame:
        model.set("placement_frame", frame.strip())
    for tag in ("pose", "static"):
        value = include.find(tag)
        if value is not None:
            for old in model.findall(tag):
                model.remove(old)
            model.append(value)


def _number(parent: ET.Element, included: set[int]) -> None:
    """Add a number to names of included parts that are taken, as Gazebo does."""
    taken = {part.get("name") for index, part in enumerate(parent) if index not in included}
    for index in sorted(included):
        part, count = parent[index], 0
        name = part.get("name", "")
        while part.get("name") in taken:
            part.set("name", f"{name}_{count}")
            count += 1
        taken.add(part.get("name"))
