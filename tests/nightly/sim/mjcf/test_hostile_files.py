"""Files of bad intent load or are refused with one line, in bounded time and memory."""

from __future__ import annotations

import os
import resource
import shutil
import signal
from collections import Counter
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hostile_mjcf import hostile

from pirrht.errors import SceneError
from sim.mjcf import load

FILES = 600
MEMORY, SECONDS = 3 * 2**30, 180  # the trial of `sim.mjcf.limits` has 2 GiB and 120 s, and machines are busy


def outcome(path: Path) -> str:
    """What becomes of a file in a child of this process, by the first line that it writes."""
    told, noise = path.with_name("told"), path.with_name("noise")
    child = os.fork()
    if child == 0:
        try:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(SECONDS)
            used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
            os.dup2(os.open(noise, os.O_CREAT | os.O_WRONLY), 2)
            words = _loaded(path)
            told.write_text(
                f"error: it printed {noise.read_text()[:300]!r}" if noise.stat().st_size else words, errors="replace"
            )
        except BaseException as error:
            told.write_text(f"error: {error!r}"[:1000])
        finally:
            os._exit(0)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return (told.read_text() if told.exists() else "") or f"error: ended with {status}"


def _loaded(path: Path) -> str:
    try:
        scene = load(path).scene
    except SceneError as error:
        return f"refused: {error}" if "\n" not in str(error) else f"error: more than a line: {str(error)!r}"
    for solid in scene.obstacles:
        assert np.all(np.isfinite(solid.position))
        np.testing.assert_allclose(solid.rotation @ solid.rotation.T, np.eye(3), atol=1e-6)
    return "loaded"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="each file is loaded in a forked child")
def test_hostile_files_load_or_are_refused_with_one_line(tmp_path):
    rng, found, wrong = Random(46), Counter[str](), []
    for number in range(FILES):
        folder = tmp_path / f"case{number}"
        folder.mkdir()
        path = hostile(folder, rng)
        words = outcome(path)
        found[words.partition(":")[0]] += 1
        if words.startswith("error"):
            wrong.append(f"{path}: {words}\n{path.read_bytes()[:600]!r}")
        else:
            shutil.rmtree(folder)
    assert not wrong, f"{len(wrong)} of {FILES}\n" + "\n\n".join(wrong[:10])
    assert found["loaded"] >= FILES // 12
    assert found["refused"] >= FILES // 2
