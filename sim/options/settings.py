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
PROBLEM, PLANNER, DRIVE = "problem", "planner and sampler", "run"


def _setting(name: str, text: str, **more: object) -> Option:
    known: dict[str, object] = {"commands": DRIVES, "group": PLANNER, "identifies": True, "role": "setting", **more}
    return Option(name=name, text=text, **known)  # type: ignore[arg-type]


def _number(name: str, text: str, unit: str, low: float, high: float, why: str, **more: object) -> Option:
    kind = int if isinstance(low, int) and isinstance(high, int) else float
    bounds = Bounds(low=low, high=high, why=why, infinite=bool(more.pop("infinite", False)))
    return _setting(name, text, kind=kind, metavar=unit, bounds=bounds, **more)


PROBLEM_OPTIONS = (
    _number(
        "noise", "noise b in the robot's unit", "B", 1e-6, 1e3,
        "less is none to a computer, and more throws a robot across any scene", group=PROBLEM, numeric=True,
        commands=SINGLE, special=True, common=True,
    ),
    _number(
        "speed", "speed V of a unicycle, best speed of a puck or rover", "M/S", 1e-3, 1e3,
        "slower cars never arrive, and faster ones cross a room in a step", group=PROBLEM, numeric=True, special=True,
        common=True,
    ),
    _number(
        "rho", "turning radius of a unicycle at |u| = 1 and V = 1", "M", 1e-3, 1e4,
        "tighter turns are spins on the spot, and wider ones straight lines", group=PROBLEM, numeric=True, special=True,
    ),
    _number(
        "phi", "final cost off the goal", "COST", 0.0, 1e12, "beyond it rounding loses the costs of paths",
        group=PROBLEM, numeric=True, infinite=True,
    ),
    _number(
        "seed", "seed of tree, samples and plant noise", "N", 0, SEED, "seeds are kept in 64 bits", group=PROBLEM,
        numeric=True, commands=SINGLE, common=True,
    ),
)  # fmt: skip

PLANNER_OPTIONS = (
    _setting("method", ", ".join(METHODS), metavar="NAME", choices=tuple(METHODS), commands=SINGLE, common=True),
    Option(
        name="preset", metavar="NAME", commands=DRIVES, group=PLANNER, role="task", identifies=True, common=True,
        text="paper, fast or accurate",
    ),
    _number(
        "samples", "samples around each reference", "N", 1, 10_000_000,
        "weighting more of them takes longer than it is worth", numeric=True, common=True,
    ),
    _number(
        "vertices", "vertices of the tree", "N", 1, 1_000_000,
        "a tree of a million grows for hours and fills some GiB of memory", numeric=True, common=True,
    ),
    _number(
        "classes", "classes per vertex at most, 0 for all", "K", 0, 10_000,
        "so many paths cannot be sampled around", numeric=True,
    ),
    _number(
        "limit", "H_limit of |1 - H_i| <= H_limit; a default that excludes a path of at most 1.25 times the shortest "
        "is widened to 0.8, 1 or 1.5", "H", 1e-3, 100.0, "less forbids every path, and no useful path winds so often",
        numeric=True,
    ),
    _number(
        "target-error", "draw, doubling, until the control's standard error is below EPS", "EPS", 1e-6, 1e3,
        "smaller errors take more samples than there is memory for",
    ),
    _number(
        "budget", "samples around each reference at most under --target-error", "N", 1, 100_000_000,
        "all of them are kept until they are weighted", unset="16 --samples",
    ),
    _number(
        "dt", "rollout step", "S", 1e-5, 10.0, "paths of shorter steps never end, and longer ones see no walls",
        numeric=True, paper=0.1,
    ),
    _number(
        "period", "control period: time between plans", "S", 1e-5, 100.0,
        "no physics step is shorter, and no plan is good for so long", numeric=True, paper=0.1,
    ),
    _number(
        "threads", "threads of the sampler; results do not depend on it", "N", 1, 1024, "no machine has so many cores",
        unset="all cores", identifies=False,
    ),
    _setting(
        "exit", "first exit along the step (bridge) or at its end (endpoint, paper)", metavar="RULE", choices=EXITS,
        paper="endpoint",
    ),
    _setting(
        "steps", "rollout steps: split near walls and goal (fitted) or all of --dt (uniform, paper)",
        metavar="RULE", choices=STEPS, paper="uniform",
    ),
    _setting(
        "weights", "mixture of references: balance, average (paper) or biased (no likelihood ratio, as Biased-MPPI)",
        metavar="RULE", choices=WEIGHTS, paper="average",
    ),
    _setting(
        "guide", "proposals: feedback or open-loop (paper)", metavar="RULE", choices=GUIDES, paper="open-loop",
        fixed={"mppi": "open-loop"},
    ),
    _setting(
        "between", "between plans the control follows the state (classes) or is held (hold, paper)", metavar="RULE",
        choices=BETWEEN, paper="hold",
    ),
    _setting(
        "allocation", "samples per reference: by contribution to earlier plans, or equal (paper)",
        metavar="RULE", choices=ALLOCATIONS, paper="equal",
    ),
    _setting(
        "draws", "pairs of opposite noise (antithetic) or independent samples (paper)", metavar="RULE",
        choices=DRAWS, paper="independent", fixed={"mppi": "independent"},
    ),
    _setting("no-polish", "do not shorten references", attribute="polish", kind=bool, sets=False),
    _setting(
        "tree", "a tree that `pirrht plan -o` saved, instead of growing one", metavar="TREE.npz",
        commands=DRIVES[1:],
    ),
    _number(
        "consistency", "best-class: factor on the value of the class followed so far, 1 for no preference",
        "C", 1e-3, 1e3, "beyond it the class is decided beforehand", methods=("best-class",), numeric=True,
    ),
    _number(
        "horizon", "mppi: length of its control sequence", "S", 1e-3, 1e4, "no control sequence is useful so long",
        methods=("mppi",), numeric=True,
    ),
    _number(
        "exploration", "mppi: noise of its samples over the robot's", "X", 1e-3, 1e3,
        "beyond it samples have nothing to do with the robot", methods=("mppi",), numeric=True,
    ),
    _setting(
        "predict", "moving obstacles: motions are known, or predicted by constant velocity", metavar="RULE",
        choices=PREDICTIONS,
    ),
    _number(
        "speed-limit", "fastest reference among moving obstacles, 0 for five times the best speed", "M/S", 0.0, 1e3,
        "a faster robot crosses a room in a step", numeric=True,
    ),
    _setting("plant", "mujoco, or sde: the analytic equation", metavar="NAME", choices=PLANTS),
    _number(
        "max-time", "end of the run in simulated time", "S", 1e-3, 86_400.0,
        "no run of a day is useful", numeric=True,
    ),
)  # fmt: skip

DRIVE_OPTIONS = (
    _setting(
        "real-time", "run against the clock, with as many classes and samples as there is time for; results differ "
        "from run to run", kind=bool, commands=("run",), group=DRIVE, common=True,
    ),
    _number(
        "grow", "vertices that the tree gains between two plans; in real time at most",
        "N", 0, 10_000, "growing more takes longer than the run", commands=("run", "play"), group=DRIVE, unset="0",
    ),
)  # fmt: skip

PLAN_SEED = _number(
    "plan-seed", "seed of the trees", "N", 0, SEED, "seeds are kept in 64 bits", commands=("sweep",), group="grid",
    default=0,
)  # fmt: skip

SETTINGS = (*PROBLEM_OPTIONS, *PLANNER_OPTIONS, *DRIVE_OPTIONS, PLAN_SEED)
