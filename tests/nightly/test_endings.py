"""The long tests of integration/test_endings.py."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from repository import environment
from thoroughly import first

COMMANDS = {  # none ends by itself within a minute
    "plan": ["plan", "slit", "--vertices", "100000"],
    "truth": ["estimate", "slit", "--at", "1", "2.5", "--truth", "--repeat", "10000"],
    "run": ["run", "slit", "--vertices", "100", "--samples", "20000"],
}

STOPPED = """
import os, signal, sys, threading
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it is ignored
import sim.cli
how, imports, after = int(sys.argv.pop(1)), int(sys.argv.pop(1)), float(sys.argv.pop(1))
def hook(event, _):
    global imports
    imports -= event == "import"
    if imports == 0:
        imports = -1
        signal.raise_signal(how)
if imports:
    sys.addaudithook(hook)
timer = threading.Timer(after, os.kill, [os.getpid(), how])
timer.daemon = True
timer.start()
sys.exit(sim.cli.main())
"""
SAID = {2: "interrupted", 15: "terminated", 1: "the terminal was closed"}
TIMES = first([(0.3, 2), (4, 15), (3, 2), (0.3, 15), (4, 1)], 2)


# -- signals -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(("after", "how"), [*((imports, 2) for imports in (-1, -2, -20, -200, -600, -1000)), *TIMES])
def test_a_signal_ends_a_command_with_its_status_and_one_line(command: str, after: float, how: int):
    """After some seconds, or as a module is imported: before there is anything to clean up the system ends it."""
    when = (str(max(0, -after)), str(after if after > 0 else 1000))
    words = [sys.executable, "-c", STOPPED, str(how), *when, *COMMANDS[command]]
    ran = subprocess.run(words, env=environment(), capture_output=True, text=True, timeout=300)
    assert ran.returncode in (128 + how, -how if after < 1 else 128 + how)
    lines = [line for line in ran.stderr.splitlines() if "compiling kernels" not in line]
    assert lines == ([] if ran.returncode < 0 else [f"pirrht: {SAID[how]}"])


# -- outputs -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize(
    ("line", "status", "error"),
    [
        ("{} scenes | true", 0, ""),  # a reader who has gone is content
        ("{} --help | true", 0, ""),
        ("{} scenes > /dev/full", 2, "pirrht: standard output: No space left on device\n"),
        ("{} scenes >&-", 0, ""),  # what is closed from the start takes everything
        ("{} plan nowhere.xml 2>&-", 2, ""),
    ],
)
def test_an_output_that_takes_no_more_costs_one_line_at_most(tmp_path: Path, unbuffered, line, status, error):
    command = ["bash", "-c", line.format(f"{sys.executable} -m sim.cli") + "; exit ${PIPESTATUS[0]}"]
    ran = subprocess.run(
        command, env=environment() | {"PYTHONUNBUFFERED": unbuffered}, cwd=tmp_path, capture_output=True, text=True
    )
    assert (ran.returncode, ran.stderr) == (status, error)


# -- inputs ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "long name", "no text", "secret"])
@pytest.mark.parametrize(
    "typed",
    ["plan SCENE", "plan slit --robot SCENE", "import SCENE -o b.xml --start 1 1 --goal 2 2 1", "export SCENE -o a"],
)
def test_what_has_no_end_or_no_name_is_refused_at_once(tmp_path: Path, monkeypatch, refused, typed: str, kind: str):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / {"long name": "x" * 300 + ".xml", "no text": "\udcff.xml"}.get(kind, "file.xml")
    odd = {"pipe": os.mkfifo, "folder": Path.mkdir, "device": lambda file: file.symlink_to("/dev/zero")}
    odd.get(kind, str)(file)
    if kind in ("no text", "secret"):
        file.write_text("<mujoco/>")
    if kind == "secret":
        file.chmod(0)
    refused([str(file) if word == "SCENE" else word for word in typed.split()])


# -- compiling ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", first([signal.SIGKILL, signal.SIGTERM, signal.SIGINT]))
def test_a_signal_while_kernels_are_compiled_ends_a_command_at_once(tmp_path: Path, how: int):
    known = environment() | {"NUMBA_CACHE_DIR": str(tmp_path)}
    with subprocess.Popen(
        [sys.executable, "-m", "sim.cli", *COMMANDS["run"]], env=known, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr.readline().startswith("compiling kernels, once ")
        process.send_signal(how)
        _, error = process.communicate()
    assert process.returncode == (-how if how == signal.SIGKILL else 128 + how)
    assert len(error.splitlines()) == (0 if how == signal.SIGKILL else 1)
