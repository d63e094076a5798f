"""Worlds and maps that other programs made, as scenes."""
