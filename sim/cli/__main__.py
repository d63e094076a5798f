"""`python -m sim.cli` is the command `pirrht`."""

import sys

from sim.cli import main

sys.exit(main())
