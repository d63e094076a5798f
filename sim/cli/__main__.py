"""`python -m sim.cli` is the command `pirrht`."""

import os
import sys

if not sys.flags.safe_path and os.path.join(sys.path[0], "sim", "cli", "__main__.py") != __file__:
    del sys.path[0]  # the current folder, unless this file is there

from sim.cli import main

sys.exit(main())
