"""The long tests of unit/sim/test_files.py."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
from repository import environment

TERMINATED = """
import signal, sys, time
from pathlib import Path
from sim.film import film
def stop(*_): raise SystemExit(143)
signal.signal(signal.SIGTERM, stop)
def pictures():
    import numpy as np
    for k in range(10_000):
        print(k, flush=True)
        time.sleep(0.01)
        yield np.zeros((film.HEIGHT, film.WIDTH, 3), np.uint8)
with film.replaced(Path(sys.argv[1]), "--video") as stream:
    film._encode(stream, pictures())
"""


def test_a_film_that_is_terminated_leaves_what_was_there(tmp_path):
    pytest.importorskip("av")
    file = tmp_path / "a.mp4"
    file.write_bytes(b"old")
    command = [sys.executable, "-c", TERMINATED, str(file)]
    with subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, text=True) as process:
        next(line for line in process.stdout if int(line) == 5)
        assert len(list(tmp_path.iterdir())) == 2
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)
    assert (process.returncode, file.read_bytes(), list(tmp_path.iterdir())) == (143, b"old", [file])
