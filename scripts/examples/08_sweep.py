"""Compare methods on equal seeds: a small sweep into a dataset, and its report."""

import sys
import tempfile
from pathlib import Path

from sim import cli

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp()) / "slit-sweep"
few = ["--vertices", "200", "--period", "0.1", "--max-time", "10", "--jobs", "1"]
grid = ["--methods", "pi-rrht,single", "--noise", "0.3", "--seeds", "0:3"]
if __name__ == "__main__":  # workers import this file
    cli.main(["sweep", "slit", *grid, *few, "-o", str(folder)])
    cli.main(["report", str(folder)])
