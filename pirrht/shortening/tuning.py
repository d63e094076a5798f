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


class PolylineTuning(NamedTuple):
    """Numbers of the shortening of polylines: the length that is left against time."""

    # Rounds of shortcuts and blunted corners, and the share of the length below which a round is the last.
    rounds: int = 12
    gain: float = 1e-5
    # Corners that turn less stay if they touch something [rad]: blunting them saves a part in 20 000 of their legs.
    flat_turn: float = 0.02
    # Turns that are rounding [rad].
    straight_turn: float = 1e-6
    # A corner of more clearance touches nothing [m]: a little more than the error bound of the clearance field.
    touching: float = 4e-3
    # Room for corners while a path gets shorter: at least, and per corner that it had.
    capacity: int = 64
    capacity_per_corner: int = 8
    # Rounds for corners that touch nothing, and room for theirs.
    loose_rounds: int = 8
    loose_capacity: int = 256
    # Halvings of the legs of a corner that is blunted, and of one along which a corner slides: to 2 % and 0.02 %.
    halvings: int = 6
    slide_halvings: int = 12


class TimedTuning(NamedTuple):
    """Numbers of the shortening in space and time, found on scenes with crossing obstacles and closing doors."""

    # Legs of each round, and clearances to keep [m]; the first with which all legs are certified counts.
    rounds: tuple[tuple[int, tuple[float, ...]], ...] = ((24, (1e-2, 3e-2)), (40, (1e-3, 4e-3, 1.5e-2)))
    # Clearances when an earlier path is shortened again [m]; with 0 only its start changes.
    margins_again: tuple[float, ...] = (4e-3, 1.5e-2, 0.0)
    # A knot that is as near in time is left out, in mean durations of legs.
    soon: float = 0.5
    # Knots that are tried without success before a straight leg is as long as it gets.
    patience: int = 2
    # Share of the knots of a round that go where the path bends.
    bends: float = 0.6
    # Weights of squares of what is lacking, one after the other [cost/m^2]: the last one leaves a millimetre.
    weights: tuple[float, ...] = (1e2, 3e3, 1e5)
    # Newton steps for each weight, and halvings of one that saves nothing.
    steps: int = 12
    halvings: int = 6
    # A step that saves less than this share of the cost is the last one for its weight.
    settled: float = 1e-6
    # Points of a leg that keep off everything, as shares of it.
    leg_points: tuple[float, ...] = (0.5, 1.0)
    # A step moves knots by at most so many radii of the robot: clearances are known well only outside of solids.
    longest_step: float = 0.5
    # Share of the duration that a step leaves at least.
    shortest_duration: float = 0.7
    # Share of the goal's radius by which a path leads into the disc.
    inside: float = 1e-3
    # Share by which legs keep below the limit of speeds.
    slower: float = 1e-3


TUNING, RESUME, POLYLINE, IN_TIME = ChainTuning(), ResumeTuning(), PolylineTuning(), TimedTuning()
