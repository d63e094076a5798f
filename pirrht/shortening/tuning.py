"""Tuning numbers of path shortening."""

from __future__ import annotations

from typing import NamedTuple


class ChainTuning(NamedTuple):
    """Numbers that trade the length of chains against time; found on random scenes of discs."""

    # Stations of each round: more rounds or stations gain a few parts in a thousand.
    stations: tuple[int, int] = (12, 16)
    # A link must save this share of the path, so that rounding makes no links.
    link_gain: float = 1e-5
    # Charge of each leg as a share of the path: fewer legs make fewer vertices that move.
    leg_charge: float = 1e-6
    # Share of the cost of a motion by which its parts may cost more; else a state is none of its own.
    rounding: float = 1e-6
    # Step sizes of the search, each half of the one before: further ones save less than 1e-4 of the path.
    levels: int = 4
    # First step of the search, in units of the state [m], [rad], [m/s] or turning radii.
    first_step: float = 0.25
    # A move must save this share of its two legs, so that the search ends.
    move_gain: float = 1e-6


class ResumeTuning(NamedTuple):
    """Numbers by which a path goes on from an earlier one of its class."""

    # Corners of the earlier path that the new one may go on from: those farther away are seldom in sight.
    corners: int = 6
    # Share of the way from the goal's rim to its centre by which a path that ends on the rim goes on, to surely arrive.
    into_goal: float = 1e-3


TUNING, RESUME = ChainTuning(), ResumeTuning()
