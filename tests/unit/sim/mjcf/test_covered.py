"""A body that comes to rest on the goal is named where no way gets there before."""

from __future__ import annotations

import pytest
from moving_scenes import body, moving_scene, rows

from pirrht.errors import SceneError
from sim.mjcf import load
from sim.mjcf.motions import goal_blocker
from sim.scenario import prepare

WALKER = body("walker", 'type="cylinder" size="0.7 0.1"', "44 5 0.1")


@pytest.mark.parametrize(
    ("data", "told"),
    [
        ("0 44 5 0  10 44 0 0", "body 'walker' covers the goal (45, 0) from "),
        ("0 44 5 0  10 44 0 0  20 44 5 0", None),
        ("0 44 5 0  10 44 3 0", None),
    ],
)
def test_a_body_that_rests_on_the_goal_is_told_with_the_time_from_when_on(tmp_path, data, told):
    scene = load(moving_scene(tmp_path, WALKER.replace("0.7", "1.2"), rows("walker", data))).scene
    found = goal_blocker(scene)
    if told is None:
        assert found is None
    else:
        assert found.startswith(told)
        assert 6.0 < float(found.split()[-3]) < 10.0


def test_a_body_that_starts_over_never_covers_the_goal_for_good(tmp_path):
    path = moving_scene(tmp_path, WALKER, rows("walker", "0 44 5 0  5 45 0 0  10 44 5 0", repeat=True))
    assert goal_blocker(load(path).scene) is None


def test_where_no_way_arrives_before_the_body_the_error_names_it(tmp_path):
    path = moving_scene(tmp_path, WALKER, rows("walker", "0 44 5 0  1 45 0 0"))
    scenario = prepare(path, given={"vertices": 30})
    with pytest.raises(SceneError, match=r"body 'walker' covers the goal \(45, 0\) from .* let it rest elsewhere"):
        scenario.references(scenario.grown_tree())
