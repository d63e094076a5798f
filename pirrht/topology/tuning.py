"""Numbers of topology that were tuned, with their reasons."""

from __future__ import annotations

from typing import NamedTuple


class TopologyTuning(NamedTuple):
    """Tuning of crossings, marker trajectories and topological obstacles; no value changes a class."""

    few_markers: int = 8  # up to so many markers are all tested: measured as faster than finding their sector
    sector_margin: float = 1e-9  # sectors are widened by so much for rounding, of 4 for a whole turn
    goal_margin: float = 1e-6  # a segment that passes the goal point this close, against its length, tests all markers
    box_span: float = 2.0  # span of the boxes that a marker's trajectory lies in [s]: short is exact, long is quick
    outside_margin: float = 1e-9  # a marker must be farther than this from a triangle to lie outside of it [m^2]
    base_piece: float = 0.02  # the base of sampled paths is evaluated so often [s]: rays hardly turn in between
    chord_error: float = 0.25  # deviation of a marker's trajectory from its chords [robot radii]: few rows, same side
    marker_offset: tuple[float, float] = (1.7e-3, -2.9e-3)  # of moving markers from the middle [robot radii]: off lines
    lone_plane: float = 1e3  # half the side of the plane in which a moving obstacle is examined on its own [m]
    cut_rounds: int = 100  # parts cut off before two inflated shapes count as apart: each takes 37 % of the area


TUNING = TopologyTuning()
