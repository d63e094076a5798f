"""Figures of the paper made anew, and those of the documents; `reproduce_figures.py` and `gallery.py` write them."""
