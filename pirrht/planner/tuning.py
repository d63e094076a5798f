"""Numbers of the planner that were tuned, with their reasons."""

from typing import NamedTuple


class PlannerTuning(NamedTuple):
    """Tuning of growth and of references."""

    goal_share: float = 0.02  # share of draws that go to the goal, which uniform draws would rarely hit
    draws_per_vertex: int = 50  # most draws for a vertex, lest growth never ends where nothing is free
    draws_in_time: int = 40  # draws between two looks at the time budget: a few milliseconds
    batch: int = 256  # draws that are made and handled together: the more, the later is progress reported
    offer_period: int = 64  # least draws between two offers of one state: early ones are often in vain
    goal_rim: float = 1e-3  # share of the goal's radius within which FCL and Python decide about a state
    vertices: int = 256  # room for vertices and edges to begin with; more is made by doubling
    edges: int = 8192
    pairs: int = 16  # room for (obstacle, turn) pairs of a class, to begin with
    cost_tie: float = 1e-12  # closer costs are equal: rounding must not make two nodes replace each other forever
    shared_edges: int = 200  # edges that are worth more than one thread
    resumed_excess: float = 1e-5  # share of its cost by which a path that was shortened before may exceed another
    optima: int = 4  # local optima of a class in space and time that are shortened where no earlier one is known
    optima_apart: float = 0.1  # least distance of two optima, as a share of the distance to the goal
    optima_excess: float = 0.2  # most excess of their cost over the cheapest, before shortening, as a share
    optima_tried: int = 48  # paths of a class that are compared to find them
    new_classes: int = 1  # new classes in space and time shortened at once, while earlier paths of others are known
    stations: int = 16  # times at which two paths of a class are compared


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


class LimitTuning(NamedTuple):
    """Numbers by which a default limit of |1 - H_i| gives way."""

    wider: tuple[float, ...] = (0.8, 1.0, 1.5)  # limits that are tried after the first [turns]
    longer: float = 1.5  # paths of so many times the shortest length are wanted: people see them in a map
    vertices: int = 400  # of the tree that finds these paths: shortened, they are as short as those of a large one


TUNING = PlannerTuning()
CHAIN = ChainTuning()
RESUME = ResumeTuning()
POLYLINE = PolylineTuning()
IN_TIME = TimedTuning()
LIMITS = LimitTuning()
