#!/usr/bin/env bash
# Lint, types and tests on a fresh machine; with --full tests of all tiers (tests/README.md). Other words go to pytest.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/environment.sh
extras=sim,test,figures,gym,maps,ros
words=()
if [ "${1:-}" = --full ]; then
    shift
    extras+=,cluster,decompose,docs,nightly,video
    words=(tests/unit tests/integration tests/nightly --full)
fi
prepare ".[$extras]"
{ pirrht warm puck unicycle && pirrht warm --moving puck; } &
warming=$!
trap 'kill "$warming" 2>/dev/null || true' EXIT
ruff check .
ruff format --check .
lint-imports
python scripts/words.py
mypy
wait "$warming"
trap - EXIT
python -m pytest --numprocesses 2 --dist worksteal "${words[@]}" "$@"
