"""Tuning numbers of steering methods."""

from typing import NamedTuple


class SteeringTuning(NamedTuple):
    """Numbers that trade accuracy and coverage against time."""

    # Headings at the goal point from which a tree of poses starts. More of them cost vertices; 16 leave 11 degrees.
    root_headings: int = 16
    # By which curves that guides start from turn tighter than references: the first finds most other optima of a disc,
    # the second those of a rectangle that turns in its own length.
    tightness: tuple[float, ...] = (3.0, 7.0)
    # Headings at the goal point of a robot with corners that turns on the spot: what arrives there turns no more.
    arrivals: int = 4
    # Share of the poses drawn for such a robot, and headings tried, that are turned to the most clearance.
    aligned_share: float = 0.5
    aligned_headings: int = 16
    # Step of the search for room to turn straight ahead of the start and behind it, in inscribed radii.
    way_out_step: float = 0.5
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


class ChainTuning(NamedTuple):
    """Numbers that trade the length of chains against time; found on random scenes of discs."""

    stations: tuple[int, int] = (12, 16)  # of each round: more rounds or stations gain a few parts in a thousand
    link_gain: float = 1e-5  # share of the path that a link must save, so that rounding makes no links
    leg_charge: float = 1e-6  # charge of each leg as a share of the path: fewer legs make fewer vertices that move
    rounding: float = 1e-6  # share by which parts of a motion may cost more than it; else a state is none of its own
    levels: int = 4  # step sizes, each half of the one before: further ones save less than 1e-4 of the path
    first_step: float = 0.25  # of the search, in units of the state [m], [rad], [m/s] or turning radii
    move_gain: float = 1e-6  # share of its two legs that a move must save, so that the search ends


class ResumeTuning(NamedTuple):
    """Numbers by which a path goes on from an earlier one of its class."""

    corners: int = 6  # of the earlier path that the new one may go on from: those farther away are seldom in sight
    into_goal: float = 1e-3  # share of the way from the goal's rim to its centre by which it goes on, to surely arrive


class PolylineTuning(NamedTuple):
    """Numbers of the shortening of polylines: the length that is left against time."""

    rounds: int = 12  # of shortcuts and cut corners
    gain: float = 1e-5  # share of the length below which a round is the last
    flat_turn: float = 0.02  # corners that turn less stay if they touch something [rad]: they cost a part in 20 000
    patience: int = 3  # corners that are tried without success before a piece is as long as it gets, after a round
    straight_turn: float = 1e-6  # turns that are rounding [rad]
    touching: float = 4e-3  # clearance from which nothing is touched [m]: above the error bound of the clearance field
    capacity: int = 64  # room for corners while a path gets shorter: at least
    capacity_per_corner: int = 8  # and per corner that it had
    loose_rounds: int = 8  # for corners that touch nothing
    loose_capacity: int = 256  # room for theirs
    halvings: int = 6  # of the legs of a corner that is cut: to 2 %
    slide_halvings: int = 12  # of the leg along which a corner slides: to 0.02 %


class TimedTuning(NamedTuple):
    """Numbers of the shortening in space and time, found on scenes with crossing obstacles and closing doors."""

    # Legs of each round, and clearances to keep [m]; the first with which all legs are certified counts.
    rounds: tuple[tuple[int, tuple[float, ...]], ...] = ((24, (1e-2, 3e-2)), (40, (1e-3, 4e-3, 1.5e-2)))
    margins_again: tuple[float, ...] = (4e-3, 1.5e-2, 0.0)  # of an earlier path [m]; with 0 only its start changes
    soon: float = 0.5  # a knot that is as near in time is left out, in mean durations of legs
    patience: int = 2  # knots that are tried without success before a straight leg is as long as it gets
    bends: float = 0.6  # share of the knots of a round that go where the path bends
    # Weights of squares of what is lacking, one after the other [cost/m^2]: the last one leaves a millimetre.
    weights: tuple[float, ...] = (1e2, 3e3, 1e5)
    steps: int = 12  # Newton steps for each weight
    halvings: int = 6  # of a step that saves nothing
    settled: float = 1e-6  # a step that saves less than this share of the cost is the last one for its weight
    leg_points: tuple[float, ...] = (0.5, 1.0)  # points of a leg that keep off everything, as shares of it
    longest_step: float = 0.5  # of a knot, in radii of the robot: clearances are known well only outside of solids
    shortest_duration: float = 0.7  # share of the duration that a step leaves at least
    inside: float = 1e-3  # share of the goal's radius by which a path leads into the disc
    slower: float = 1e-3  # share by which legs keep below the limit of speeds


TUNING = SteeringTuning()
CHAIN = ChainTuning()
RESUME = ResumeTuning()
POLYLINE = PolylineTuning()
IN_TIME = TimedTuning()
