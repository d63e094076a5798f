"""Recordings of runs in Rerun: written to a file, shown by viewers, read back as tables."""

import os

# Rerun would report on the terminal what a run reports in one line of its own; read once, when Rerun is imported.
os.environ.setdefault("RUST_LOG", "off")
