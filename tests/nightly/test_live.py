"""Viewers while a drive goes on: served on the loopback interface alone, never able to stop or stall the run."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
from tasks import wait_for
from thoroughly import first

from sim.recording import export, viewer

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="reads sockets and signals as Linux has them"),
]

SHORT = ["slit", "--noise", "0.3", "--vertices", "80", "--samples", "60", "--seed", "1"]
SERVED = re.compile(r"http://127\.0\.0\.1:(\d+)/\?url=rerun%2Bhttp%3A%2F%2F127\.0\.0\.1%3A(\d+)%2Fproxy")


def drive(*options: str, **popen) -> subprocess.Popen:
    popen = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, **popen}
    # What was started in the background of a script ignores Ctrl-C, and would pass that on.
    return subprocess.Popen(
        [sys.executable, "-m", "sim.cli", "run", *SHORT, *options],
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        **popen,
    )


def family(pid: int):
    """A process and its descendants."""
    yield pid
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in task.read_text().split():
            yield from family(int(child))


def listening(pid: int) -> set[tuple[str, int]]:
    """Addresses and ports on which a process and its descendants listen."""
    inodes = set()
    for member in family(pid):
        for handle in Path(f"/proc/{member}/fd").iterdir():
            found = re.fullmatch(r"socket:\[(\d+)\]", os.readlink(handle)) if handle.is_symlink() else None
            inodes |= {found[1]} if found else set()
    addresses = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            _, local, _, state, *_, inode = line.split()[:10]
            if state == "0A" and inode in inodes:
                address, port = local.split(":")
                addresses.add((address, int(port, 16)))
    return addresses


def gone(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) != 0


def served(process: subprocess.Popen) -> re.Match:
    for line in process.stdout:
        if found := SERVED.search(line):
            return found
    raise AssertionError("nothing was served")


def test_what_is_served_listens_on_the_loopback_interface_alone_and_ends_with_the_run(tmp_path):
    process = drive("--serve", "--record", str(tmp_path / "a.rrd"), "--max-time", "1.5")
    address = served(process)
    ports = {int(address[1]), int(address[2])}
    assert listening(process.pid) == {("0100007F", port) for port in ports}
    assert b"<html" in urllib.request.urlopen(f"http://127.0.0.1:{address[1]}/", timeout=10).read()
    said = process.communicate(timeout=60)[0]
    assert process.returncode in (0, 1), said
    assert "0 of" in said
    assert export.read(tmp_path / "a.rrd").whole
    assert all(gone(port) for port in ports)


@pytest.mark.parametrize("blow", first([signal.SIGKILL, signal.SIGTERM, signal.SIGHUP]))
@pytest.mark.parametrize("all_at_once", [False, True])  # as a closing terminal and `timeout` do
def test_a_server_does_not_outlive_its_run_whatever_ends_that(blow, all_at_once):
    process = drive("--serve", "--max-time", "20", start_new_session=True)
    address = served(process)
    os.killpg(process.pid, blow) if all_at_once else process.send_signal(blow)
    process.communicate(timeout=30)
    for port in (int(address[1]), int(address[2])):
        wait_for(lambda port=port: gone(port), 15.0)


def test_from_a_terminal_it_is_served_until_ctrl_c():
    master, slave = os.openpty()
    process = drive("--serve", "--max-time", "0.05", stdout=slave, stderr=slave, text=False)
    os.close(slave)
    said = b""
    while b"until Ctrl-C" not in said:
        said += os.read(master, 4096)
    (port, _) = SERVED.search(said.decode()).groups()
    time.sleep(0.3)
    assert process.poll() is None
    assert not gone(int(port))
    process.send_signal(signal.SIGINT)
    assert process.wait(30.0) == 1  # time was up
    wait_for(lambda: gone(int(port)), 15.0)
    os.close(master)


@pytest.mark.parametrize("blow", first([signal.SIGSTOP, signal.SIGKILL]))
def test_a_viewer_that_dies_or_hangs_neither_stops_nor_stalls_the_run(tmp_path, blow):
    port, file = viewer._free_port(), tmp_path / "a.rrd"
    watcher = viewer._start(["--serve-grpc", "--port", str(port)], stdin=subprocess.DEVNULL)
    try:
        viewer._await(watcher, [port], "the viewer")
        assert listening(watcher.pid) == {("0100007F", port)}
        process = drive("--connect", viewer._url(port), "--record", str(file), "--max-time", "4")
        wait_for(lambda: file.exists() and file.stat().st_size > 300_000)
        os.killpg(watcher.pid, blow)
        said = process.communicate(timeout=90)[0]
        assert process.returncode in (0, 1), said
        assert "Traceback" not in said
        dropped, steps = map(int, re.search(r"(\d+) of (\d+) steps did not reach a viewer", said).groups())
        assert (blow == signal.SIGKILL) <= dropped <= steps
        assert export.read(file).whole
    finally:
        os.killpg(watcher.pid, signal.SIGKILL)
        watcher.wait()


def test_usage_statistics_of_everything_started_are_off(monkeypatch):
    started = []
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    monkeypatch.setattr(
        viewer.subprocess, "Popen", lambda command, **options: started.append((command, options["env"]))
    )
    monkeypatch.setattr(viewer, "_await", lambda *_: None)
    monkeypatch.setattr(viewer, "check_display", lambda: None)
    viewer.spawn()
    viewer.Server()
    assert len(started) == 2
    for command, environment in started:
        assert environment["CI"] == "1"
        assert "FORCE_RERUN_ANALYTICS" not in environment
        assert command[command.index("--bind") + 1] == "127.0.0.1"
