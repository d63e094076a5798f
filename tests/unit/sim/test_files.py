"""Output files: an old one stays until the new one is complete, links are followed, odd names cost one line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from repository import environment

from pirrht.errors import OptionError
from pirrht.files import path_text, replaced
from sim.files import check_writable, write_json

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices and limits as Linux has them")


def write(path: Path, content: bytes = b"new") -> None:
    with replaced(path, "--json") as stream:
        stream.write(content)


def test_a_file_is_replaced_with_its_permissions_and_nothing_is_left_beside_it(tmp_path):
    file = tmp_path / "a.json"
    file.write_bytes(b"old")
    file.chmod(0o640)
    write(file)
    assert (file.read_bytes(), file.stat().st_mode & 0o777) == (b"new", 0o640)
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt(), SystemExit(143)])
def test_whatever_goes_wrong_the_old_file_stays_alone(tmp_path, error):
    file = tmp_path / "a.json"
    file.write_bytes(b"old")

    def half() -> None:
        with replaced(file, "--json") as stream:
            stream.write(b"half")
            raise error

    with pytest.raises((OptionError, KeyboardInterrupt, SystemExit)):
        half()
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("there", [True, False])
def test_a_link_stays_and_what_it_leads_to_is_written(tmp_path, there):
    folder = tmp_path / "far"
    folder.mkdir()
    if there:
        (folder / "real").write_bytes(b"old")
    link = tmp_path / "link"
    link.symlink_to(Path("far", "real"))
    check_writable(link, "--json")
    write(link)
    assert link.is_symlink()
    assert (folder / "real").read_bytes() == b"new"
    assert list(folder.iterdir()) == [folder / "real"]


@linux
def test_devices_are_written_straight_to():
    check_writable(Path("/dev/null"), "--json")
    write_json(Path("/dev/null"), {"a": 1})
    assert Path("/dev/null").is_char_device()
    with pytest.raises(OptionError, match="--json /dev/full: No space left"):
        write_json(Path("/dev/full"), {"a": 1})


@linux
@pytest.mark.parametrize("piped", [True, False])
def test_standard_output_takes_json_after_what_was_said(tmp_path, piped):
    script = "from pathlib import Path; from sim.files import *; print('said'); write_json(Path('/dev/stdout'), [1])"
    with (tmp_path / "out").open("w+b") as out:
        ran = subprocess.run(
            [sys.executable, "-c", script],
            env=environment(),
            stdout=subprocess.PIPE if piped else out,
            check=True,
        )
        out.seek(0)
        assert (ran.stdout if piped else out.read()) == b"said\n[\n  1\n]\n"


@linux
def test_a_file_larger_than_allowed_leaves_the_old_one(tmp_path):
    file = tmp_path / "a.json"
    file.write_bytes(b"old")
    script = f"""
import resource
from pathlib import Path
from sim.files import write_json
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
write_json(Path({str(file)!r}), list(range(10_000)))
"""
    ran = subprocess.run([sys.executable, "-c", script], env=environment(), capture_output=True, text=True, check=False)
    assert "OptionError" in ran.stderr
    assert "File too large" in ran.stderr
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


def test_a_name_may_be_as_long_as_the_system_allows_and_no_longer(tmp_path):
    file = tmp_path / ("x" * 250 + ".json")
    check_writable(file, "--json")
    write(file)
    assert file.read_bytes() == b"new"
    with pytest.raises(OptionError, match=r"--json .*\.\.\..*too long") as caught:
        check_writable(tmp_path / ("x" * 300), "--json")
    assert len(str(caught.value)) < 200


def test_names_that_are_not_utf_8_are_refused_in_words_that_can_be_printed():
    odd = Path(os.fsdecode(b"b\xff.json"))
    with pytest.raises(OptionError, match=r"--json b\\xff.json: the name is not UTF-8") as caught:
        check_writable(odd, "--json")
    str(caught.value).encode()
    assert path_text(odd) == "b\\xff.json"


@pytest.mark.parametrize("name", ["circle", "no/a.json", "."])
def test_paths_that_lead_nowhere_are_refused(tmp_path, name):
    (tmp_path / "circle").symlink_to("circle")
    with pytest.raises(OptionError, match=r"--json "):
        check_writable(tmp_path / name, "--json")


@linux
def test_a_pipe_that_nobody_reads_is_refused_and_one_that_is_read_takes_it_all(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OptionError, match="is a pipe that nobody reads"):
        check_writable(pipe, "--json")
    with pytest.raises(OptionError, match="--json"):  # of somebody who did not check
        write(pipe)
    reader = subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE)
    while True:
        try:
            check_writable(pipe, "--json")
            break
        except OptionError:  # it has not opened the pipe yet
            continue
    write(pipe, b"all of it")
    assert reader.communicate()[0] == b"all of it"


@pytest.mark.parametrize(
    ("name", "text"),
    [("a\nb", "a\\nb"), ("a\x1b[2J", "a\\x1b[2J"), ("\ud800", "\\ud800"), ("\udcff", "\\xff"), ("é", "é")],
)
def test_any_name_is_shown_in_one_line(name, text):
    assert path_text(Path(name)) == text


def test_half_a_character_is_no_name(tmp_path):
    with pytest.raises(OptionError, match="not UTF-8"):
        check_writable(tmp_path / "\ud800.json", "--json")
