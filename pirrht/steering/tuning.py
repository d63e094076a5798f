"""Tuning numbers of steering methods."""

from __future__ import annotations

from typing import NamedTuple


class SteeringTuning(NamedTuple):
    """Numbers that trade accuracy and coverage against time."""

    # Headings at the goal point from which a tree of poses starts. More of them cost vertices; 16 leave 11 degrees.
    root_headings: int = 16
    # Piece of constant control into which a mass' acceleration is divided [s]: the step of rollouts is no shorter.
    control_piece: float = 0.05
    # Side of the polyline that stands for a cubic where the clearance field certifies nothing [m]: FCL's resolution.
    shortest_side: float = 1e-3
    # Shares of the top speed at which draws in passages are driven through: fast and at half the speed.
    passage_speeds: tuple[float, ...] = (0.5, 1.0)
    # Top speed of draws in space and time, in best speeds, of a robot without a limit: costs grow as its square.
    fastest: float = 5.0


TUNING = SteeringTuning()
