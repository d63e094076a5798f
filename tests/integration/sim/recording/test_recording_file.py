"""The file of a recording: full disks, links, pipes and odd names cost one line and never what was there before."""

import os
import sys

import pytest

from pirrht.errors import OptionError
from sim.recording.viewer import Sinks

SHORT = ["run", "slit", "--noise", "0.3", "--vertices", "80", "--samples", "20", "--max-time", "0.4"]
PIPES = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes as POSIX has them")


@pytest.fixture
def planned(monkeypatch):
    """Whether a command has come to plan."""
    begun: list[str] = []
    for command in ("run", "plan"):  # the first imports the second, before that is replaced
        monkeypatch.setattr(f"sim.cli.{command}_command.planned", lambda *_: begun.append("planned"))
    return begun


@pytest.mark.parametrize(
    ("typed", "reason"),
    [
        (["--connect", "rerun+http://127.0.0.1:9/proxy"], "no viewer listens"),
        (["--view"], "display"),
        (["--record-lift", "3"], "slit has the obstacles 1 to 2"),
        (["--record-hz", "0"], "--record-hz"),
        (["--record-hz", "nan"], "--record-hz"),
        (["--record", "x" * 300], "too long"),
        (["--record", os.fsdecode(b"b\xff.rrd")], "not UTF-8"),
        (["--record", "no/a.rrd"], "does not exist"),
        (["--record", "."], "is a folder"),
        pytest.param(["--record", "pipe"], "pipe is a pipe", marks=PIPES),
    ],
)
def test_what_cannot_be_recorded_or_shown_is_refused_before_the_plan(
    monkeypatch, refused, tmp_path, planned, typed, reason
):
    monkeypatch.chdir(tmp_path)
    if "pipe" in typed:
        os.mkfifo("pipe")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    refused([*SHORT, *typed], reason)
    assert not planned


def test_a_viewer_that_is_not_installed_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("RERUN_CLI_PATH", str(tmp_path / "rerun"))
    with pytest.raises(OptionError, match="--serve: there is no viewer"):
        Sinks(serve=True).check()
