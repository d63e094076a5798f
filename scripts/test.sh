#!/usr/bin/env bash
# Lint, types and the whole test suite on a fresh machine.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/environment.sh
prepare ".[test,figures,video,docs]"
ruff check .
ruff format --check .
mypy
# One more than cores: many tests wait for processes that they stop.
python -m pytest --numprocesses 3 --dist loadfile "$@"
