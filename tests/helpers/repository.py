"""Where the repository lies, for tests that run a command or read a file of it."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
