"""Options that are settings of a run, in the order of the help."""

from __future__ import annotations

from pirrht.control.settings import BETWEEN, METHODS
from pirrht.estimation.sampling import ALLOCATIONS, DRAWS, EXITS, GUIDES, STEPS, WEIGHTS
from sim.options.record import Bounds, Option

PLANTS = ("mujoco", "sde")
PREDICTIONS = ("known", "velocity")
SEED = 2**63 - 1

DRIVES = ("plan", "run", "play", "estimate", "sweep")  # commands that take a scene
SINGLE = ("plan", "run", "play", "estimate")  # those that take one method, noise and seed
PROBLEM, PLANNER, DRIVE = "problem", "planner and sampler", "drive"


def _setting(name: str, text: str, **more: object) -> Option:
    known: dict[str, object] = {"commands": DRIVES, "group": PLANNER, "identifies": True, "role": "setting", **more}
    return Option(name=name, text=text, **known)  # type: ignore[arg-type]


def _number(name: str, text: str, unit: str, low: float, high: float, why: str, **more: object) -> Option:
    kind = int if isinstance(low, int) and isinstance(high, int) else float
    bounds = Bounds(low=low, high=high, why=why, infinite=bool(more.pop("infinite", False)))
    return _setting(name, text, kind=kind, metavar=unit, bounds=bounds, **more)


PROBLEM_OPTIONS = (
    _number(
        "speed", "speed V of a unicycle, best speed of a puck or rover", "M/S", 1e-3, 1e3,
        "slower cars never arrive, and faster ones cross a room in a step", group=PROBLEM, numeric=True, special=True,
    ),
    _number(
        "rho", "turning radius of a unicycle at |u| = 1 and V = 1", "M", 1e-3, 1e4,
        "tighter turns are spins on the spot, and wider ones straight lines", group=PROBLEM, numeric=True, special=True,
    ),
    _number(
        "noise", "noise b", "B", 1e-6, 1e3,
        "less is none to a computer, and more throws a robot across any scene", group=PROBLEM, numeric=True,
        commands=SINGLE, special=True, of_robots="noise_in",
    ),
    _number(
        "phi", "final cost off the goal", "COST", 0.0, 1e12, "beyond it costs of paths are lost beside it",
        group=PROBLEM, numeric=True, infinite=True,
    ),
    _number(
        "seed", "seed of tree, samples and plant noise", "N", 0, SEED, "seeds are kept in 64 bits", group=PROBLEM,
        numeric=True, commands=SINGLE,
    ),
)  # fmt: skip

PLANNER_OPTIONS = (
    _number(
        "vertices", "grow until the tree has N vertices", "N", 1, 1_000_000,
        "a tree of a million grows for hours and fills some GiB of memory", numeric=True,
    ),
    _number(
        "classes", "at most K classes per vertex, 0 for all", "K", 0, 10_000,
        "so many paths cannot be sampled around", numeric=True,
    ),
    _number(
        "limit", "H_limit of |1 - H_i| <= H_limit, kept to if given; the robot's or the scene's own, 0.8 among bodies "
        "that move, is widened to 0.8, 1 or 1.5 where it leaves out a way of at most 1.25 times the shortest", "H",
        1e-3, 100.0, "less forbids every path, and no path of use winds so often", numeric=True,
    ),
    _number(
        "samples", "samples around each reference", "N", 1, 10_000_000,
        "weighing more of them takes longer than it is worth", numeric=True,
    ),
    _number(
        "target-error", "sample on, doubling, until the control's standard error is below EPS", "EPS", 1e-6, 1e3,
        "smaller errors take more samples than there is memory for",
    ),
    _number(
        "budget", "samples around each reference at most under --target-error", "N", 1, 100_000_000,
        "all of them are kept until they are weighed", unset="16 --samples",
    ),
    _number(
        "dt", "rollout step", "S", 1e-5, 10.0, "paths of shorter steps never end, and longer ones see no walls",
        numeric=True, paper=0.1,
    ),
    _number(
        "period", "control period after which the plan is made anew", "S", 1e-5, 100.0,
        "no physics step is shorter, and no plan is good for so long", numeric=True, paper=0.1,
    ),
    _number(
        "threads", "threads of the sampler; results do not depend on it", "N", 1, 1024, "no machine has so many cores",
        unset="all cores", identifies=False,
    ),
    _setting(
        "exit", "first exit along the step (bridge) or at its end (endpoint)", metavar="RULE", choices=EXITS,
        paper="endpoint",
    ),
    _setting(
        "steps", "rollout steps with --exit bridge: split near walls and goal (fitted) or all of --dt (uniform, paper)",
        metavar="RULE", choices=STEPS, paper="uniform",
    ),
    _setting(
        "weights", "how references mix: balance, average (paper) or biased (no likelihood ratio, as in Biased-MPPI)",
        metavar="RULE", choices=WEIGHTS,
        paper="average",
    ),
    _setting(
        "guide", "samples follow the reference from where they are (feedback) or open-loop (paper)", metavar="RULE",
        choices=GUIDES, paper="open-loop", fixed={"mppi": "open-loop"},
    ),
    _setting(
        "between", "between plans the control follows the state (classes) or is held (hold, paper)", metavar="RULE",
        choices=BETWEEN, paper="hold",
    ),
    _setting(
        "allocation", "samples go to the references by contribution in earlier plans, or equal (paper)",
        metavar="RULE", choices=ALLOCATIONS, paper="equal",
    ),
    _setting(
        "draws", "samples in pairs of opposite noise (antithetic) or independent (paper)", metavar="RULE",
        choices=DRAWS, paper="independent", fixed={"mppi": "independent"},
    ),
    _setting("no-polish", "references as the tree has them", attribute="polish", kind=bool, sets=False),
    Option(
        name="preset", metavar="NAME", commands=DRIVES, group=PLANNER, role="task", identifies=True,
        text="paper: dt = period = 0.1, its N, open loop, plain average, endpoint exit, uniform steps, equal, "
        "independent samples",
    ),
    _setting(
        "tree", "a tree that `pirrht plan -o` saved, instead of growing one", metavar="TREE.npz",
        commands=DRIVES[1:],
    ),
    _setting("method", f"one of {', '.join(METHODS)}", metavar="NAME", choices=tuple(METHODS), commands=SINGLE),
    _number(
        "consistency", "of best-class: the value of the class followed so far counts C times, 1 for no preference",
        "C", 1e-3, 1e3, "beyond it the class is decided beforehand", methods=("best-class",), numeric=True,
    ),
    _number(
        "horizon", "of mppi: length of its tape", "S", 1e-3, 1e4, "no tape is of use so long", methods=("mppi",),
        numeric=True,
    ),
    _number(
        "exploration", "of mppi: noise of its samples over the robot's", "X", 1e-3, 1e3,
        "beyond it samples have nothing to do with the robot", methods=("mppi",), numeric=True,
    ),
    _setting(
        "predict", "bodies that move: plans know their motions (known), or see where they are and how fast, and take "
        "them to go straight on (velocity)", metavar="RULE", choices=PREDICTIONS,
    ),
    _number(
        "speed-limit", "fastest way past bodies that move, 0 for five times the best speed", "M/S", 0.0, 1e3,
        "a faster robot crosses a room in a step", numeric=True,
    ),
    _setting("plant", "mujoco, or sde: the analytic equation", metavar="NAME", choices=PLANTS),
    _number(
        "max-time", "end of the drive in simulated time, in whole control periods", "S", 1e-3, 86_400.0,
        "no drive of a day is of use", numeric=True,
    ),
)  # fmt: skip

DRIVE_OPTIONS = (
    _setting(
        "real-time",
        "drive against the clock and plan ahead meanwhile, with as many classes and samples as there is time for (one "
        "class, the cheapest, and --samples at least, or a tenth of them among bodies that move); --record writes when "
        "the drive is over; results depend on the machine and differ from run to run",
        kind=bool, commands=("run",), group=DRIVE,
    ),
    _number(
        "grow", "vertices that the tree gains between two plans; with --real-time at most, in the time that is left",
        "N", 0, 10_000, "growing more takes longer than the drive", commands=("run", "play"), group=DRIVE, unset="0",
    ),
)  # fmt: skip

PLAN_SEED = _number(
    "plan-seed", "seed of the trees", "N", 0, SEED, "seeds are kept in 64 bits", commands=("sweep",), group="grid",
    default=0,
)  # fmt: skip

SETTINGS = (*PROBLEM_OPTIONS, *PLANNER_OPTIONS, *DRIVE_OPTIONS, PLAN_SEED)
