"""Systems are records in a registry: robots name them, and somebody's own comes by module and name."""

import sys

import numpy as np
import pytest
from mjcf_samples import ROBOT, refusal, robot_mjcf
from numba import njit
from thoroughly import first

from pirrht import OptionError, SingleIntegrator, StraightLine
from pirrht.control.cost_to_go import straight_lines
from pirrht.systems.double_integrator import DoubleIntegrator
from sim import systems
from sim.mjcf import load
from sim.scenario import prepare
from sim.systems import System, blamed, chosen, named, register, source

MODULES = {
    "rafts": """
import numpy as np
from pirrht import SingleIntegrator, StraightLine
from sim.systems import System

RAFT = System(
    name="raft", dynamics=lambda settings: SingleIntegrator(b=settings.noise), steering=StraightLine.of,
    R=2 * np.eye(2),
    defaults={"samples": 7, "noise": 0.2},
)
NUMBER = 3
def make(): return RAFT
def broken(): raise ValueError("no\\nwind")
def other(): return 4
""",
    "sinking": "import nothing_of_the_kind",
    "leaking": "raise RuntimeError('water\\nin the hull')",
    "leaving": "import sys; sys.exit(3)",
    "typo": "def (",
    "whirl": """
import numpy as np
from pirrht import SingleIntegrator
from sim.systems import System
class Whirl(SingleIntegrator):
    @staticmethod
    def drift(x, p, out):
        out[0], out[1] = np.log(-1.0 - x[0] * x[0]), 0.0
WHIRL = System(name='whirl', dynamics=lambda s: Whirl(b=s.noise), R=2.0 * np.eye(2), states=('x', 'y'))
""",
}
MODULES["flying"] = """
import numpy as np
from pirrht import Dynamics
from sim.systems import System

class Glider(Dynamics):  # no MuJoCo robot has its states, and it declares no twist
    n, m, states = 4, 2, ("x", "y", "u", "v")
    parameters, control_block, diffusion_block = np.zeros(0), np.eye(2), 0.1 * np.eye(2)

    @staticmethod
    def drift(x, p, out):
        out[0], out[1], out[2], out[3] = x[2], x[3], 0.0, 0.0

class Heron(Glider):
    n, m, states = 3, 1, ("x", "y", "heading")
    control_block, diffusion_block = np.eye(1), 0.1 * np.eye(1)

    @staticmethod
    def drift(x, p, out):
        out[0], out[1], out[2] = np.cos(x[2]), np.sin(x[2]), 0.0

GLIDER = System(name="glider", dynamics=lambda s: Glider(), R=np.eye(2), heeds=(), pace=1.0)
HERON = System(name="heron", dynamics=lambda s: Heron(), R=np.eye(1), heeds=(), pace=1.0)
"""
MODULES["fleet"] = MODULES["rafts"] + "SUNK = System(name='sunk', dynamics=None, R=None, defaults={'perod': 0.1})\n"
MODULES["holes"] = MODULES["rafts"].replace("settings.noise", "settings.wind")
MODULES["bare"] = MODULES["rafts"].replace("StraightLine.of", "lambda problem: 1 / 0")


def raft(**changes: object) -> System:
    known = {"dynamics": lambda s: SingleIntegrator(b=s.noise), "steering": StraightLine.of, "R": 2 * np.eye(2)}
    return System(**{"name": "raft", **known, **changes})  # type: ignore[arg-type]


@pytest.fixture
def folder(tmp_path, monkeypatch: pytest.MonkeyPatch):
    """A working folder with modules in it; what is registered and imported is forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(systems, "_known", dict(systems._known))
    monkeypatch.setattr(sys, "path", list(sys.path))
    for name, text in MODULES.items():
        (tmp_path / f"{name}.py").write_text(text)
        monkeypatch.delitem(sys.modules, name, raising=False)
    return tmp_path


def test_a_system_is_chosen_by_module_and_name_with_its_own_defaults_or_handed_over(folder):
    scenario = prepare("slit", system="rafts:RAFT", given={"vertices": 10})
    assert (scenario.system.name, scenario.loaded.dynamics_name) == ("raft", "raft")
    assert scenario.settings.vertices == 10
    assert scenario.settings.samples == 200  # the scene's, which take precedence over a system's
    assert chosen("rafts:make") is scenario.system
    assert b"RAFT" in source("rafts:RAFT")
    assert prepare("slit", system=raft(paper_samples=11), preset="paper").settings.samples == 11
    assert prepare("slit", system="unicycle", robot="unicycle").system is named("unicycle")


def test_a_robot_names_any_registered_system(folder):
    robot = folder / "machine.xml"
    robot.write_text(robot_mjcf(dynamics=ROBOT["dynamics"].replace("single_integrator", "raft")))
    assert '"raft"; write "single_integrator" or "unicycle" or' in refusal("slit", robot=robot)
    register(raft())
    assert load("slit", robot=robot).dynamics_name == "raft"
    with pytest.raises(OptionError, match=r"3 is no sim\.systems\.System"):
        register(3)  # type: ignore[arg-type]
    assert register(raft()) is named("raft")


@pytest.mark.parametrize(
    ("which", "what"),
    [
        ("rafts", "write MODULE:NAME"),
        (":RAFT", "write MODULE:NAME"),
        ("boats/rafts.py:RAFT", "rafts.py is a file, not a module; in its folder, write --system rafts:RAFT"),
        ("nowhere:RAFT", "there is no module nowhere in"),
        ("rafts.deep:RAFT", "there is no module rafts.deep in"),
        ("rafts:KAYAK", "KAYAK is missing; write a sim.systems.System of rafts: RAFT"),
        ("rafts:NUMBER", "NUMBER is of the type int; write a sim.systems.System of rafts"),
        ("rafts:other", "other is of the type int"),
        ("rafts:broken", "ValueError: no wind while rafts was imported"),
        ("sinking:RAFT", "No module named 'nothing_of_the_kind' while sinking was imported"),
        ("leaking:RAFT", "RuntimeError: water in the hull while leaking was imported"),
        ("leaving:RAFT", "SystemExit: 3 while leaving was imported"),
        ("typo:RAFT", "SyntaxError"),
        ("..rafts:RAFT", "while ..rafts was imported"),
        ("fleet:RAFT", "system sunk: 'perod' is no setting"),
        ("fleet:RAFT", f"line {len(MODULES['fleet'].splitlines())} of "),
        ("whirl:WHIRL", "writes [nan, 0.0]"),
        ("holes:RAFT", "system raft: AttributeError: 'Settings' object has no attribute 'wind' in its dynamics"),
        ("bare:RAFT", "system raft: ZeroDivisionError: division by zero in its steering"),
    ],
)
def test_a_system_that_cannot_be_had_or_used_costs_one_line_and_no_warning(folder, refused, recwarn, which, what):
    refused(["plan", "slit", "--system", *which.split()], what)
    assert not recwarn.list


@pytest.mark.parametrize(
    "line", ["    return float(f'{x[0]:.2f}')", "    return np.interp(x[0], [0.0], [1.0], period=1.0)"]
)
def test_code_that_numba_cannot_compile_is_blamed_on_its_line(folder, line, monkeypatch):
    monkeypatch.delitem(sys.modules, "odd", raising=False)
    (folder / "odd.py").write_text(f"from rafts import *\nimport numpy as np\ndef cost(x, p):\n{line}\n")
    chosen("odd:RAFT")
    with pytest.raises(Exception, match=r"format spec|interp") as caught:
        njit(sys.modules["odd"].cost)(np.zeros(2), 0.0)
    reason = str(blamed(caught.value))
    assert f"{folder / 'odd.py'}, line 4: numba cannot compile this (" in reason
    assert reason.isprintable()


def test_states_are_those_of_the_dynamics_and_joints_those_of_the_place(folder):
    mass = System(name="mass", dynamics=lambda _: DoubleIntegrator(b=0.1), R=np.eye(2), heeds=())
    assert (mass.states, mass.adapter.places) == (("x", "y", "vx", "vy"), ("x", "y"))
    assert load("slit", system=raft(states=mass.states)).states == mass.states
    with pytest.raises(OptionError, match=r"system raft: SingleIntegrator has the states \('x', 'y'\)"):
        prepare("slit", robot="unicycle", system=raft(states=("x", "y", "heading")))


@pytest.mark.parametrize("robot", ["puck", "unicycle", "diffdrive"])
@pytest.mark.parametrize("name", ["GLIDER", "HERON"])
def test_the_equation_alone_is_driven_without_joints_and_without_a_twist(folder, robot, name):
    scenario = prepare("slit", system=f"flying:{name}", robot=robot, plant="sde")
    d, plant = scenario.problem.dynamics, scenario.plant()
    plant.advance(lambda x, s: np.zeros(d.m), np.random.default_rng(0))
    assert plant.state.shape == (d.n,)
    misfit = (name, robot) in {("HERON", "puck"), ("GLIDER", "unicycle"), ("GLIDER", "diffdrive")}
    why = "must have these joints|has a heading, and" if misfit else "has no u|declares no twist"
    with pytest.raises(OptionError, match=why):
        scenario.with_settings(plant="mujoco").plant()


def test_the_cost_to_go_of_a_mass_is_the_optimum_into_the_goal_at_any_velocity():
    scenario = prepare("slit", robot="hover")
    goal = scenario.loaded.scene.goal
    cost = named("double_integrator").cost_to_go(scenario.problem, straight_lines(goal))
    off = 4.5 - goal.radius  # the goal's middle is 4.5 m away
    duration = (4.5 * 2.0 * off**2) ** 0.25  # T^4 = (9 r / 2 q) off^2 from rest, and the cost is 4/3 q T
    rest, toward, away = (float(cost(np.array([[1.0, 2.5, v, 0.0]]))[0]) for v in (0.0, 1.0, -1.0))
    assert rest == pytest.approx(4.0 / 3.0 * duration)
    assert toward < rest < away
    np.testing.assert_array_equal(cost(np.array([[*goal.center, 3.0, 1.0]])), [0.0])


@pytest.mark.parametrize("robot", ["puck", "unicycle", "diffdrive", "hover", "rover", "car"])
def test_mppi_of_every_robot_prices_what_is_left_of_the_shortest_path(robot):
    scenario = prepare("u_trap", robot=robot, given={"method": "mppi"})
    short, straight = (scenario.with_settings(mppi_terminal=one).controller(None) for one in ("path", "straight"))
    pocket, beyond = np.zeros((2, 1, scenario.problem.dynamics.n))
    pocket[0, :2] = 3.4, 2.3  # between the arms of the trap, next to its back
    beyond[0, :2] = 4.5, 2.3  # in sight of the goal
    costs = [[float(one.path_integral.terminal_cost(x)[0]) for x in (pocket, beyond)] for one in (short, straight)]
    assert costs[0][0] > 1.4 * costs[1][0]
    assert costs[0][1] == pytest.approx(costs[1][1], rel=0.02)


def test_a_point_without_drift_plans_as_the_built_in_one_without_a_steering():
    bare = System(name="bare", dynamics=lambda settings: SingleIntegrator(b=settings.noise), R=2 * np.eye(2))
    own, built_in = (prepare("slit", system=one, noise=0.2, vertices=300, margin=0.0) for one in (bare, None))
    one, other = (s.controller(s.grown_tree()).plan(s.start) for s in (own, built_in))
    np.testing.assert_array_equal(one.control, other.control)


def test_a_scene_sets_what_a_system_has_of_its_own_only_if_it_is_meant_for_it(folder):
    own = raft(own=("noise", "max_time"), defaults={"noise": 0.7, "max_time": 3.0, "samples": 5})
    slit = load("slit")
    assert (slit.meant, load("clutter").meant) == ("single_integrator", "unicycle")
    assert own.heard(slit.scene.defaults, own.name) == slit.scene.defaults
    settings = prepare("slit", system=own).settings
    assert (settings.noise, settings.max_time, settings.samples) == (0.7, 3.0, 200)
    assert prepare("slit", system=own, given={"noise": 0.3}).settings.noise == 0.3


@pytest.mark.parametrize(
    ("field", "value", "what"),
    [
        ("defaults", {"nois": 1}, "'nois' is no setting; those are .*noise"),
        ("defaults", {"noise": -1}, "--noise is -1; it must be a positive number"),
        ("own", ("wind",), "'wind' is no setting; those are .*noise"),
        ("heeds", ("wind",), "'wind' is no setting to heed; those are noise, rho, speed"),
        ("states", ("y", "x"), 'the first two must be "x" and "y"'),
        ("name", "unicycle", "unicycle: that name is taken"),
    ],
)
def test_a_system_that_cannot_work_is_refused(field, value, what):
    with pytest.raises(OptionError, match=what):
        register(raft(**{field: value}))


def test_numbers_that_a_system_has_none_of_are_refused(folder):
    speedy = "puck, unicycle, rover, jackal or ball"
    for option, robot, who in (("speed", "hover", speedy), ("rho", "puck", "unicycle")):
        with pytest.raises(OptionError, match=f"--{option} is for {who}, not for {robot}"):
            prepare("slit", robot=robot, given={option: 2.0})
    with pytest.raises(OptionError, match=r'--noise is for .*; leave it out, or write `heeds=\("noise",\)`'):
        prepare("slit", system=raft(heeds=()), given={"noise": 0.2})
    scenario = prepare("slit", system=raft(heeds=()))
    assert scenario.with_settings(seed=3, noise=scenario.settings.noise).settings.seed == 3
    with pytest.raises(OptionError, match="--noise is for"):
        scenario.with_settings(noise=0.2)


@pytest.mark.parametrize("robot", first(["puck", "rover"]))
def test_a_speed_is_the_one_at_which_references_are_driven(robot):
    """Driving at v costs q + v'v, q/v + v a metre: least at v = sqrt(q)."""
    for speed in (0.5, 1.0, 2.0):
        scenario = prepare("slit", robot=robot, given={"speed": speed, "vertices": 60})
        path = scenario.references(scenario.grown_tree())[0].trajectory
        assert path.length / path.durations.sum() == pytest.approx(speed, rel=1e-9)
