"""How a recording ends: killed, without a viewer, late, or refused before it begins."""

from __future__ import annotations

import threading
import time

import pytest
from drives import Drive, columns

from pirrht.errors import OptionError
from sim.drive.episode import CLOCKED
from sim.recording import viewer
from sim.recording.recorder import NAP, ROOM, ToViewer


@pytest.mark.parametrize("url", ["localhost", "http://127.0.0.1:9876/proxy", "rerun+http://127.0.0.1:99999/proxy"])
def test_an_address_that_is_no_viewers_is_refused_with_an_example(url):
    with pytest.raises(OptionError, match=r"write one like rerun\+http://"):
        viewer.probe(url)


def test_a_viewer_that_hangs_costs_frames_but_not_time(tmp_path, monkeypatch):
    drive, release = Drive(), threading.Event()
    frame = next(drive.frames())
    monkeypatch.setattr(viewer, "probe", lambda url: None)
    monkeypatch.setattr(ToViewer, "open", lambda self: release.wait())
    monkeypatch.setattr("sim.recording.recorder.GRACE", 0.1)
    recorder = drive.recorder(tmp_path / "both.rrd", connect=viewer.EXAMPLE)
    for _ in range(ROOM + 100):  # what waited for the viewer would wait for ever
        recorder.log(frame)
    recorder.close()
    assert recorder.dropped == ROOM + 100
    assert len(columns(tmp_path / "both.rrd")["/steps"]["step"]) == ROOM + 100


def waiting(recorder):
    return len(recorder._sinks[-1].rows)


def test_a_file_is_written_after_a_drive_against_the_clock_and_misses_nothing(tmp_path, monkeypatch):
    drive = Drive()
    frame = next(drive.frames())
    recorder = drive.recorder(tmp_path / "late.rrd")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CLOCKED, "is_set", lambda: True)
        for _ in range(ROOM + 100):
            recorder.log(frame)
        time.sleep(5.0 * NAP)
        assert waiting(recorder) == ROOM + 100
        monkeypatch.setattr("sim.recording.recorder.KEPT", 0)  # no more room for what is kept
        while waiting(recorder) > ROOM:
            time.sleep(NAP)
    recorder.close()
    assert waiting(recorder) == 0
    assert len(columns(tmp_path / "late.rrd")["/steps"]["step"]) == ROOM + 100


def test_a_run_without_frames_leaves_the_old_file_alone(tmp_path):
    file = tmp_path / "old.rrd"
    file.write_bytes(b"precious")
    with pytest.raises(ZeroDivisionError), Drive().recorder(file):
        raise ZeroDivisionError
    assert file.read_bytes() == b"precious"
