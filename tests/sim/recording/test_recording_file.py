"""The file of a recording: full disks, links, pipes and odd names cost one line and never what was there before."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from drives import Drive, record, rerun
from repository import environment
from rerun import recording_stream
from thoroughly import first

from pirrht.errors import OptionError
from sim.cli import main
from sim.recording import read, relay, viewer
from sim.recording.sinks import Sinks
from sim.recording.stream import Stream

SHORT = ["run", "slit", "--noise", "0.3", "--vertices", "80", "--samples", "20", "--max-time", "0.4"]

LIMITED = """
import resource, sys
from pathlib import Path
from drives import Drive
drive = Drive()
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
with drive.recorder(Path(sys.argv[1])) as recorder:
    for frame in drive.frames(max_time=5.0):
        recorder.log(frame)
"""


@pytest.fixture
def planned(monkeypatch):
    """Whether a command has come to plan."""
    begun: list[str] = []
    for command in ("plan", "run", "estimate"):
        monkeypatch.setattr(f"sim.cli.{command}_command.planned", lambda *_: begun.append("planned"))
    return begun


def limited(file, most: int) -> str:
    """What a drive says that may not write files larger than that."""
    command = [sys.executable, "-c", LIMITED, str(file), str(most)]
    ran = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 1
    return ran.stderr.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="limits as POSIX has them")
@pytest.mark.parametrize("most", first([20_000, 600_000]))  # less than the scene takes, and some batches of steps more
def test_a_recording_that_cannot_go_on_ends_and_the_old_file_is_there_again(tmp_path, most):
    file = tmp_path / "a.rrd"
    file.write_bytes(b"precious")
    said = limited(file, most)
    assert "the recording broke off (File too large)" in said
    assert "is what it was before" in said
    assert file.read_bytes() == b"precious"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.slow
def test_where_nothing_was_before_what_was_recorded_stays_readable(tmp_path):
    file = tmp_path / "a.rrd"
    assert "holds what was recorded until then" in limited(file, 600_000)
    steps = read.read(file).steps
    assert [step for step, _, _ in steps] == list(range(len(steps)))
    assert len(steps) >= 10
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.slow
@pytest.mark.root
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root mounts file systems")
def test_a_full_disk_costs_one_line_and_exit_status_2(tmp_path, capsys):
    small = tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", str(small)]
    if subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("mounting is not allowed here")
    try:
        file = small / "a.rrd"
        file.write_bytes(b"precious")
        assert main([*SHORT[:-1], "3", "--record", str(file)]) == 2
        said = capsys.readouterr().err.splitlines()
        assert [line for line in said if line.startswith("pirrht: ") and "No space left on device" in line] == said[-1:]
        assert file.read_bytes() == b"precious"
        assert os.listdir(small) == ["a.rrd"]
    finally:
        subprocess.run(["umount", "--lazy", str(small)], check=True)  # a helper may still be at its end there


@pytest.mark.slow
def test_an_old_recording_is_replaced_and_nothing_is_left_beside_it(tmp_path):
    file, link = tmp_path / "a.rrd", tmp_path / "link.rrd"
    file.write_bytes(b"old")
    link.symlink_to(file)
    frames, _ = record(link)
    assert link.is_symlink()
    assert len(read.read(file).steps) == len(frames)
    assert sorted(tmp_path.iterdir()) == [file, link]
    assert rerun("rrd", "verify", file).returncode == 0


@pytest.mark.slow
def test_a_run_that_is_interrupted_leaves_a_whole_recording_of_what_it_drove(tmp_path):
    file, drive = tmp_path / "a.rrd", Drive()
    file.write_bytes(b"old")
    frames = drive.frames()

    def interrupted() -> None:
        with drive.recorder(file) as recorder:
            for _ in range(6):
                recorder.log(next(frames))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [step for step, _, _ in read.read(file).steps] == list(range(6))
    assert list(tmp_path.iterdir()) == [file]
    assert rerun("rrd", "verify", file).returncode == 0


def test_without_descriptors_as_files_rerun_writes_the_draft_itself(tmp_path, monkeypatch):
    monkeypatch.setattr(relay, "DOORS", tmp_path / "none")
    file = tmp_path / "a.rrd"
    frames, _ = record(file)
    assert len(read.read(file).steps) == len(frames)
    assert list(tmp_path.iterdir()) == [file]


def test_a_device_that_forgets_takes_a_recording():
    frames, _ = record(file=Path(os.devnull))
    assert frames


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes as POSIX has them")
def test_a_pipe_is_refused_by_name_before_the_plan(tmp_path, capsys, planned):
    os.mkfifo(tmp_path / "pipe")
    assert main([*SHORT, "--record", str(tmp_path / "pipe")]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert "pipe is a pipe" in said.err
    assert not planned


@pytest.mark.parametrize(
    ("typed", "reason"),
    [
        (["--connect", "rerun+http://127.0.0.1:9/proxy"], "no viewer listens"),
        (["--view"], "display"),
        (["--record-lift", "3"], "slit has the obstacles 1 to 2"),
        (["--record-hz", "0"], "--record-hz"),
        (["--record", "x" * 300], "too long"),
        (["--record", os.fsdecode(b"b\xff.rrd")], "not UTF-8"),
    ],
)
def test_what_cannot_be_recorded_or_shown_is_refused_before_the_plan(monkeypatch, capsys, planned, typed, reason):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", ":4711")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert main([*SHORT, *typed]) == 2
    said = capsys.readouterr()
    assert not said.out
    assert said.err.count("\n") == 1
    assert reason in said.err
    assert not planned


def test_a_viewer_that_is_not_installed_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("RERUN_CLI_PATH", str(tmp_path / "rerun"))
    with pytest.raises(OptionError, match="--serve: there is no viewer"):
        Sinks(serve=True).check()


@pytest.mark.parametrize(
    ("name", "value", "address"),
    [
        ("DISPLAY", ":1.0", "/tmp/.X11-unix/X1"),
        ("DISPLAY", "far:10", ("far", 6010)),
        ("WAYLAND_DISPLAY", "wayland-0", "/run/user/7/wayland-0"),
    ],
)
def test_displays_are_asked_where_they_listen(monkeypatch, name, value, address):
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/7")
    assert viewer._display(name, value)[1][0] == address


def test_ctrl_c_while_a_stream_is_made_is_only_an_interruption(monkeypatch):
    made, complaints = recording_stream.bindings.new_recording, []

    def interrupted(**options):
        signal.raise_signal(signal.SIGINT)
        time.sleep(0.1)
        return made(**options)

    monkeypatch.setattr(recording_stream.bindings, "new_recording", interrupted)
    monkeypatch.setattr(sys, "unraisablehook", complaints.append)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            Stream("application", "id", orderly=True)
        gc.collect()
    finally:
        signal.signal(signal.SIGINT, before)
    assert not complaints
