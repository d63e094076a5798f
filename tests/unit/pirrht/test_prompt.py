"""What objects look like at the prompt and in `help`: a line each, pictures, examples that run, shapes and units."""

import doctest
import inspect
import io
import re
import sys
from dataclasses import fields, replace

import matplotlib
import numpy as np
import pytest
from scipy.spatial import KDTree
from trees import grown

import pirrht
from pirrht import Footprint, FreeSpace, Kind, Obstacle, OptionError, Plan, Problem, Rover, Scene, TurnAndGo
from pirrht.plotting.strokes import outline, side_by_side
from pirrht.traits import Traits
from sim.scenario import Scenario, prepare

matplotlib.use("Agg")
WIDE = 200  # characters of a line
STROKE = 0.04  # width of the path of a class on a map of the house [m]


@pytest.fixture(scope="module")
def plan(slit: Scenario, slit_tree):
    return slit.driver(slit_tree).plan(slit.start)


def test_everything_that_is_printed_is_one_short_line_with_its_name(slit, slit_tree, plan):
    controller = slit.driver(slit_tree)
    frames = list(slit.with_settings(max_time=0.02).drive(slit.plant(), controller))
    objects = [
        plan, plan.estimate, plan.estimate.rollouts, plan.references[0], plan.references[0].trajectory, slit_tree,
        controller, slit.with_settings(method="mppi").driver(None), slit.problem, slit.loaded.scene, slit.space,
        slit.loaded.scene.goal, slit.space.homology, slit.sampling, slit.loaded.scene.obstacles[0], slit, slit.loaded,
        slit.settings, frames[0], frames[0].advance,
    ]  # fmt: skip
    for shown in objects:
        text = repr(shown)
        assert text.startswith(f"{type(shown).__name__}(")
        assert text.endswith(")")
        assert "\n" not in text
        assert len(text) <= WIDE + (len(str(slit.loaded.path)) if shown is slit.loaded else 0), text
        assert "array(" not in text
    assert f"v {plan.estimate.value:.4g} +- " in repr(plan)
    assert f"3 classes, most weight {plan.favourite} (" in repr(plan)


def test_a_plans_picture_has_a_line_per_class_and_only_paths_that_are_samples(plan):
    axes = plan.plot(samples=10)
    assert [text.get_text().partition(":")[0] for text in axes.get_legend().get_texts()] == list(plan.ids)
    paths = [path.vertices for group in axes.collections for path in group.get_paths()]
    assert 10 <= len(paths) <= 20
    assert all(np.allclose(path[0], plan.state) for path in paths)
    assert not plan.plot(samples=0, axes=matplotlib.figure.Figure().subplots()).collections


def test_a_plans_picture_shows_the_motion_that_a_control_causes_and_outlines_of_a_robot_with_corners():
    room = {"lower": (0, 0), "upper": (5, 5), "start": (1, 1, 0.5 * np.pi), "goal": (4, 4, 0.3)}
    scene = Scene.from_boxes([(2, 2, 3, 3)], footprint=Footprint.rectangle(1.0, 0.4, 0.2), **room)
    problem = Problem(dynamics=Rover(b=0.1), scene=scene, R=np.diag([2.0, 0.5]))
    space = FreeSpace.of(scene)
    tree = grown(space, TurnAndGo.of(problem), 60)
    found, x = tree.references(scene.start), np.array([1.2, 1.0, 0.5 * np.pi])
    plan = Plan(
        state=x, times=np.array([0.0, 1.0]), references=tuple(found), ids=tuple(one.id for one in found), estimate=None,
        fallback=None, instead=np.array([[1.0, 0.0]]), space=space, dynamics=problem.dynamics,
    )  # fmt: skip
    axes = plan.plot()
    (arrow,) = [text for text in axes.texts if getattr(text, "arrow_patch", None)]
    assert arrow.xy == pytest.approx((1.2, 1.5))  # half a second ahead, and the heading is up
    rings = [path.vertices for group in axes.collections for path in group.get_paths()]
    assert len(rings) == 1 + 7 * len(found)
    assert any(np.allclose(ring[:-1], scene.body.at(x)) for ring in rings)
    assert len(tree.plot(scene.start).collections) == 1 + len(found)


def test_a_trees_picture_has_an_edge_per_vertex_but_the_root(slit, slit_tree):
    axes = slit_tree.plot(slit.start)
    (edges,) = axes.collections
    reached = sum(1 for v in range(slit_tree.size) if slit_tree.graph.nodes[v] and not slit_tree.in_goal[v])
    assert reached <= len(edges.get_paths()) < slit_tree.size
    assert len(axes.get_legend().get_texts()) == 3
    assert slit_tree.plot(axes=matplotlib.figure.Figure().subplots()).get_legend() is None


def test_pictures_number_obstacles_and_give_every_class_a_colour_and_a_line_that_shows():
    house = prepare("house", vertices=300)
    tree = house.grown_tree()
    pictures = tree.plot(house.start), house.controller(tree).plan(house.start).plot(samples=0)
    for axes in pictures:
        lines = [line for line in axes.lines if line.get_label().partition(":")[2]]
        assert len(lines) > 6
        assert len({line.get_color() for line in lines}) == len(lines)
        assert [text.get_text() for text in axes.texts if text.get_text()] == [
            str(k) for k in range(1, house.homology.M + 1)
        ]
        paths = [line.get_xydata() for line in lines]
        for i, path in enumerate(paths):
            middles = path[len(path) // 10 : -len(path) // 10]
            hidden = [KDTree(other).query(middles)[0] < 0.4 * STROKE for other in paths[:i]]
            assert np.mean(np.any(hidden, axis=0) if hidden else False) < 0.2


def test_strokes_that_coincide_lie_side_by_side_and_others_stay():
    line = np.array([[0.0, 0.0], [4.0, 0.0]])
    first, second, alone = side_by_side([line, line, np.array([[0.0, 1.0], [4.0, 1.0]])], 0.1)
    np.testing.assert_allclose(second[:, 1] - first[:, 1], 0.1)
    np.testing.assert_allclose(first[:, 1] + second[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(alone[:, 1], 1.0)


def test_a_scene_whose_name_would_be_a_formula_is_drawn_under_its_name(plan):
    named = replace(plan, space=replace(plan.space, scene=replace(plan.space.scene, name="$x^$")))
    axes = named.plot(axes=matplotlib.figure.Figure().subplots())
    axes.figure.savefig(io.BytesIO())
    assert axes.get_title() == r"\$x^\$ at 0.00 s"


@pytest.mark.parametrize("draw", ["plan", "tree"])
def test_without_matplotlib_the_extra_is_named(monkeypatch, draw, plan, slit_tree):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(OptionError, match=rf"{draw}.plot needs matplotlib; .*pirrht\[figures\]"):
        {"plan": plan, "tree": slit_tree}[draw].plot()


@pytest.mark.parametrize("kind", [kind for kind in Kind if kind is not Kind.MESH])
def test_outlines_reach_as_far_as_solids_do_in_every_direction_seen_from_above(kind):
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    size, place = np.array([0.5, 0.3, 0.2]), np.array([1.0, 2.0, 0.3])
    solid = Obstacle(name="solid", kind=kind, size=size, position=place, rotation=turn)
    corners = outline(solid)
    ahead, behind = np.roll(corners, -1, axis=0) - corners, corners - np.roll(corners, 1, axis=0)
    assert np.all(behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0] > 0)  # it turns left at every corner
    for angle in np.linspace(0.0, 2 * np.pi, 50):
        to = np.array([np.cos(angle), np.sin(angle)])
        x, y, z = turn[:2].T @ to
        reach = {
            Kind.BOX: np.abs([x, y, z]) @ size,
            Kind.CYLINDER: size[0] * np.hypot(x, y) + size[1] * abs(z),
            Kind.SPHERE: size[0],
            Kind.CAPSULE: size[0] + size[1] * abs(z),
            Kind.ELLIPSOID: np.linalg.norm([x, y, z] * size),
        }
        assert np.max((corners - place[:2]) @ to) == pytest.approx(reach[kind], rel=3e-3)


EXAMPLES = [pirrht, pirrht.Problem, pirrht.Goal, pirrht.Scene, pirrht.Sampling, pirrht.HomologyTree, pirrht.Controller]
TOLD = [pirrht.Problem, pirrht.Scene, pirrht.Goal, pirrht.Obstacle, pirrht.Sampling, pirrht.Estimate, pirrht.Plan]
UNIT = re.compile(r"\[[^]]+\]")


@pytest.mark.parametrize("entry", [*EXAMPLES, Scenario, Traits], ids=lambda entry: entry.__name__)
def test_the_example_in_a_docstring_gives_what_it_says(entry):
    example = doctest.DocTestParser().get_doctest(inspect.getdoc(entry), {}, entry.__name__, None, None)
    assert example.examples
    results = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example)
    assert results.failed == 0 < results.attempted


def attributes(entry: type) -> dict[str, str]:
    """What a docstring's section on attributes says of each."""
    section = re.search(r"\nAttributes:\n(.*?)(\n\n|\Z)", inspect.getdoc(entry) + "\n\n", re.S)
    return dict(re.findall(r"^    (\w+): (.*?)(?=^    \w+: |\Z)", section[1] + "\n", re.S | re.M))


@pytest.mark.parametrize("entry", TOLD, ids=lambda entry: entry.__name__)
def test_help_tells_every_field_and_no_other_and_the_shape_and_unit_of_every_array(entry):
    told = attributes(entry)
    assert list(told) == [field.name for field in fields(entry)]
    plain = {"rotation", "weight", "proposal_weights", "faces", "state"}  # axes, shares and indices have no unit
    for field in fields(entry):
        if re.search(r"\bArray\b|NDArray", str(field.type)):
            assert re.search(r"\((\w|\+)+,( \w+)*\)|\(\w+, \w+\)", told[field.name]), field.name
            assert UNIT.search(told[field.name]) or field.name in plain, field.name
        assert field.name not in ("q", "phi", "temperature") or re.search(r"\[cost(/s)?\]", told[field.name])


@pytest.mark.slow
def test_pictures_in_space_have_a_view_from_above_and_one_from_the_south():
    scenario = prepare("window", robot="ball", vertices=100, samples=30)
    tree = scenario.grown_tree()
    plan = scenario.driver(tree).plan(scenario.start)
    for axes in (tree.plot(scenario.start), plan.plot(samples=5)):
        assert [(one.get_xlabel(), one.get_ylabel()) for one in axes.figure.axes] == [
            ("x [m]", y) for y in ("y [m]", "z [m]")
        ]
        high = [max(line.get_ydata().max() for line in one.lines[: len(plan.ids)]) for one in axes.figure.axes]
        assert high[1] > 2.2  # one class goes over the wall
        assert axes is axes.figure.axes[0]
        assert len(axes.get_legend().get_texts()) == len(plan.ids)
    own = matplotlib.figure.Figure().subplots()
    assert tree.plot(scenario.start, axes=own) is own
