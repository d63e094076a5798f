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
    saving: float = 0.25  # share of its cost that shortening saves a path at most, but for rare ones
    new_classes: int = 1  # new classes in space and time shortened at once, while earlier paths of others are known
    stations: int = 16  # times at which two paths of a class are compared


class LimitTuning(NamedTuple):
    """Numbers by which a default limit of |1 - H_i| gives way."""

    wider: tuple[float, ...] = (0.8, 1.0, 1.5)  # limits that are tried after the first [turns]
    longer: float = 1.5  # paths of so many times the shortest length are wanted: people see them in a map
    vertices: int = 400  # of the tree that finds these paths: shortened, they are as short as those of a large one


TUNING = PlannerTuning()
LIMITS = LimitTuning()
