"""Options of a recording, checked before any work is done, and viewers that it is sent to while it is made.

Everything started here listens on the loopback interface alone, which Rerun's own functions do not offer.
"""

from __future__ import annotations

import math
import os
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urlsplit

import rerun_cli

from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from sim.files import check_writable, path_text, takes_as_it_comes

SCHEMES = ("rerun", "rerun+http", "rerun+https")
EXAMPLE = "rerun+http://127.0.0.1:9876/proxy"
DATA_PORT, WEB_PORT = 9876, 9090  # of --serve, if they are free
PATIENCE = 20.0  # for a viewer or a server to come up [s]
# Runs a command until standard input ends, so that a server does not outlive its run, however that one ends.
GUARD = """
import subprocess, sys, threading, os
server = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
threading.Thread(target=lambda: os._exit(server.wait()), daemon=True).start()
while sys.stdin.buffer.read(4096):
    pass
server.kill()
"""
SAMPLES = ("all", "some", "none")


def probe(url: str, *, timeout: float = 1.0) -> None:
    """Make sure that a viewer listens at an address; the OptionError reports a URL that is none, or nobody there."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port or (443 if parts.scheme.endswith("https") else 80)
    except ValueError:
        host, port = None, 0
    if not host or parts.scheme not in SCHEMES or parts.path != "/proxy":
        raise OptionError(f"--connect {url}: that is no viewer's address; write one like {EXAMPLE}")
    try:
        socket.create_connection((host, port), timeout).close()
    except OSError as error:
        start = f"start one with `rerun --bind 127.0.0.1 --port {port}`, or record to a file"
        why = error.strerror or error
        raise OptionError(f"--connect {url}: no viewer listens there ({why}); {start}") from None


def _binary() -> Path:
    folder = Path(rerun_cli.__file__).parent
    app = folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun"
    bundled = app if app.exists() else folder / ("rerun.exe" if os.name == "nt" else "rerun")
    return Path(os.environ.get("RERUN_CLI_PATH", bundled))


def check_installed(option: str) -> None:
    """Make sure that Rerun's viewer is there; the OptionError names the option that needs it."""
    if not os.access(_binary(), os.X_OK):
        what = f"there is no viewer at {_binary()}"
        raise OptionError(f"{option}: {what}; install rerun-sdk anew, or use --record FILE.rrd")


def check_display(what: str = "--view", remedy: str = "use --record FILE.rrd and open it elsewhere") -> None:
    """Make sure that there is a display to show a viewer on; the OptionError names another way."""
    if sys.platform.startswith("linux") and not (os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")):
        raise OptionError(f"{what} needs a display, and there is none; {remedy}")


def spawn() -> str:
    """Start a viewer that outlives this process, and return its URL; an OptionError where that does not work."""
    check_display()
    port = _free_port()
    viewer = _start(["--port", str(port), "--expect-data-soon"], stdin=subprocess.DEVNULL)
    _await(viewer, [port], "--view: the viewer")
    return _url(port)


class Server:
    """A viewer for browsers of this machine, and the data that it shows; both end with this process.

    It serves on Rerun's usual ports if they are free; an OptionError where it does not come up.
    """

    def __init__(self) -> None:
        data = _free_port(DATA_PORT)
        web = _free_port(WEB_PORT)
        options = ["--serve-web", "--port", str(data), "--web-viewer-port", str(web), "--server-memory-limit", "1GB"]
        self.process = _start(options, guard=(sys.executable, "-I", "-c", GUARD), stdin=subprocess.PIPE)
        _await(self.process, [data, web], "--serve: the server")
        self.url = _url(data)  # where data goes to
        self.page = f"http://127.0.0.1:{web}/?url={quote(self.url, safe='')}"  # address for the browser

    def stay(self) -> None:
        """Serve until the user has seen enough (Ctrl-C) or the server ends."""
        with suppress(KeyboardInterrupt):
            self.process.wait()


def _start(options: Sequence[str], *, guard: Sequence[str] = (), stdin: int) -> subprocess.Popen[bytes]:
    """Start Rerun's viewer in a session of its own, out of reach of what ends a whole group or terminal."""
    environment = {name: value for name, value in os.environ.items() if name != "FORCE_RERUN_ANALYTICS"}
    return subprocess.Popen(
        [*guard, str(_binary()), "--bind", "127.0.0.1", *options],
        env=environment | {"CI": "1"},  # Rerun's usage statistics stay off where this is set
        stdin=stdin,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _await(process: subprocess.Popen[bytes], ports: Sequence[int], what: str) -> None:
    deadline = time.monotonic() + PATIENCE
    waiting = list(ports)

    while waiting and time.monotonic() < deadline and process.poll() is None:
        try:
            socket.create_connection(("127.0.0.1", waiting[0]), 1.0).close()
            waiting.pop(0)
        except OSError:
            time.sleep(0.05)
    if waiting and process.poll() is None:
        process.stdin.close() if process.stdin is not None else process.terminate()
        raise OptionError(f"{what} did not come up within {PATIENCE:g} s; use --record FILE.rrd")
    if waiting:
        why = f"ended at once (exit status {process.returncode}); run `rerun` to see why"
        raise OptionError(f"{what} {why}, or use --record FILE.rrd")


def _url(port: int) -> str:
    return f"rerun+http://127.0.0.1:{port}/proxy"


def _free_port(wanted: int = 0) -> int:
    """Return the port wanted, if it is free on the loopback interface; otherwise any."""
    with socket.socket() as listener:
        try:
            listener.bind(("127.0.0.1", wanted))
        except OSError:
            listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """Amount of a run that is drawn, and obstacles by which the tree is lifted; an OptionError if it cannot be."""

    hz: float = 5.0  # references and samples per simulated second [1/s]
    samples: str = "some"  # sampled paths: "all", "some" or "none"
    truth: bool = False  # whether every frame comes with the exact value and the optimal control
    lift: Sequence[int] | None = None  # obstacles, from 1, whose H is the height of a tree; None: the telling ones

    def __post_init__(self) -> None:
        if not (math.isfinite(self.hz) and self.hz > 0):
            raise OptionError(f"--record-hz is {self.hz:g}; it must be a positive number of pictures per second")
        if self.samples not in SAMPLES:
            raise OptionError(f"--record-samples is {self.samples!r}; it must be one of {', '.join(SAMPLES)}")

    def check(self, space: FreeSpace) -> None:
        """Make sure that the obstacles to lift by are there; the OptionError has the numbers that there are."""
        M = len(space.obstacles)
        if self.lift is not None and space.scene.dimension == 3:
            raise OptionError("--record-lift draws H as a height, which a robot in space has already; leave it out")
        if not all(1 <= k <= M for k in self.lift or ()):
            numbers = ",".join(map(str, self.lift or ()))
            there = f"has the obstacles 1 to {M}; name one or two" if M else "has no obstacles to wind around; leave it"
            raise OptionError(f"--record-lift {numbers}: {space.scene.name} {there}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sinks:
    """A file, which misses nothing, and viewers, which never hold the run up."""

    file: Path | None = None  # an .rrd; an existing one is replaced once rows of the run are on disk
    connect: str | None = None  # URL of a running viewer
    view: bool = False  # start a viewer
    serve: bool = False  # serve browsers of this machine

    def __bool__(self) -> bool:
        """Return whether there is any."""
        return self != Sinks()

    def check(self) -> None:
        """Make sure, without touching anything, that each can be had; the OptionError reports why one cannot."""
        if (file := self.file) is not None:
            name = f"--record {path_text(file)}"
            if takes_as_it_comes(file) and not os.path.samefile(file, os.devnull):
                what = "a pipe" if file.is_fifo() else "no file to write a recording to"
                way = "give the path of a file, or let a viewer follow with --connect or --serve"
                raise OptionError(f"{name} is {what}; {way}")
            check_writable(file, "--record")
            if file.suffix not in ("", ".rrd"):
                raise OptionError(f"{name}: viewers know recordings by their ending; call it {file.stem}.rrd")
        if self.connect is not None:
            probe(self.connect)
        if self.view:
            check_display()
        if self.view or self.serve:
            check_installed("--view" if self.view else "--serve")
