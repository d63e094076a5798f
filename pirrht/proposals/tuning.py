"""Tuned numbers of proposals: optimisation of guides, wall drift and desirability tubes."""

from typing import NamedTuple

Stage = tuple[float, int]  # times lambda that a wall costs, and backward passes at most


class ProposalTuning(NamedTuple):
    """Numbers that trade effective samples for time; found by trials in `slit`, `clutter` and random scenes."""

    # Stages of an optimisation: more passes cost time; fewer leave guides short of their optimum in narrow passages.
    cold: tuple[Stage, ...] = ((100.0, 30), (10.0, 30), (1.0, 60))  # from a reference
    warm: tuple[Stage, ...] = ((1.0, 8),)  # from the last guide, which is near its optimum
    part: int = 8  # passes, by a clock, after which a guide that is free and in its class is left to the next plan
    part_short: int = 2  # passes of a stage once time is short
    widest_layer: float = 2.0  # radii of walls; stages with a wider boundary layer are left out, but for the last
    perturbed: tuple[Stage, ...] = ((1.0, 60),)  # from another start of the same class
    paces: tuple[float, ...] = (
        1.15,
        1.03,
        1.0 / 1.03,
    )  # at which a guide is tried again: others touch corners elsewhere
    later_paces: tuple[tuple[float, ...], ...] = ((1.03,), (), (), (1.0 / 1.03,), (), ())  # of warm guides, by turns
    again: int = 10  # plans after which a class without a guide is tried again
    paced: int = 12  # backward passes at most at each of them
    tolerance: float = 0.01  # a pass that is expected to gain less is the last [lambda]; less is below the noise of v
    # Differential dynamic programming.
    least_curvature: float = 0.2  # Q_aa stays above this share of lambda dt; less makes gains grow without bound
    halvings: int = 6  # of the step of a line search; later ones hardly ever succeed
    descent: float = 0.1  # Armijo's share of the expected gain that a step must bring
    damping: tuple[float, float, float, float] = (0.1, 8.0, 0.01, 1e4)  # first, factor, nothing below, the most
    nudge: float = 1e-4  # of a state, for differences [m], [rad], [m/s]: between rounding and curvature
    wildest: float = 1e4  # largest gain, without units of a; beyond it the cost-to-go has no minimum
    jacobi_sweeps: int = 12  # of the eigenvalues of Q_aa at most; they converge quadratically
    points: int = 8  # of a step whose clearance is priced, at most; more cost time
    points_margin: float = 1.2  # by which a later step may be longer than the first course's longest
    # Clearance cost: less makes the guide's paths die at walls, more keeps them where few samples weigh much.
    barrier: float = 3.0  # times lambda / (time in which noise carries a position over its clearance); for even weights
    barrier_noisy: float = 1.5  # that factor where noise acts on the position itself; for even weights
    barrier_point: float = 0.5  # times lambda b^2 / c^2 for a point among moving obstacles: psi vanishes like c
    margin: float = 20.0  # boundary layers beyond which a wall costs nothing
    margin_point: float = 5.0  # boundary layers, for a point among moving obstacles
    parabola: float = 0.2  # boundary layers below which the cost is a parabola, so that it stays finite
    sag: float = 0.12  # boundary layers by which a wall may bulge towards a path between two points that are priced;
    # with more, a path that touches a corner between them stops short of its optimum
    sag_point: float = 0.25  # the same, for a point among moving obstacles
    wall_radii: float = 2.0  # robot radii, the assumed radius of curvature of walls
    wall_radius: float = 0.2  # of that radius at least [m]
    # Laws.
    steepest: float = 10.0  # bound of |a| in sqrt(2 q / lambda), at which control costs as much as time
    # Laws fitted to samples.
    fit_memory: float = 0.9  # share that one plan leaves to the next of what was learned; more lags behind
    fit_prior: float = 1.0  # weight of the guide's law: that of changes of 1/sqrt(s)
    fit_rows: int = 2  # rows to either side that share what was learned
    fit_powers: tuple[float, ...] = (1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.1)  # of weights, best of them
    fit_most: int = 128  # samples of a plan that are simulated again for it, the heaviest; for time
    fit_enough: float = 100.0  # effective samples of a plan from which on nothing more is learned; for time
    fit_weight: float = 0.01  # weight of a class from which on its law is fitted
    # Samples and alternatives.
    few: int = 30  # samples around references of negligible weight
    hopeless: float = 60.0  # lambda by which their guides cost more than the cheapest,
    hopeless_share: float = 0.01  # and this share of the least cost: prices are off the value by about as much
    time_scales: tuple[float, ...] = (1.25, 1.5, 0.8)  # speeds of other starts among moving obstacles
    alternative: float = 3.0  # lambda by which an alternative optimum of a class may cost more and still be sampled
    apart: float = 3.0  # nats from which on samples around a guide hardly reach another one
    # Initial courses.
    hold: float = 10.0  # cost rate, in q, of being off a tracked path by the radius of walls
    window: int = 30  # last steps that are improved when more of a path is tracked among moving obstacles; for time
    ahead: int = 10  # steps by which more of a path is tracked: more lose it, fewer cost time
    ahead_passes: int = 20  # backward passes at most for each of them
    onward: int = 2  # steps that a system without homing goes on, so that it does not halt on the goal's rim
    perturbed_time: float = 1.0  # for which the controls of a start are perturbed [s]
    perturbed_strengths: tuple[float, ...] = (0.5, 1.0)  # in the control that costs as much as time
    perturbed_inputs: int = 2  # inputs up to which all signs are tried; the number of starts grows as 3^m
    ramp: float = 0.5  # share of a tracked path's slack in which it is accelerated to
    # Noise of a system, measured at some states.
    spreading: float = 0.5  # time in which noise spreads a position to measure its strength [s]
    spreading_steps: int = 5  # of that time
    probes: int = 8  # states
    straight: float = 1e-5  # second derivatives below this are rounding of differences
    # Cross-sections of a reference: denser ones cost time, sparser ones lose what walls between them do.
    section_stride: float = 0.15  # between sections with walls at their ends [m]
    section_widening: float = 0.5  # share of the clearance beyond their ends that is added in the open
    section_widest: float = 0.6  # between any two [m]
    section_apart: float = 0.06  # between any two at least, so that noise spreads a path over some nodes [m]
    section_channel: float = 1.0 / 6.0  # of k w^2 at most in a channel of width w: noise crosses it in about k w^2
    section_least: float = 0.02  # between any two in a channel [m]
    section_deviations: float = 3.0  # extent to either side in a path's noise
    section_extra: float = 0.05  # of that extent [m]
    section_shortest: float = 0.05  # least length over which noise has spread [m]
    touching: float = 1e-4  # clearance at which a wall ends a section [m]
    stride: float = 2e-3  # of the search for that wall at least [m]
    # Desirability tubes.
    nodes: int = 24  # of a cross-section; more cost time
    closest: float = 1e-3  # distance of a wall below which psi vanishes like the distance [m]
    either_side: float = 0.5  # cosine up to which a wall ahead or behind counts for either side
    drift_most: float = 0.999  # greatest drift in units of 1/c
    drift_least: float = 1e-3  # drift that counts
    newton: int = 4  # rounds of Newton's method for the reach of a wall
    # Desirability on a grid in space.
    grid_lengths: float = 0.5  # spacing at most, in decay lengths 1/k
    grid_spacings: float = 1.5  # and in spacings of the clearance
    grid_points: float = 3e5  # at most; more cost time
    grid_costlier: float = 9.0  # of k^2 where another class's reference is nearer, so that hardly anything goes there,
    grid_nearer: float = 0.9  # at no more than this share of the distance to the own one
    grid_step: float = 0.1  # between places on references where obstacles may separate them [m]
    grid_coarsest: int = 4000  # points of the first of several grids
    grid_lower: float = 100.0  # by which log psi may start below what the length of the way tells [nats]
    grid_greatest: float = 200.0  # log of psi at a neighbour as a share of psi here, at most
    grid_clear: float = 0.3  # spacings of clearance below which a point's slope is that of its neighbours
    grid_sweeps: int = 200  # at most
    grid_settled: float = 0.05  # greatest change of log psi after which a sweep is the last [nats]
    # Wall drift.
    wall_offset: float = 2.0  # of a wall without a tube, in decay lengths 1/k
    drift_near: float = 10.0  # reaches beyond which moving obstacles add no drift
    drift_gap: float = 0.1  # least distance of a wall that causes drift of a guide, in reaches
    least_gap: float = 1e-4  # least distance of a wall [m]
    constant_below: float = 0.2  # distance of a wall, in a step's noise, below which drift stays constant
    constant_below_moving: float = 0.05  # that distance among moving obstacles, since closing gaps are narrow
    # Averaging of the control now.
    averaged: float = 0.04  # least time over which it is averaged near walls and goal [s]
    averaged_moving: float = 0.01  # among moving obstacles: a closing gap is passed, or not, in less time [s]
    averaged_share: float = 0.5  # share of the time in which noise carries a path to the nearest of them
    arriving: float = 2.5  # deviations of noise since now within which paths arrive
    # Bias of a mean control near walls.
    moments: int = 8  # of Gauss's quadrature over the time of the mean
    bisections: int = 24  # of the speed away from a wall
    unbiased: float = 1e-9  # of 1/c, below which the bias is zero
    along: float = 1e-4  # of g c, below which a point goes along a wall
    out_of_reach: float = 300.0  # of g c, above which a wall is out of reach
    wall_step: float = 1e-3  # over which the speed of a wall is measured [s]
    same_wall: float = 0.99  # cosine of the directions of one wall then and now
    unsure: float = 0.3  # error of the bias as a share of it, since walls are neither flat nor alone


TUNING = ProposalTuning()
