"""Say once what is special about a system and its costs, so that something faster or more exact suits it."""

from typing import NamedTuple

from pirrht.problem import Problem
from pirrht.systems.dynamics import no_drift


class Traits(NamedTuple):
    """Tell what is special about a system: a point, noise on the position, or numbers that do not depend on the state.

    Examples:
        >>> import numpy as np
        >>> from pirrht import Goal, Problem, Scene, SingleIntegrator, Unicycle
        >>> from pirrht.traits import Traits
        >>> goal = Goal(center=np.array([3.4, 1.5]), radius=0.3)
        >>> scene = Scene(
        ...     name="room", lower=np.zeros(2), upper=np.array([4.0, 3.0]), obstacles=(), goal=goal,
        ...     start=np.array([0.6, 1.5, 0.0]), robot_radius=0.2,
        ... )
        >>> point = Traits.of(Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=np.eye(2)))
        >>> point.isotropic_point, point.climbs(moving=False), point.climbs(moving=True)
        (True, True, False)
        >>> car = Traits.of(Problem(dynamics=Unicycle(b=0.1), scene=scene, R=np.eye(1)))
        >>> car.point, car.noisy_position, car.can_brake
        (False, False, False)
    """

    point: bool  # its states are the position, and all are actuated
    isotropic_point: bool  # a point that does not drift, with equal noise in all directions
    noisy_position: bool  # noise acts on the position itself: exits need a Brownian bridge, else a sweep
    input_form: bool  # noise enters through its inputs (`Dynamics.input_matrix`)
    drifts: bool  # it declares a drift
    drifting_away: bool  # the drift moves states in directions that no control does
    constant_blocks: bool  # neither G nor B depends on the state
    constant_rate: bool  # q does not
    can_brake: bool  # it comes to rest: `Dynamics.brake`

    @classmethod
    def of(cls, problem: Problem) -> "Traits":
        """Collect the traits of a problem's system and cost rate."""
        d = problem.dynamics
        x = d.state_of(problem.scene.start)
        drifts = d.drift is not no_drift
        return cls(
            point=d.n == d.m == len(d.position), isotropic_point=d.isotropic_point, noisy_position=d.noisy_position,
            input_form=d.input_form, drifts=drifts, drifting_away=drifts if d.input_form else d.n > d.m,
            constant_blocks=d.constant, constant_rate=not callable(problem.q),
            can_brake=d.brake(x, d.place(x), 1.0) is not None,
        )  # fmt: skip

    @property
    def constant_gain(self) -> bool:
        """Tell whether what turns a control into noise units is the same at all states."""
        return self.constant_blocks or self.input_form

    @property
    def free_point(self) -> bool:
        """Tell whether controls are the velocity of a point, in the paper's partition."""
        return self.point and not self.input_form

    def climbs(self, moving: bool) -> bool:
        """Tell whether samples climb log psi of a corridor, with obstacles that are `moving` or not; else laws lead."""
        return self.isotropic_point and not moving

    def in_blocks(self, moving: bool) -> bool:
        """Tell whether kernels of a point simulate paths block by block (`rollouts.point_block`)."""
        return self.climbs(moving) and self.constant_blocks and self.constant_rate

    def is_martingale(self, moving: bool) -> bool:
        """Tell whether a point's optimal control among moving obstacles is a martingale: no drift; constant G, B, q."""
        return moving and self.free_point and not self.drifts and self.constant_blocks and self.constant_rate
