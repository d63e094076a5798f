"""Viewers that a recording is sent to while it is made: finding a running one, starting one."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from urllib.parse import urlsplit

from pirrht.errors import OptionError

SCHEMES = ("rerun", "rerun+http", "rerun+https")
EXAMPLE = "rerun+http://127.0.0.1:9876/proxy"
PATIENCE = 20.0  # how long a viewer may take to open its window [s]


def probe(url: str, *, timeout: float = 1.0) -> None:
    """Make sure that something listens where a viewer should be.

    Raises:
        OptionError: the URL is no viewer's, or nobody listens there.
    """
    host, port = _address(url)
    try:
        socket.create_connection((host, port), timeout).close()
    except OSError as error:
        raise OptionError(
            f"--connect {url}: no viewer listens there ({error.strerror or error}); start one with "
            f"`rerun --bind 127.0.0.1 --port {port}`, or record to a file"
        ) from None


def spawn() -> str:
    """Start a viewer of this machine's own on a free port of the loopback interface; its URL.

    Raises:
        OptionError: there is no display, or the viewer does not come up.
    """
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise OptionError("--view needs a display, and there is none; use --record FILE.rrd and open it elsewhere")
    port = _free_port()
    environment = {name: value for name, value in os.environ.items() if name != "FORCE_RERUN_ANALYTICS"}
    viewer = subprocess.Popen(
        [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", str(port), "--expect-data-soon"],
        env=environment | {"CI": "1"},  # Rerun's usage statistics stay off where this is set
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    url, deadline = f"rerun+http://127.0.0.1:{port}/proxy", time.monotonic() + PATIENCE
    while time.monotonic() < deadline and viewer.poll() is None:
        try:
            probe(url)
            return url
        except OptionError:
            time.sleep(0.05)
    if viewer.poll() is None:
        viewer.terminate()
        raise OptionError(f"--view: the viewer did not come up within {PATIENCE:g} s; use --record FILE.rrd")
    raise OptionError(
        f"--view: the viewer ended at once (exit status {viewer.returncode}); run `rerun` to see why, "
        "or use --record FILE.rrd"
    )


def _address(url: str) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or parts.scheme not in SCHEMES or parts.path != "/proxy":
        raise OptionError(f"--connect {url}: that is no viewer's address; write one like {EXAMPLE}")
    return host, port or (443 if parts.scheme.endswith("https") else 80)


def _free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])
