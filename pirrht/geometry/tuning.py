"""Hold the tuning numbers of the geometry: each trades accuracy for time or memory."""

from typing import NamedTuple


class GeometryTuning(NamedTuple):
    """Numbers of fields, distances, passages and of what is fitted to walls."""

    # Clearance field
    cells_per_radius: float = 8.0  # spacings in a robot's radius: half the spacing, half the error, 4 times the time
    band: float = 2.0  # a cell is refined where its clearance is less than so many of its widths: error against points
    cutoff: float = 1.0  # clearances are reported up to this [m]: exits and bridges are decided far below it
    sharp: float = 4.0  # changes of walls nearer than so many robot radii are refined, as proposals lean on both walls
    nothing: float = 1e6  # clearance where there are no obstacles at all [m]: more than any workspace
    dense_points: int = 4_000_000  # up to so many points one grid holds them all: quicker to read than blocks
    least_cells: float = 4.0  # spacings in a ball's radius, at least: in space a grid gives away 1/36 of it at walls
    meshes: float = 16.0  # in space, so many of which halve the points of a grid, since they take time
    flat: float = 1e-5  # difference of unit vectors away from a wall in space up to which it is flat
    slab_points: int = 400_000  # of a grid in space that are sampled together: memory against calls
    single_cells: float = 2.0**17  # spacings from the origin at which single precision is too coarse for paths
    table_places: int = 32_000_000  # places of the largest table of blocks: 4 bytes each
    block_points: int = 24_000_000  # points of all blocks: 12 bytes and about a quarter of a microsecond each
    coarse_cells: int = 4_000_000  # cells of the coarsest blocks: the search for passages takes four places for each
    blocks_at_once: int = 4096  # blocks that are sampled together: memory against calls
    least_step: float = 1e-3  # a certificate that would advance by less is left to FCL [m]: steps against FCL's queries
    # First exits
    line: float = 1e-9  # det / trace^2 of a covariance below which noise counts as along a line; rounding
    # Distances
    probe: float = 1e-6  # radius of the sphere that stands for the robot's centre; nearer counts as inside [m]
    shortest: float = 1e-4  # curve pieces that are still undecided at this length count as blocked [m]: bisections
    kink_cells: float = 3.0  # within so many cells of a waiver's rim interpolation is corrected: safe for 1-Lipschitz
    bins_per_side: int = 2048  # of a lattice of solids: memory against solids per bin
    apart_cosine: float = 0.5  # of the angle from which on two directions are those of two walls
    rise_sine: float = 0.15  # of the angle by which a solid rises from a nearer wall's plane, or is in line with it
    rounding: float = 1e-9  # overlap that is rounding and no contact [m]
    parallel: int = 10_000  # points from which on several threads look for their walls: a millisecond or two
    # Passages
    room_depth: float = 0.5  # a room is deeper than its door by so many spacings of the field, or it is grain
    solid_depth: float = 0.5  # an obstacle is deeper than a gap by this share of the robot's radius, at least
    squares_per_radius: float = 2.0  # squares in which saddles are sought: the thinnest obstacle still blocks one
    chord_angles: int = 16  # directions that are tried first, over half a turn
    chord_turns: int = 4  # searches for the direction, each four times as fine
    chord_moves: int = 10  # moves along the axis, to where a passage is narrowest
    chord_gain: float = 1e-3  # a move must shorten the chord by this share of it
    chord_halvings: int = 12  # of the interval in which a chord ends: below a thousandth of a spacing
    walk_step: float = 0.5  # of a walk along the axis [robot radii]
    walk_steps: int = 60  # of the longest walk to one side
    walk_wider: float = 1.0  # a walk ends with so much more clearance than in the middle [robot radii]
    wide: float = 2.0  # a passage of this clearance needs no axis: uniform draws see it [robot radii]
    # Moving obstacles
    shapes: int = 1024  # of obstacles of which is remembered what does not depend on how they move: memory
    moment: float = 1e-9  # least time by which a walk along a motion advances [s]: rounding
    # Footprints
    robot_height: float = 0.1  # of a robot's centre above the ground, if none is given [m]
    widest_footprint: float = 1e3  # farthest corner of a footprint [m]
    outline_pieces: int = 30  # of a whole turn, as which round parts are drawn
    excess: float = 0.01  # by which the discs that cover a polygon reach beyond it, with their field's error [m]
    cover_share: float = 0.55  # of the excess that the discs take; the rest is the field's
    sure: float = 10.0  # so many times the excess a clearance may be for that to hold; beyond, the field is coarser
    group_excess: float = 5.0  # what the circle around a group of discs reaches beyond, as a multiple of the excess
    tight: float = 10.0  # up to so many times the excess the clearance of a group is that of its discs
    cover_slack: float = 0.2  # by which discs overlap, as a share of what they reach beyond: samples against discs
    cover_candidates: int = 80  # discs tried along each half of an edge
    cells_per_disc: float = 3.0  # spacings of their field in the radius of the least disc at least: else it is no bound
    grain: float = 0.6  # spacing at most, as a share of the excess: half of it is lost between two walls
    stride: float = 1.6  # in clearances, of a march that tries poses ahead: with more it steps back more often
    exact_reach: float = 0.5  # clearances are those of all discs up to so many times the footprint's reach
    edge_halvings: int = 30  # of an edge, in which the place nearest to a solid lies: to a nanometre
    # Start and goal
    turning_reach: float = 4.0  # added to a waiver's radius, for robots that cannot turn on the spot [body radii]
    exit_share: float = 0.75  # of a waiver's radius, within which a path must have left the margin
    max_reach: float = 64.0  # radius of the largest waiver that is searched for a path out [body radii]
    goal_lattice: int = 32  # points in a goal's radius
    similar: float = 0.5  # share of the greatest clearance or radius from which on a place in a goal disc is as good
    # Widest path, where there is none
    path_points: float = 60_000.0  # of a grid, in some tenths of a second
    path_halvings: int = 16  # of the interval in which its clearance lies
    # Walls from plain numbers
    wall_height: float = 0.5  # [m]; more for a robot whose centre is higher
    farthest: float = 1e6  # any number of a scene [m, rad, s]: beyond, a double is no longer fine to a micrometre
    askew: float = 1e-6  # by which the columns of a rotation may be off orthogonal unit vectors
    grid_cells: int = 25_000_000  # of an occupancy grid: its cover takes some 25 bytes for each
    smallest: float = 1e-6  # side, radius, or root of the area of a solid that counts as one [m]


TUNING = GeometryTuning()
