"""Classes in words, in colours, and as the way that samples went on average."""

from dataclasses import replace
from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest
from discs import block
from drives import Drive
from moving import moved

from pirrht.geometry.scene import Footprint
from pirrht.plotting.colors import PALETTE, ClassColors, nth_color, place_of
from pirrht.topology.homology import Homology
from sim.drawing import strokes
from sim.drawing.colors import labels, method_color, numbered, passing, sides, worded
from sim.result import plan_json
from sim.scenario import prepare

WALLS = ("upper wall", "lower wall")
SLIT = {"0,0": (0, 0), "0,1": (0, 1), "-1,0": (-1, 0)}
START = np.array([0.458, -0.458])  # H of the straight line between the walls, by which one passes both


def test_ways_are_named_by_the_sides_on_which_they_pass():
    assert worded(SLIT, START, WALLS) == {
        "0,0": "between upper wall and lower wall",
        "0,1": "right of lower wall",
        "-1,0": "left of upper wall",
    }


def random_classes(rng: np.random.Generator, static: int, moving: int):
    """Paths of different classes among random obstacles, some of which stand or share a name, and their homology."""
    markers, goal = rng.uniform(0.0, 6.0, (static, 2)), rng.uniform(5.0, 6.0, 2)
    movers = []
    for j in range(moving):
        times = np.cumsum(rng.uniform(0.2, 2.0, 4)) * np.arange(4)
        rows = np.column_stack([times - times[0], rng.uniform(0.0, 6.0, (4, 2)), np.zeros(4)])
        rows[:, 1:3] = rows[:1, 1:3] if rng.random() < 0.2 else rows[:, 1:3]
        movers.append(moved(("walker", "cart", "walker", "van", "door")[j], rows, block("b", 0.0, 0.0, (0.1, 0.1))))
    homology = Homology(markers=markers, goal=goal).with_moving(movers, Footprint.disc(0.1))
    found, start = {}, rng.uniform(0.0, 1.0, 2)
    for _ in range(40):
        places = np.vstack([start, rng.uniform(-1.0, 7.0, (rng.integers(0, 6), 2)), goal])
        knots = np.column_stack([places, np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 2.0, len(places) - 1))])])
        winding = homology.winding(knots)
        path = SimpleNamespace(path=SimpleNamespace(knots=knots))
        found[winding] = SimpleNamespace(
            winding=winding, signature=homology.signature(knots[0], winding), trajectory=path, id=str(winding)
        )
    return [*found.values()], homology


@pytest.mark.parametrize("moving", range(6))
@pytest.mark.parametrize("static", [0, 1, 2, 5])
def test_no_two_classes_are_called_the_same(static, moving):
    rng, classes = np.random.default_rng(10 * static + moving), 0
    for _ in range(5):
        found, homology = random_classes(rng, static, moving)
        windings = {one.id: one.winding for one in found}
        passed = dict(zip(windings, sides(found, homology), strict=True)) if moving else None
        straight = np.array(found[0].signature[:static]) - found[0].winding[:static] - 1.0
        names = ["post", "table", "post", "lamp", "shelf"][:static]
        for among in (None, {*list(windings)[:2]}, set()):
            assert len({*worded(windings, straight, names, homology.names, among, passed).values()}) == len(windings)
        if moving:
            assert len({tuple(lines) for lines in passing(found, homology, names)}) == len(windings)
        classes += len(windings)
    assert classes > 10 or static + moving == 0


@pytest.mark.parametrize("moving", range(1, 5))
@pytest.mark.parametrize("static", range(5))
def test_a_word_follows_from_the_turns_about_its_obstacle_and_those_are_named_by_which_classes_differ(static, moving):
    rng = np.random.default_rng(100 + 10 * static + moving)
    for _ in range(10):
        found, homology = random_classes(rng, static, moving)
        names = ["post", "table", "lamp", "shelf"][:static]
        called = numbered([*names, *homology.names])
        words, turns = dict[tuple[str, int], str](), [set[int]() for _ in called]
        for one, lines in zip(found, passing(found, homology, names), strict=True):
            said = dict(line.split(": ") for line in lines)
            for name, turn, known in zip(called, one.winding, turns, strict=True):
                known.add(turn)
                if name in said:
                    assert words.setdefault((name, turn), said[name]) == said[name]
        named = {name for name, _ in words}
        assert len(found) == 1 or named == {name for name, known in zip(called, turns, strict=True) if len(known) > 1}
        assert len({(name, word) for (name, _), word in words.items()}) == len(words)


def test_one_class_alone_is_described_by_the_moving_obstacles():
    found, homology = random_classes(np.random.default_rng(3), 2, 2)
    [lines] = passing(found[:1], homology, ("post", "table"))
    assert [line.split(": ")[0] for line in lines] == ["walker", "cart"]


def test_without_obstacles_or_classes_there_is_nothing_to_say():
    found, homology = random_classes(np.random.default_rng(3), 0, 0)
    assert (passing(found, homology, ()), passing([], homology, ())) == ([[]], [])


def test_equal_names_and_names_that_look_numbered_stay_apart():
    assert numbered(["post", "table", "post"]) == ["post (1)", "table", "post (3)"]
    assert len({*numbered(["post (2)", "post", "post"])}) == 3
    assert numbered([*"abcdefgh", "obstacle 9"])[-2:] == ["h (8)", "obstacle 9"]


def test_few_obstacles_bear_their_names_on_a_map_and_many_their_numbers():
    assert labels(["pillar", "obstacle 2"]) == ["1 pillar", "2"]
    assert labels(["pillar"] * 9)[-1] == "9"


def coming(angle: float, aside: float, speed: float = 1.0) -> str:
    """How a robot that goes along x at 1 m/s passes a walker in its way that goes in a direction [rad]."""
    way = np.array([[0.0, 0.0, 0.0], [4.0, 2.0 * aside, 4.0], [8.0, 0.0, 8.0]])
    heading = speed * np.array([np.cos(angle), np.sin(angle)])
    rows = [(t, *((4.0, 0.0) + heading * (t - 4.0)), 0.0) for t in (0.0, 8.0)]
    walker = moved("walker", rows, block("b", 0.0, 0.0, (0.1, 0.1)))
    homology = Homology(markers=np.zeros((0, 2)), goal=np.array([8.0, 0.0])).with_moving([walker], Footprint.disc(0.1))
    winding = homology.winding(way)
    one = SimpleNamespace(winding=winding, signature=homology.signature(way[0], winding), id="")
    one.trajectory = SimpleNamespace(path=SimpleNamespace(knots=way))
    return sides([one], homology)[0][0]


@pytest.mark.parametrize(
    ("angle", "aside", "speed", "said"),
    [
        (np.pi, 0.2, 1.0, "left of"),
        (np.pi, -0.2, 1.0, "right of"),
        (np.pi - 0.4, 0.2, 1.0, "left of"),
        (np.pi + 0.4, -0.2, 1.0, "right of"),
        (0.0, 0.2, 0.5, "left of"),
        (0.0, -0.2, 2.0, "right of"),
        (0.0, 0.2, 2.0, "left of"),
        (0.5 * np.pi, 0.2, 1.0, "before"),
        (0.5 * np.pi, -0.2, 1.0, "behind"),
        (-0.5 * np.pi, 0.2, 1.0, "behind"),
        (-0.5 * np.pi, -0.2, 1.0, "before"),
        (0.0, 0.2, 0.0, "left of"),
    ],
)
def test_who_comes_towards_the_robot_is_passed_left_or_right_and_who_crosses_its_way_before_or_behind(
    angle, aside, speed, said
):
    assert coming(angle, aside, speed) == said


def test_a_class_is_told_apart_from_those_that_matter():
    windings = {"0,0,0": (0, 0, 0), "0,1,0": (0, 1, 0), "0,0,1": (0, 0, 1)}
    straight, names = np.array([0.4, -0.4, -0.3]), ["table", "shelf", "lamp"]
    assert worded(windings, straight, names)["0,0,0"] == "left of shelf and lamp"
    assert worded(windings, straight, names, among={"0,0,0", "0,1,0"})["0,0,0"] == "left of shelf"


def test_a_class_has_its_colour_in_every_picture_whatever_came_before():
    names = ("0,0", "0,1", "-1,0", "1,0", "0,-1")
    assert len({place_of(name) for name in names}) == len(names)
    for order in permutations(names):
        colors = ClassColors(order)
        assert [colors[name] for name in names] == [ClassColors()[name] for name in names]


@pytest.fixture(scope="module")
def planned():
    drive = Drive()
    drive.controller.begin(drive.scene.start[:2])
    plan = drive.controller.plan(drive.scene.start[:2])
    key = drive.space.homology.key
    return drive, plan, {key(r.winding): name for r, name in zip(plan.references, plan.ids, strict=True)}


def test_samples_without_weight_are_drawn_and_not_seen(planned):
    """Of a plan whose earlier samples have all the weight: nothing is divided by it."""
    drive, plan, _ = planned
    weightless = replace(plan.estimate, weight=np.zeros_like(plan.estimate.weight))
    found = strokes.fans(drive.controller.path_integral, weightless, plan.classes, points=400, everything=False)
    assert found
    assert all(len(fan.opacity) and not fan.opacity.any() for fan in found.values())


def test_the_average_way_of_a_class_is_free_and_of_that_class(planned):
    drive, plan, names = planned
    ways = strokes.mean_paths(drive.controller.path_integral, plan.estimate, names)
    heavy = {name for name, w in plan.estimate.class_weights.items() if w > 0.01}
    assert heavy
    assert heavy <= ways.keys()
    for name in heavy:
        line = ways[name]
        np.testing.assert_allclose(line[0], plan.state, atol=1e-9)
        assert drive.space.collision.segments_free(line[:-1], line[1:]).all()
        assert names[drive.space.homology.key(drive.space.homology.winding(line))] == name


def test_methods_have_colours_that_no_early_class_has():
    assert len({method_color(k) for k in range(9)} - {nth_color(k) for k in range(3 * len(PALETTE))}) == 9


def among(scene: str, vertices: int, *ids: str):
    """A scene of moving obstacles, its references of these ids, and how each passes them."""
    scenario = prepare(scene, given={"vertices": vertices})
    references = {one.id: one for one in scenario.references(scenario.grown_tree()) if one.id in ids}
    return scenario, references, dict(zip(references, sides([*references.values()], scenario.homology), strict=True))


def test_ways_among_moving_obstacles_are_named_by_whether_they_pass_before_or_behind():
    """The crosser goes up: above it a path passes before it, below it behind it."""
    scenario, references, passed = among("crossing", 200, "0", "1")
    motion = scenario.loaded.scene.movers[0].motion
    for name, one in references.items():
        t, x, y = one.path.knots[:, 2], one.path.knots[:, 0], one.path.knots[:, 1]
        time = float(np.interp(3.25, x, t))
        assert passed[name] == (("before",) if np.interp(time, t, y) > motion.pose(time)[1] else ("behind",))
    words = worded({n: r.winding for n, r in references.items()}, np.zeros(0), (), ("walker",), None, passed)
    assert set(words.values()) == {"before walker", "behind walker"}


def test_bodies_that_have_come_to_rest_are_passed_as_by_paths_that_come_before():
    """The discs of `pincer` have met when the robot comes by below or above them: on the side that one came from."""
    scenario, references, passed = among("pincer", 300, "0,0", "1,0", "0,-1")
    assert passed == {"0,0": ("before", "before"), "1,0": ("behind", "before"), "0,-1": ("before", "behind")}
    assert ["low: behind", "high: before"] in passing([*references.values()], scenario.homology, ())
    words = worded({name: references[name].winding for name in passed}, np.zeros(0), (), ("low", "high"), None, passed)
    assert len(set(words.values())) == 3


PILLAR = """<mujoco model="pillar">
  <custom><numeric name="pirrht_motion_oncomer" data="0 5.4 2.6 0  4.5 0.9 2.6 0"/></custom>
  <worldbody>
    <site name="workspace" type="box" pos="3 2.5 0.5" size="3 2.5 0.5"/>
    <site name="start" pos="0.6 2.5 0"/>
    <site name="goal" type="cylinder" pos="5.5 2.5 0" size="0.3 0.005"/>
    <body name="pillar" pos="3 2.45 0.2"><geom type="cylinder" size="0.4 0.2"/></body>
    <body name="oncomer" mocap="true" pos="5.4 2.6 0.2"><geom type="cylinder" size="0.25 0.2"/></body>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize("robot", ["puck", "diffdrive"])
def test_classes_around_a_pillar_and_an_oncomer_are_called_alike_for_every_robot(robot, tmp_path):
    """Some paths cross behind the oncomer, others only pass it on the same side."""
    (file := tmp_path / "pillar.xml").write_text(PILLAR)
    scenario = prepare(file, given={"robot": robot, "vertices": 300})
    tree = scenario.grown_tree()
    known = plan_json(scenario, tree, scenario.references(tree), 0.0)
    assert [row["name"] for row in known["obstacles"]] == ["pillar"]
    assert {row["id"]: ", ".join(row["bodies"]) for row in known["classes"]} == {
        "0,-1": "pillar: left of it, oncomer: left of it",
        "1,0": "pillar: right of it, oncomer: right of it",
        "0,0": "pillar: left of it, oncomer: right of it",
        "1,-1": "pillar: right of it, oncomer: left of it",
    }


def test_an_obstacle_that_all_classes_pass_alike_is_not_named():
    """They differ by the upper wall only."""
    scenario, references, _ = among("closing_door", 300, "0,0", "-1,0")
    lines = passing([*references.values()], scenario.homology, scenario.names)
    assert sorted(lines) == [["upper wall: left of it"], ["upper wall: right of it"]]
