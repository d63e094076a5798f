"""Drives in Rerun: what is written, how it is laid out and streamed, and how it is read back."""
