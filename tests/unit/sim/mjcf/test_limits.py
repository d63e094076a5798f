"""Files are regular, of bounded size and counts, and all numbers are numbers, before MuJoCo reads them."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest
from hostile_mjcf import png
from mjcf_samples import SITES, mjcf, refusal

from pirrht.errors import SceneError
from sim.mjcf import limits, load

BOX = 'type="box" size="0.1 2 1" pos="5 5 0"'


@pytest.fixture
def write(tmp_path: Path):
    def write(text: str | bytes, name: str = "scene.xml") -> Path:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


NAMING = {
    "include": ('<include file="{}"/>', ""),
    "mesh": ('<asset><mesh name="m" file="{}"/></asset>', '<geom type="mesh" mesh="m"/>'),
    "texture": ('<asset><texture name="t" type="cube" fileup="{}"/></asset>', ""),
    "hfield": ('<asset><hfield name="h" file="{}" size="1 1 1 1"/></asset>', ""),
    "model": ('<asset><model name="m" file="{}"/></asset>', ""),
    "flexcomp": ("", '<body><flexcomp name="f" type="mesh" file="{}" dim="2"/></body>'),
}
ENDLESS = {
    "a pipe": (os.mkfifo, "is a pipe"),
    "a device": (lambda path: path.symlink_to("/dev/zero"), "is a device"),
    "a link to itself": (lambda path: path.symlink_to(path), "cannot be opened"),
}


@pytest.mark.parametrize("role", NAMING)
@pytest.mark.parametrize("case", ENDLESS)
def test_what_has_no_end_is_refused_by_name_whatever_it_is_for(write, tmp_path, role, case):
    make, reason = ENDLESS[case]
    make(tmp_path / "part.xml")
    head, world = (text.format("part.xml") for text in NAMING[role])
    message = refusal(write(mjcf(SITES + world, head=head)))
    assert f"{role} names file" in message
    assert reason in message


def test_files_are_searched_in_the_folders_that_the_compiler_names(write, tmp_path):
    (tmp_path / "meshes").mkdir()
    os.mkfifo(tmp_path / "meshes" / "part.stl")
    head = '<asset><mesh name="m" file="elsewhere/part.stl"/></asset><compiler meshdir="meshes" strippath="true"/>'
    assert "is a pipe" in refusal(write(mjcf(SITES, head=head)))


def test_a_file_that_includes_itself_ends(write):
    assert "scene.xml" in refusal(write('<mujoco><include file="scene.xml"/></mujoco>'))


def test_files_and_pictures_that_are_too_large_are_refused(write, tmp_path):
    write(png(40_000, 40_000), "wall.png")
    head = '<asset><texture name="t" type="2d" file="wall.png"/></asset>'
    assert "40000 x 40000 pixels" in refusal(write(mjcf(SITES, head=head)))
    with (tmp_path / "wall.png").open("wb") as stream:
        stream.truncate(limits.LARGEST_FILE + 1)
    assert "larger than 128 MiB" in refusal(write(mjcf(SITES, head=head)))
    with (tmp_path / "large.xml").open("wb") as stream:
        stream.truncate(limits.LARGEST_XML + 1)
    assert "larger than 32 MiB" in refusal(tmp_path / "large.xml")


COUNTS = {
    "texture": ('<asset><texture name="t" type="2d" builtin="flat" width="40000" height="40000"/></asset>', ""),
    "hfield": ('<asset><hfield name="h" nrow="40000" ncol="40000" size="1 1 1 1"/></asset>', ""),
    "replicate": ("", '<replicate count="1000000" offset="1 0 0"><geom size="0.1"/></replicate>'),
    "geom": ("", '<replicate count="1000"><replicate count="1000"><geom size="0.1"/></replicate></replicate>'),
    "flexcomp": ("", '<body><flexcomp name="f" type="grid" count="1000 1000 2" spacing="1 1 1" dim="3"/></body>'),
    "user": ('<sensor><user dim="1000000000"/></sensor>', ""),
}


@pytest.mark.parametrize("element", COUNTS)
def test_counts_that_take_too_much_are_refused_by_name(write, element):
    head, world = COUNTS[element]
    assert f": {element}" in refusal(write(mjcf(SITES + world, head=head)))


@pytest.mark.parametrize("size", ["nkey", "nuserdata", "nuser_geom", "njmax", "nconmax"])
def test_sizes_of_memory_that_a_file_states_change_nothing(write, size):
    assert load(write(mjcf(SITES, head=f'<size {size}="1000000000"/>'))).model.nq == 2


@pytest.mark.parametrize("declared", ["latin-1", "utf-16", "nonsense"])
def test_what_is_no_number_is_found_in_whatever_encoding_is_declared(write, declared):
    text = f'<?xml version="1.0" encoding="{declared}"?>' + mjcf(SITES + f'<geom name="wall" {BOX} euler="0 0 nan"/>')
    assert 'geom "wall" has euler="0 0 nan"' in refusal(write(text))


@pytest.mark.parametrize(
    "hidden",
    ["<!-- - -- --><geom {}/>", "<!--> <!--><geom {}/>", "<!-- <site> --><geom {}/><!-- </site> -->"],
)
def test_comments_hide_nothing_that_mujoco_reads(write, hidden):
    assert "wall" in refusal(write(mjcf(SITES + hidden.format(f'name="wall" {BOX} euler="0 0 nan"'))))


@pytest.mark.parametrize(
    "part",
    ["<![CDATA[<geom/>]]>", "<!DOCTYPE mujoco>", '<body name="T\udcfcr"/>', "<geom", "<!--", '<geom name="<!--"/>'],
)
def test_markup_that_readers_may_take_differently_is_refused(write, part):
    assert "not MJCF" in refusal(write(mjcf(SITES + part).encode("utf-8", "surrogateescape")))


def test_comments_with_dashes_and_in_other_encodings_are_none_of_our_business(write):
    text = mjcf(SITES + "<!-- ---- T\udcfcr ---- -->").encode("utf-8", "surrogateescape")
    assert load(write(text)).scene.obstacles == ()


TURNS = ('euler="0 0 inf"', 'quat="1e308 1e308 0 0"', 'axisangle="1 0 0 inf"', 'quat="1e-200 1e-200 0 0"')
PLACES = {
    "geom": ("", f'<geom name="wall" {BOX} {{}}/>'),
    "body": ("", f'<body name="wall" {{}}><geom {BOX}/></body>'),
    "inner body": ("", f'<body name="a"><body name="wall" {{}}><body><geom {BOX}/></body></body></body>'),
    "frame": ("", f'<frame {{}}><geom name="wall" {BOX}/></frame>'),
    "default": ("<default><geom {}/></default>", f'<geom name="wall" {BOX}/>'),
}


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("place", PLACES)
def test_a_rotation_that_is_none_is_refused_by_name_and_no_wall_vanishes(write, place, turn):
    head, world = (text.format(turn) for text in PLACES[place])
    message = refusal(write(mjcf(SITES + world, head=head)))
    assert '"wall" has a rotation that is not finite after compilation' in message


@pytest.mark.parametrize("attribute", ['scale="inf 1 1"', 'scale="1e300 1 1"', 'refpos="inf 0 0"', 'scale="1e30 1 1"'])
def test_a_mesh_without_finite_corners_is_refused(write, attribute):
    head = f'<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1" {attribute}/></asset>'
    assert 'geom "wall"' in refusal(write(mjcf(SITES + '<geom name="wall" type="mesh" mesh="m"/>', head=head)))


def test_warnings_of_mujoco_are_no_lines_of_their_own(write, capfd):
    load(write(mjcf(SITES, head='<compiler settotalmass="3"/>')))
    refusal(write(mjcf(SITES + f'<geom {BOX} euler="0 0 nan"/>')))
    assert capfd.readouterr().err == ""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such limits")
def test_what_slips_through_meets_limits_of_memory_and_passes_on_words(monkeypatch):
    monkeypatch.setattr(limits, "MEMORY", 2**28)
    limits.trial(Path("file"), lambda: None)
    with pytest.raises(SceneError, match="loading it takes MuJoCo more than"):
        limits.trial(Path("file"), lambda: bytearray(2**29))

    def fails() -> None:
        raise SceneError("these words")

    with pytest.raises(SceneError, match=re.compile("^these words$")):
        limits.trial(Path("file"), fails)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such limits")
def test_what_takes_too_long_is_given_up(monkeypatch):
    def spins() -> None:
        while True:
            pass

    monkeypatch.setattr(limits, "CPU", 1)
    with pytest.raises(SceneError, match="or 1 s"):
        limits.trial(Path("file"), spins)
