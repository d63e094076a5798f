"""The long tests of unit/pirrht/tree/test_growth.py."""

from __future__ import annotations

import subprocess
import sys

from repository import environment


def test_the_kernel_of_growth_is_found_on_disk_by_the_next_process(slit_tree):
    """A kernel is looked up by what its closure holds; compiling must not change that."""
    program = (
        "from sim.scenario import prepare\n"
        "tree = prepare('slit').empty_tree(); tree.reserve(20)\n"
        "stats = tree._grow_kernel.stats; print(sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))"
    )
    slit_tree.reserve(slit_tree.size)
    told = subprocess.run(
        [sys.executable, "-c", program], env=environment(), capture_output=True, text=True, check=True
    )
    assert told.stdout.split() == ["1", "0"]
