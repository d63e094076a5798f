"""Tuning numbers of steering methods."""

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
    # Speeds [m/s] at which the cost per meter is queried, geometric from the first to the second, and their number.
    probed_speeds: tuple[float, float, int] = (1e-3, 1e3, 6001)
    # States at which a constant speed is queried.
    probed_states: int = 8
    # Tries to draw a place and time of use in space and time, before a uniform one is taken.
    tries: int = 32
    # Share of the draws that is uniform in space and time, so that every path is found at last.
    uniform_share: float = 0.2
    # Excess of cost that half of the other draws stay below, as a share of the unhindered cost.
    excess: float = 0.5
    # Where passages are driven through in space and time: shares of the clearance to either side, places along [robot
    # radii], and speeds on the way there [best speeds].
    passage_offsets: tuple[float, ...] = (0.0, -0.9, 0.9, -0.5, 0.5)
    passage_places: tuple[float, ...] = (0.0, 3.0, -3.0)
    passage_paces: tuple[float, ...] = (4.0, 3.0, 2.2, 1.8, 1.5, 1.25, 1.0, 0.75, 0.5)
    # Cost of such a path at most [unhindered costs], and number of these states, the cheapest ones.
    passage_cost: float = 2.5
    passage_states: int = 256


TUNING = SteeringTuning()
