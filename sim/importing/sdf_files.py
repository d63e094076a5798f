"""SDF files and the models that they include, joined into one tree of elements.

An `<include>` becomes the model that it names, with the name, pose and `<static>` of the include. Addresses of
collision meshes become absolute paths. Nothing is downloaded: an address of Gazebo Fuel counts as the name of a model
on this machine. An address that leads out of the searched folders is refused.
"""

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import NoReturn
from urllib.parse import unquote

from defusedxml.common import DTDForbidden
from defusedxml.ElementTree import fromstring

from pirrht.errors import SceneError
from sim.importing.solids import distinct
from sim.mjcf.library import MOST_ELEMENTS, MOST_LEVELS, MOST_NESTED, content_of, refused

VARIABLES = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "GAZEBO_MODEL_PATH")
_FUEL = re.compile(r".*?/models/([^/]+)(?:/(?:[0-9]+|tip))?(?:/files)?(/.*)?", re.DOTALL)  # version, folders
_ABOVE = 3  # folders from that of a file upward
_INSIDE = ("", "models", "fuel_models")  # folders in each of them
BUILT_IN = ("ground_plane", "sun")  # Gazebo's own models, which need no file: a scene has its floor anyway


def folders_of(environment: Mapping[str, str]) -> list[Path]:
    """List the model folders that Gazebo's environment variables name."""
    return [Path(part) for name in VARIABLES for part in environment.get(name, "").split(os.pathsep) if part]


def parse(path: Path, what: str) -> ET.Element:
    """Read the root element of an XML file of bearable size, without document types."""
    with refused(f"{path}: not XML: ", "; correct it there", ET.ParseError, ValueError, LookupError):
        try:
            root: ET.Element = fromstring(content_of(path, what), forbid_dtd=True)
        except DTDForbidden as error:
            must = "could declare entities; remove that declaration"
            raise SceneError(f"{path}: <!DOCTYPE {error.name}> {must}") from None
    level = [root]
    for _ in range(MOST_LEVELS):  # a copy of many thousands exhausts the stack
        level = [part for element in level for part in element]
    if level:
        raise SceneError(f"{path}: elements are nested deeper than {MOST_LEVELS}; flatten them")
    return root


def read_world(path: Path, folders: Sequence[Path]) -> ET.Element:
    """Read the world of a file, or its models as one, with all that it includes from folders or from around it."""
    root = parse(path, "an SDF world file")
    known = root.tag in ("sdf", "gazebo")
    worlds, models = (root.findall(tag) if known else [] for tag in ("world", "model"))
    if len(worlds) != 1 and (worlds or not models):
        scene = "this is a scene already: give it to pirrht run" if root.tag == "mujoco" else "write one <sdf><world>"
        raise SceneError(f"{path}: {len(worlds)} elements <world> in <{root.tag}>; {scene}")
    if not worlds:
        worlds = [ET.Element("world", name=path.stem)]
        worlds[0].extend(models)
    _Includes(path, folders).expand(worlds[0], path)
    return worlds[0]


class _Includes:
    """Puts models, each read once, in the place of what includes them."""

    def __init__(self, source: Path, folders: Sequence[Path]) -> None:
        self._source, self._folders, self._elements = source, folders, 0
        self._models: dict[Path, ET.Element | None] = {}  # by file; None: being read
        self._model_file = cache(self._first_file)
        self._roots = cache(self._roots_around)

    def expand(self, element: ET.Element, file: Path) -> None:
        """Replace the includes of a world or model, nested ones as well, and find its collision meshes."""
        self._count(element)
        for uri in element.iterfind(".//collision/geometry/mesh/uri"):
            text = (uri.text or "").strip()
            found = next((path for path in self._find(text, file) if path.is_file()), None)
            uri.text = str(found or self._missing(text, file))
        for parent in list(element.iter()):
            models = {index: self._included(part, file) for index, part in enumerate(parent) if part.tag == "include"}
            taken = [part.get("name", "") for part in parent if part.tag != "include"]
            names = distinct((model.get("name", "") for model in models.values()), taken, "_", 0)  # as Gazebo does
            for (index, model), name in zip(models.items(), names, strict=True):
                model.set("name", name)
                parent[index] = model

    def _included(self, include: ET.Element, file: Path) -> ET.Element:
        """Return a copy of the model that an include names, with the properties that the include gives it."""
        uri = (include.findtext("uri") or "").strip()
        if not uri:
            raise SceneError(f"{file}: an <include> has no <uri>; write <uri>model://NAME</uri>, or remove it")
        path = self._model_file(uri, file)
        short = uri.replace("%20", " ").rstrip("/").rpartition("/")[2].lower().replace(" ", "_")
        if path is None and short in BUILT_IN:
            return ET.Element("light")
        model = deepcopy(self._model(path or self._missing(uri, file), uri))
        for tag in ("name", "placement_frame"):
            if text := (include.findtext(tag) or "").strip():
                model.set(tag, text)
        for value in (part for part in include if part.tag in ("pose", "static")):
            model[:] = [part for part in model if part.tag != value.tag] + [value]
        return model

    def _first_file(self, uri: str, file: Path) -> Path | None:
        """Find the SDF file of the model that an address written in a file names."""
        return next((inner for found in self._find(uri, file) for inner in self._files_of(found)), None)

    def _model(self, path: Path, uri: str) -> ET.Element:
        if path not in self._models:
            self._models[path] = None
            if list(self._models.values()).count(None) > MOST_NESTED:
                raise SceneError(f"{self._source}: includes are nested deeper than {MOST_NESTED}; flatten them")
            root = parse(path, "an SDF model file")
            parts = [part for part in root if part.tag in ("model", "actor", "light")]
            if len(parts) != 1 or root.tag not in ("sdf", "gazebo"):
                raise SceneError(f"{path}: {len(parts)} elements <model> in <{root.tag}>; write one <sdf><model>")
            self.expand(parts[0], path)
            self._models[path] = parts[0]
        model = self._models[path]
        if model is None:
            raise SceneError(f"{self._source}: {path} includes itself by {uri!r}; remove one of these includes")
        self._count(model)
        return model

    def _count(self, element: ET.Element) -> None:
        self._elements += sum(1 for _ in element.iter())
        if self._elements > MOST_ELEMENTS:
            raise SceneError(f"{self._source}: with its includes it has more than {MOST_ELEMENTS} elements")

    def _files_of(self, path: Path, versions: bool = True) -> Iterator[Path]:
        """Yield the SDF files of a model's folder, first that of the highest version in its model.config."""
        if path.is_file():
            yield path
            return
        for config in (path / name for name in ("model.config", "manifest.xml") if (path / name).is_file()):
            files = parse(config, "a model.config").findall("sdf")
            if not files:
                raise SceneError(f"{config}: it names no <sdf>; write <sdf>model.sdf</sdf>")
            newest = max(files, key=lambda sdf: [float(n) for n in sdf.get("version", "").split(".") if n.isdecimal()])
            yield from self._find((newest.text or "").strip(), config)
        if (path / "model.sdf").is_file():
            yield path / "model.sdf"
        folders = (inner for inner in path.glob("*") if inner.name.isdecimal()) if versions else ()
        for version in sorted(folders, key=lambda inner: -int(inner.name)):
            yield from self._files_of(version, versions=False)  # of the cache of Gazebo Fuel

    def _find(self, uri: str, file: Path) -> Iterator[Path]:
        """Yield what exists at an address written in a file, the likeliest first."""
        pairs = [(root, _normal(root / name)) for name in self._names(uri, file) for root in self._roots(file)]
        inside = [path for root, path in pairs if path.is_relative_to(root)]
        if not inside:
            self._refuse(uri, file, "leads out of the folders of models; write model://NAME")
        yield from (path for path in inside if os.path.exists(path))  # False for names too long

    def _names(self, uri: str, file: Path) -> list[str]:
        """List names relative to a searched folder, or absolute ones."""
        scheme, found, rest = uri.partition("://")
        rest = unquote(rest)
        if not found or scheme == "file":
            here = str(_normal(file.parent / (rest if found else uri)))
            return [rest, here] if found else [here]
        if scheme in ("model", "package"):
            return [rest.lstrip("/")]
        fuel = _FUEL.fullmatch(rest)
        if scheme not in ("http", "https") or fuel is None:
            self._refuse(uri, file, "names no model on this machine; write model://NAME")
        name = fuel[1]
        inner = fuel[2] or ""

        return [form + inner for form in (name, name.lower(), name.lower().replace(" ", "_"))]

    def _roots_around(self, file: Path) -> list[Path]:
        parents = (folder for one in (file, self._source) for folder in _normal(one).parents[:_ABOVE])
        around = [folder / name for folder in parents for name in _INSIDE]
        roots = dict.fromkeys(_normal(folder) for folder in (*self._folders, *around))
        return [root for root in roots if root != Path(root.anchor)]

    def _missing(self, uri: str, file: Path) -> NoReturn:
        searched = ", ".join(str(root) for root in self._roots(file) if root.is_dir())
        remedy = f"name the folder that holds it among the models or in {VARIABLES[0]}; nothing is downloaded"
        self._refuse(uri, file, f"is in none of {searched}; {remedy}")

    def _refuse(self, uri: str, file: Path, reason: str) -> NoReturn:
        where = "" if file == self._source else f" of {file}"
        raise SceneError(" ".join(f"{self._source}: {uri[:200]!r}{where} {reason}".split()))


def _normal(path: Path) -> Path:
    """Make a path absolute, without the parts . and .., links left as they are."""
    return Path(os.path.abspath(path))  # resolve() would follow links
