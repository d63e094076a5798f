"""The long tests of integration/sim/recording/test_recording_file.py."""

import os
import subprocess
import sys

import pytest
from drives import Drive, rerun
from integration.sim.recording.test_recording_file import SHORT
from repository import environment
from thoroughly import first

from sim.cli import main
from sim.recording import export

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


def limited(file, most: int) -> str:
    """What a drive says that may not write files larger than that."""
    command = [sys.executable, "-c", LIMITED, str(file), str(most)]
    ran = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 1
    return ran.stderr.splitlines()[-1]


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


def test_where_nothing_was_before_what_was_recorded_stays_readable(tmp_path):
    file = tmp_path / "a.rrd"
    assert "holds what was recorded until then" in limited(file, 600_000)
    steps = export.read(file).steps
    assert [step for step, _, _ in steps] == list(range(len(steps)))
    assert len(steps) >= 10
    assert list(tmp_path.iterdir()) == [file]


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


def test_an_interrupted_run_replaces_what_was_there_by_a_whole_recording_of_what_it_drove(tmp_path):
    file, link, drive = tmp_path / "a.rrd", tmp_path / "link.rrd", Drive()
    file.write_bytes(b"old")
    link.symlink_to(file)
    frames = drive.frames()

    def interrupted() -> None:
        with drive.recorder(link) as recorder:
            for _ in range(6):
                recorder.log(next(frames))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [step for step, _, _ in export.read(file).steps] == list(range(6))
    assert link.is_symlink()
    assert sorted(tmp_path.iterdir()) == [file, link]
    assert rerun("rrd", "verify", file).returncode == 0
