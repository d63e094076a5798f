"""Output files: an old one stays until the new one is complete, links are followed, odd names cost one line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from repository import environment

from pirrht.errors import OptionError
from sim.files import check_writable, replaced, write_json

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices and limits as Linux has them")


def write(path: Path, content: bytes = b"new") -> None:
    with replaced(path, "--json") as stream:
        stream.write(content)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A result of an earlier run."""
    (tmp_path / "a.json").write_bytes(b"old")
    return tmp_path / "a.json"


def test_a_file_is_replaced_with_its_permissions_and_nothing_is_left_next_to_it(file):
    file.chmod(0o640)
    write(file)
    assert (file.read_bytes(), file.stat().st_mode & 0o777) == (b"new", 0o640)
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt(), SystemExit(143)])
def test_whatever_goes_wrong_the_old_file_stays_alone(file, error):
    with pytest.raises((OptionError, KeyboardInterrupt, SystemExit)), replaced(file, "--json") as stream:  # noqa: PT012
        stream.write(b"half")
        raise error
    assert (file.read_bytes(), list(file.parent.iterdir())) == (b"old", [file])


def test_a_link_stays_and_its_target_is_written(tmp_path):
    target, link = tmp_path / "far" / "real", tmp_path / "link"
    target.parent.mkdir()
    link.symlink_to(Path("far", "real"))
    check_writable(link, "--json")
    write(link)
    assert (link.is_symlink(), target.read_bytes(), list(target.parent.iterdir())) == (True, b"new", [target])


@pytest.mark.parametrize("target", ["victim", "nowhere", "/dev/null"])
def test_a_file_whose_name_is_ours_takes_the_place_of_a_link(tmp_path, target):
    (tmp_path / "victim").write_bytes(b"mine")
    (tmp_path / "victim").chmod(0o600)
    (tmp_path / "report").symlink_to(target)
    check_writable(tmp_path / "report", "-o", follow=False)
    with replaced(tmp_path / "report", "-o", follow=False) as stream:
        stream.write(b"new")
    assert (tmp_path / "victim").read_bytes() == b"mine"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["report", "victim"]
    assert not (tmp_path / "report").is_symlink()
    assert (tmp_path / "report").read_bytes() == b"new"


@linux
def test_devices_are_written_straight_to():
    write_json(Path("/dev/null"), {"a": 1})
    assert Path("/dev/null").is_char_device()
    with pytest.raises(OptionError, match="--json /dev/full: No space left"):
        write_json(Path("/dev/full"), {"a": 1})


@linux
@pytest.mark.parametrize("piped", [True, False])
def test_standard_output_takes_json_after_earlier_lines(tmp_path, piped):
    script = "from pathlib import Path; from sim.files import *; print('line'); write_json(Path('/dev/stdout'), [1])"
    with (tmp_path / "out").open("w+b") as out:
        stdout = subprocess.PIPE if piped else out
        ran = subprocess.run([sys.executable, "-c", script], env=environment(), stdout=stdout, check=True)
        out.seek(0)
        assert (ran.stdout if piped else out.read()) == b"line\n[\n  1\n]\n"


@pytest.mark.parametrize(
    ("name", "what"),
    [
        (os.fsdecode(b"b\xff.json"), r"b\\udcff.json: the name is not UTF-8"),
        ("\ud800.json", "not UTF-8"),
        ("x" * 300, r"\.\.\..*too long"),
        ("circle", ""),
        ("no/a.json", ""),
        (".", "is a folder"),
    ],
)
def test_paths_that_lead_nowhere_are_refused_in_words_that_can_be_printed(tmp_path, name, what):
    (tmp_path / "circle").symlink_to("circle")
    with pytest.raises(OptionError, match=f"--json .*{what}") as caught:
        check_writable(tmp_path / name, "--json")
    assert len(str(caught.value).encode()) < 250


@linux
def test_a_pipe_takes_it_all(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    check_writable(pipe, "--json")
    reader = subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE)
    write(pipe, b"all of it")
    assert reader.communicate()[0] == b"all of it"
