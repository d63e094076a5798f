#!/usr/bin/env bash
# From nothing to a recorded drive: a virtual environment, the package, and the paper's first example.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/environment.sh
prepare ".[sim]"
pirrht run slit --record slit.rrd "$@"
