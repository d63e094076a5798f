"""Tuning numbers of classes of paths."""

from typing import NamedTuple


class TopologyTuning(NamedTuple):
    """Numbers that trade time against exactness, and margins for rounding."""

    cut_rounds: int = 100  # parts cut off before two inflated shapes count as apart: each takes 37 % of the area
    meeting_rounds: int = 100  # moves of a point into sets that may meet, at each depth
    meeting_shift: float = 0.1  # of the places where it starts [robot radii]
    few_markers: int = 8  # up to so many markers are all tested: measured as faster than finding their sector
    sector_margin: float = 1e-9  # sectors are widened by so much for rounding, of 4 for a whole turn
    goal_margin: float = 1e-6  # a segment that passes the goal point this close, against its length, tests all markers
    outside_margin: float = 1e-9  # a marker must be farther than this from a triangle to lie outside of it [m^2]
    base_piece: float = 0.02  # the base of sampled paths is evaluated so often [s]: rays hardly turn in between
    box_span: float = 2.0  # of the boxes that a marker's trajectory lies in [s]: short is exact, long is quick
    chord_error: float = 0.25  # deviation of a trajectory from its chords [robot radii]: few rows, same side


TUNING = TopologyTuning()
