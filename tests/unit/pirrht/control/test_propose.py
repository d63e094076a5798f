"""A proposal of the user's joins the mixture of every class, leaves v unbiased and stays after a new map."""

import numpy as np
import pytest
from trees import point

from pirrht import Controller, OptionError, Scene
from pirrht.proposals.proposal import ProposalControl, Wrapped
from pirrht.rollouts.tables import LawRows, ProposalTables
from sim.scenario import prepare


class Wider(Wrapped):
    """Feedback around a guide under wider noise."""

    def __init__(self, lead: ProposalControl, scale: float) -> None:
        super().__init__(lead)
        self.scale = scale

    def pack(self, leads: ProposalTables, h: int) -> None:
        """Write the law of the feedback with a covariance of scale^2 times its own."""
        super().pack(leads, h)
        modes, n = self.guide.modes.shape[1], len(self.guide.metric)
        law = LawRows.of(leads, h, n, modes)
        law.deviation[:] *= self.scale
        law.inverse[:] /= self.scale
        law.log_det[:] += modes * np.log(self.scale)


def wider(x: np.ndarray, default: ProposalControl) -> ProposalControl | None:
    return None if default.guide is None else Wider(default, 1.05)


def test_wider_noise_joins_each_class_and_leaves_the_value_as_it_is():
    """One state of a unicycle in `slit`, 1 000 samples per class, seed 1, 4 standard errors."""
    scenario = prepare("slit", robot="unicycle", given={"samples": 1000, "vertices": 300})
    found = []
    for propose in ((), (wider,)):
        task = scenario.problem, scenario.space, scenario.grown_tree(), scenario.sampling
        controller = Controller(*task, propose=propose, rng=np.random.default_rng(1))
        found.append((controller.plan(scenario.start).estimate, controller))
    (default, _), (mixed, controller) = found
    assert abs(mixed.value - default.value) < 4.0 * np.hypot(mixed.value_error, default.value_error)
    assert len(mixed.proposal_weights) > len(default.proposal_weights)
    assert all(
        one.sum() == pytest.approx(1.0) and one.min() > 0.0 for one in controller.run.shares.allocation.shares.values()
    )


WALLS = [[2.2, 0.6, 2.6, 2.2], [2.2, 2.8, 2.6, 4.4]]
TASK = {"lower": (0, 0), "upper": (6, 5), "start": (0.5, 2.5), "goal": (5.5, 2.5, 0.25), "robot_radius": 0.15}
START = np.array(TASK["start"])


def driver(**options) -> Controller:
    """Of a point between two walls."""
    return point(Scene.from_boxes(WALLS, **TASK), 0.1, 200, options=options, samples=60)


class Recorder:
    """A backend that counts what another one samples."""

    def __init__(self, backend):
        self.backend, self.calls = backend, 0

    def sample(self, *arguments):
        self.calls += 1
        return self.backend.sample(*arguments)

    def __getattr__(self, name):
        return getattr(self.backend, name)


def test_proposals_and_backend_stay_after_a_new_map():
    plain, asked = driver(), []
    backend = Recorder(plain.path_integral.backend)
    controller = driver(propose=[lambda x, default: asked.append(default)], backend=backend)
    assert np.array_equal(controller.plan(START).control, plain.plan(START).control)
    before = len(asked), backend.calls
    controller.update(Scene.from_boxes([*WALLS, [3.4, 2.2, 3.8, 2.8]], **TASK))
    controller.plan(START)
    assert len(asked) > before[0] > 0
    assert backend.calls > before[1] > 0


def test_a_law_of_a_point_among_static_obstacles_is_refused_with_what_works():
    tables = driver().plan(START).estimate.rollouts.tables
    with pytest.raises(OptionError, match="write a control sequence or a tube"):
        LawRows.of(tables, 0, 2, 2)
