"""Files are regular and of bounded size before MuJoCo reads them, and a child process bounds what it makes of them."""

import os
import re
import sys
from pathlib import Path

import pytest
from mjcf_samples import SITES, mjcf, refusal

from pirrht.errors import SceneError
from sim.mjcf import library, load

BOX = 'type="box" size="0.1 2 1" pos="5 5 0"'
NAMING = {
    "include": ('<include file="{}"/>', ""),
    "mesh": ('<asset><mesh name="m" file="{}"/></asset>', '<geom type="mesh" mesh="m"/>'),
    "texture": ('<asset><texture name="t" type="cube" fileup=\'{}\'/></asset>', ""),
    "hfield": ('<asset><hfield name="h" file = "{}" size="1 1 1 1"/></asset>', ""),
    "model": ('<asset><model name="m" file="&#112;art.xml"/></asset>', ""),
    "flexcomp": ("", '<body><flexcomp name="f" type="mesh" file="{}" dim="2"/></body>'),
    "folder": ('<asset><mesh name="m" file="a/{}"/></asset><compiler meshdir="." strippath="true"/>', ""),
    "inner": ('<include file="inner.xml"/>', ""),
}
ENDLESS = {
    "is a pipe": os.mkfifo,
    "is a device": lambda path: path.symlink_to("/dev/zero"),
    "cannot be opened": lambda path: path.symlink_to(path),
}


@pytest.mark.parametrize("role", NAMING)
@pytest.mark.parametrize("reason", ENDLESS)
def test_what_has_no_end_is_refused_by_name_whatever_it_is_for(write, tmp_path, role, reason):
    ENDLESS[reason](tmp_path / "part.xml")
    write('<mujoco><include file="part.xml"/></mujoco>', "inner.xml")
    head, world = (text.format("part.xml") for text in NAMING[role])
    message = refusal(write(mjcf(SITES + world, head=head)))
    assert re.search(f'names the file "(a/)?part.xml", which {reason}', message)


def test_files_that_are_too_large_or_include_themselves_are_refused(write, tmp_path):
    assert "scene.xml" in refusal(write('<mujoco><include file="scene.xml"/></mujoco>'))
    for name, size in (("wall.png", library.LARGEST_FILE), ("large.xml", library.LARGEST_TEXT)):
        with (tmp_path / name).open("wb") as stream:
            stream.truncate(size + 1)
    head = '<asset><texture name="t" type="2d" file="wall.png"/></asset>'
    assert "larger than 128 MiB" in refusal(write(mjcf(SITES, head=head)))
    assert "larger than 32 MiB" in refusal(tmp_path / "large.xml")


def test_files_of_too_many_parts_are_refused_before_mujoco_reads_them(write, monkeypatch):
    monkeypatch.setattr(library, "trial", lambda path, read: None)
    monkeypatch.setattr(library, "MOST_PARTS", 20)
    geom = f"<geom {BOX}/>"
    assert "more than 20 bodies, geoms and sites" in refusal(write(mjcf(SITES + 20 * geom)))
    write(f"<mujoco><worldbody>{20 * geom}<body>{geom}</body></worldbody></mujoco>", "part.xml")
    assert "part.xml: it has more than 20" in refusal(write(mjcf(SITES, head='<include file="part.xml"/>')))
    assert load(write(mjcf(f"{SITES}<!-- {20 * geom} -->"), "other.xml")).scene.obstacles == ()


COUNTS = {
    "texture": ('<asset><texture name="t" type="2d" builtin="flat" width="40000" height="40000"/></asset>', ""),
    "hfield": ('<asset><hfield name="h" nrow="40000" ncol="40000" size="1 1 1 1"/></asset>', ""),
    'dim="1000000000"': ('<sensor><user dim="1000000000"/></sensor>', ""),
    'count="1000000"': ("", '<replicate count="1000000" offset="1 0 0"><geom size="0.1"/></replicate>'),
    'count="9{40}"': ("", f'<replicate count="{"9" * 5000}" offset="1 0 0"><geom size="0.1"/></replicate>'),
    'count="1000 1000 2"': ("", '<body><flexcomp name="f" type="grid" count="1000 1000 2" dim="3"/></body>'),
}


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such limits")
@pytest.mark.parametrize("case", COUNTS)
def test_counts_that_take_too_much_are_refused(write, case):
    head, world = COUNTS[case]
    assert re.search(f"{case} is too much|more than 2 GiB", refusal(write(mjcf(SITES + world, head=head))))


@pytest.mark.parametrize("size", ["nkey", "nuserdata", "nuser_geom", "njmax", "nconmax"])
def test_sizes_of_memory_that_a_file_states_change_nothing_and_warnings_are_not_printed(write, size, capfd):
    assert load(write(mjcf(SITES, head=f'<size {size}="1000000000"/><compiler settotalmass="3"/>'))).model.nq == 2
    assert capfd.readouterr().err == ""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such limits")
def test_names_are_text_and_comments_may_be_anything(write):
    assert "UTF-8" in refusal(write(mjcf(SITES + '<body name="T\udcfcr"/>')))
    assert load(write(mjcf(SITES + "<!-- ---- T\udcfcr ---- -->"), "other.xml")).scene.obstacles == ()


TURNS = (
    'euler="0 0 inf"',
    'euler="0 0 nan"',
    'quat="1e308 1e308 0 0"',
    'axisangle="1 0 0 inf"',
    'quat="1e-200 1e-200 0 0"',
)
PLACES = {
    "geom": ("", f'<geom name="wall" {BOX} {{}}/>'),
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


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such limits")
def test_what_slips_through_meets_limits_of_memory_and_time_and_passes_on_words(monkeypatch):
    def spins() -> None:
        while True:
            pass

    def fails() -> None:
        raise SceneError("these words")

    monkeypatch.setattr(library, "MEMORY", 2**28)
    monkeypatch.setattr(library, "CPU", 1)
    library.trial(Path("file"), lambda: None)
    for read, words in ((lambda: bytearray(2**29), "GiB of memory"), (spins, "or 1 s"), (fails, "^these words$")):
        with pytest.raises(SceneError, match=words):
            library.trial(Path("file"), read)
