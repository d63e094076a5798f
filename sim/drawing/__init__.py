"""Shared parts of pictures: colours of classes, words for them, and lines that are drawn."""
