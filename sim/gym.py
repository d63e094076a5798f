"""The noisy robot as Gymnasium environments, so that other people's controllers drive what ours drive.

Importing this module registers `pirrht/Slit-v0` and so on for every built-in scene but barn, and `pirrht/Scene-v0` for
any; `gymnasium.make("sim.gym:pirrht/Slit-v0")` imports it.

* Observation: the state x (n,): x, y [m] and of a car the unwrapped heading [rad].
* Action: the control u (m,), held for one period: velocity [m/s] of a point, turn rate over V/rho of a car.
* Reward: -(q + u'Ru/2) dt over the period, less the problem's phi at a collision, or `penalty` where that is infinite.
* `terminated` in the goal or at a collision, `truncated` after `max_time`.
* `info`: outcome ("goal", "collision", "timeout" or None), cost, time [s], min_clearance [m], path_length [m].

`reset(seed=s)` gives the plant the noise that it has under `pirrht run --seed s`.

`pirrht/Barn-v0` is a Jackal with a lidar in worlds of BARN, scored by the rules of its challenge; see `Barn`, and
`DynaBarn` for `pirrht/DynaBarn-v0`. Our own methods drive environments as policies, by `method_of`.
"""

import json
import reprlib
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any
from weakref import finalize

import numpy as np

from pirrht.arrays import Array
from pirrht.control.mapped import Mapped
from pirrht.control.plan import Plan
from pirrht.control.settings import TREELESS
from pirrht.errors import OptionError
from pirrht.mapping.scan import Scan
from pirrht.outcome import Outcome
from sim import barn
from sim.drive.executor import Executor
from sim.drive.metrics import EpisodeMetrics, Frame, TimedPlan
from sim.extras import require
from sim.importing import dynabarn
from sim.importing.scene_file import import_world
from sim.mjcf import scene_names
from sim.mjcf.robot import control_limits
from sim.scenario import prepare
from sim.scenario.scenario import Driver
from sim.sensing.senses import Senses
from sim.settings import BY_SCENE, BY_SETTING
from sim.sweeps import runs, scores
from sim.sweeps.runs import Job, Planned

require("sim.gym", "gym")
import gymnasium  # noqa: E402 - the line above reports how to install it
from gymnasium.spaces import Box, Dict  # noqa: E402

PENALTY = 100.0  # of a collision, where phi is infinite [cost]
OTHERS = {"method", "seed", "plan_seed", "real_time"}  # options of a run that are the policy's, or of `reset`
OWN = {"robot", "system", "start", "goal", "workspace", "sense"}  # options that are those of BARN's worlds
NUMBERED = 10_000  # worlds that are drawn from those of our own
ARGUMENTS = {*BY_SCENE, *BY_SETTING} - OTHERS
SEED = BY_SETTING["seed"]

Policy = Callable[[Any], Any]  # observation -> action (m,)


class Drive(gymnasium.Env[Any, Array]):
    """One robot in one scene, a built-in name or MJCF file.

    Args:
        penalty: taken off at a collision where phi is infinite.
        bound: actions are clipped to [-bound, bound], and to what the robot's ctrlranges allow.
        options: those of `prepare` but method, seed and real_time; without them the scene or the robot decides. The
            planner's, such as limit, are for policies that are made of the environment's `scenario`.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self, scene: str | Path = "slit", *, penalty: float = PENALTY, bound: float = np.inf, **options: Any
    ) -> None:  # fmt: skip
        if not bound > 0 or not penalty >= 0:
            raise OptionError(f"bound is {bound:g} and penalty {penalty:g}; they must be positive, and 0 or more")
        if strange := {name for name, value in options.items() if value is not None} - ARGUMENTS:
            raise OptionError(
                f"{', '.join(sorted(strange))}: no argument of an environment; those are bound, penalty and the "
                f"options of `pirrht run`, such as noise, but {', '.join(sorted(OTHERS))}"
            )
        self._given = {name: value for name, value in options.items() if value is not None}
        self._enter(scene, penalty)
        s, d = self.scenario, self.scenario.problem.dynamics
        self.observation_space: gymnasium.Space[Any] = Box(-np.inf, np.inf, (d.n,), np.float64)
        low = np.full(d.m, -bound)
        high = np.full(d.m, bound)

        if s.settings.plant == "mujoco":
            least, most = control_limits(s.loaded.model, s.loaded.command, d)
            low = np.maximum(low, least)
            high = np.minimum(high, most)
        if not np.all(low < high):
            raise OptionError("the robot's ctrlranges leave no control; widen them, or choose another speed or bound")
        self.action_space = Box(low, high, (d.m,), np.float64)

    def _enter(self, scene: str | Path, penalty: float) -> None:
        """Be in a scene, before a run."""
        given = dict.fromkeys(BY_SCENE) | self._given
        self.job = Job(scene=str(scene), method="", noise=given.get("noise"), seed=0, given=runs.frozen(given))
        self._asked: float | None = None  # when an action was asked for, on the clock [s]
        self.frame: Frame | None = None  # the last period
        self.scenario = s = prepare(scene, given=given)
        self._plant = s.plant()
        self._fall = s.problem.phi if np.isfinite(s.problem.phi) else penalty

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Stand at the start; without a seed one is drawn."""
        super().reset(seed=None if seed is None else SEED.check(seed, "seed"))
        self.seed = int(self.np_random.integers(2**31)) if seed is None else int(seed)
        scenario, s, self.frame = self.scenario, self.scenario.settings, None
        seeded = scenario.with_settings(seed=self.seed)
        self._rng = seeded.plant_rng()
        if s.sense == "lidar":  # whose noise has a seed, too
            self._plant = seeded.plant()
        self._plant.reset(scenario.start)
        self._metrics = EpisodeMetrics(scenario, self._plant.state, period=s.period, max_time=s.max_time)
        self._asked = time.perf_counter()
        return self._observed(), self._info()

    def step(self, action: Array) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Hold a control for one period; OptionError before `reset`, after the end, or if it is no control."""
        if self._asked is None:
            raise OptionError("the run has not begun or is over; call reset() first")
        thought = time.perf_counter() - self._asked
        control = _control(action, self.action_space.shape, "the action is")
        u = np.clip(control, self.action_space.low, self.action_space.high)  # type: ignore[attr-defined]
        x, times = self._plant.state, np.array([0.0, self.scenario.settings.period])
        plan = Plan(state=x, times=times, references=(), ids=(), estimate=None, fallback=None, instead=u[None])
        advance = self._plant.advance(lambda x, s: u, self._rng)
        self.frame = self._metrics.frame(TimedPlan(plan=plan, plan_seconds=thought), advance)
        outcome = self.frame.outcome
        reward = self._rewarded(self.frame)
        self._asked = time.perf_counter() if outcome is None else None
        over = outcome in (Outcome.GOAL, Outcome.COLLISION)
        return self._observed(), float(reward), over, outcome is Outcome.TIMEOUT, self._info()

    @property
    def believed(self) -> Array:
        """Return the state (n,) that the robot believes to be in."""
        return self._plant.state

    def _observed(self) -> Any:
        """Return what the policy sees."""
        return self._plant.state

    def _rewarded(self, frame: Frame) -> float:
        """Return the reward of the last period."""
        return -frame.advance.cost - (self._fall if frame.outcome is Outcome.COLLISION else 0.0)

    def result(self) -> dict[str, Any]:
        """Return the figures of this run so far, as `pirrht run --json` has them; OptionError before any step."""
        if self.frame is None:
            raise OptionError("nothing has been driven yet; call reset() and step() first")
        return self.frame.metrics.json()

    def _info(self) -> dict[str, Any]:
        frame, m = self.frame, self._metrics
        return {
            "outcome": None if frame is None or frame.outcome is None else m.outcome, "cost": m.cost, "time": m.time,
            "min_clearance": m.min_clearance, "path_length": m.path_length,
        }  # fmt: skip


class Barn(Drive):
    """A Jackal with a lidar and no map, in worlds of BARN: a reproduction in MuJoCo of the challenge of 2026.

    * Observation: "ranges" (rays,) from the right to the left [m], the greatest where there is nothing and 0 where it
      is too near; "pose" (3,) x, y [m] and heading [rad]; "goal" (2,) its place ahead and to the left [m]; "speed" (2,)
      [m/s, rad/s].
    * Action: speed [m/s] and turn rate [rad/s], held for 0.1 s.
    * Reward: the score at the end, at most 0.5; 0 before, and after a collision or 100 s.
    * `reset(options={"world": name})` chooses a world, else one is drawn; `info` has its "world" and the "score", too.

    Args:
        worlds: centres (k, 2) of cylinders in the challenge's frame [m], by name or in a sequence, or a JSON file of
            them; None: worlds of our own are grown, of any number from 0 on.
        lengths: of the path that the best time is for, by name [m], or a JSON file of them; None: of the shortest way.
        options: those of `Drive`, but sense.

    Examples:
        >>> from sim import gym
        >>> env = gym.Barn(max_time=0.2)
        >>> observation, info = env.reset(seed=0, options={"world": 3})
        >>> observation["ranges"].shape, info["world"], info["score"]
        ((720,), '3', 0.0)
    """

    def __init__(
        self, worlds: str | Path | Mapping[str, Any] | Sequence[Any] | None = None, *,
        lengths: str | Path | Mapping[str, float] | None = None, bound: float = np.inf, **options: Any,
    ) -> None:  # fmt: skip
        if strange := OWN & options.keys():
            raise OptionError(
                f"{', '.join(sorted(strange))}: no argument of an environment whose worlds have their own"
            )
        given: Any = barn.read(worlds) if isinstance(worlds, str | Path) else worlds
        if given is not None and not len(given):
            raise OptionError("there is no world; give at least one, or leave them out to have some grown")
        numbered = isinstance(given, Mapping) or given is None
        self.worlds: dict[str, Any] = dict(given or {}) if numbered else {str(i): one for i, one in enumerate(given)}
        ways: Any = barn.read(lengths) if isinstance(lengths, str | Path) else lengths or {}
        self.lengths: dict[str, float] = dict(ways.get("length", ways))
        self.scan: Scan | None = None  # the last one
        folder = mkdtemp()
        finalize(self, rmtree, folder, ignore_errors=True)
        self._file = Path(folder) / "barn.xml"
        self._choose(next(iter(self.worlds), "0"))
        super().__init__(self._file, bound=bound, **barn.SENSED | options, robot="jackal", sense="lidar")
        lidar = self._senses.sensor.lidar
        self.observation_space = Dict(
            ranges=Box(0.0, lidar.most, (lidar.rays,), np.float64), pose=_unbounded(3), goal=_unbounded(2),
            speed=_unbounded(2),
        )  # fmt: skip

    @property
    def _senses(self) -> Senses:
        assert isinstance(self._plant, Executor)
        assert self._plant.senses is not None
        return self._plant.senses

    @property
    def believed(self) -> Array:
        """Return the state (3,) that the robot believes to be in."""
        return self._plant.state + self._senses.error

    def _choose(self, world: str) -> None:
        """Write the scene of a world."""
        if self.worlds and world not in self.worlds:
            known = reprlib.repr(list(self.worlds))
            raise OptionError(f"there is no world {world!r}; those are {known}")
        try:
            way = self._write(world)
            self.best = float(self.lengths.get(world, way)) / barn.FASTEST
        except (ValueError, TypeError, IndexError) as error:
            raise OptionError(f"world {world!r}: {error}; centres are (k, 2), and grown worlds have numbers") from None
        self.world = world

    def _write(self, world: str) -> float:
        """Write the scene of a world; return the length of its shortest way [m]."""
        posts = np.array(self.worlds[world], dtype=float) if self.worlds else barn.grown(int(world))
        posts = posts.reshape(len(posts), 2)
        self._file.write_text(barn.text("barn", posts), encoding="utf-8")
        return barn.length(posts)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Stand at the start of a world; without a seed one is drawn."""
        rng = self.np_random if seed is None else np.random.default_rng(SEED.check(seed, "seed"))
        drawn = int(rng.integers(len(self.worlds) or NUMBERED))
        world = str((options or {}).get("world", [*self.worlds][drawn] if self.worlds else drawn))
        if world != self.world:
            self._choose(world)
            self._enter(self._file, 0.0)
        self._score = 0.0
        self._late: float | None = None  # when the robot had moved [s]
        return super().reset(seed=seed)

    def _observed(self) -> dict[str, Array]:
        for scan in self._senses.take():
            self.scan = scan
        assert self.scan is not None
        x = self.believed
        h = self._plant.physics_step
        track = x[None] if self.frame is None else self.frame.advance.states
        before, now = track[[max(len(track) - 2, 0), -1]]
        c = np.cos(x[2])
        s = np.sin(x[2])
        turned = np.array([[c, s], [-s, c]])
        ranges = np.nan_to_num(self.scan.ranges, posinf=self.scan.most, neginf=0.0)
        return {
            "ranges": np.clip(ranges, 0.0, self.scan.most), "pose": x,
            "goal": turned @ (self.scenario.problem.scene.goal.center - x[:2]),
            "speed": np.array([(turned @ (now - before)[:2])[0], (now - before)[2]]) / h,
        }  # fmt: skip

    def _rewarded(self, frame: Frame) -> float:
        begun = self._metrics.time - frame.advance.time
        moved = barn.waited(frame.advance.states, self._plant.physics_step, self.scenario.start)
        if self._late is None and (moved < frame.advance.time - 1e-9 or frame.outcome is not None):
            self._late = begun + moved
        if frame.outcome is not None:
            self._score = barn.score(self._metrics.outcome or "", self._metrics.time - (self._late or 0.0), self.best)
        return self._score

    def result(self) -> dict[str, Any]:
        """Return the figures of this run so far, its world and its score; OptionError before any step."""
        return super().result() | {"world": self.world, "score": self._score}

    def _info(self) -> dict[str, Any]:
        return super()._info() | {"world": self.world, "score": self._score}


class DynaBarn(Barn):
    """A Jackal with a lidar in worlds of DynaBARN (Nair et al. 2022), among cylinders that move, scored as in `Barn`.

    Args:
        worlds: JSON file of motions, as `pirrht import --motion` reads it, or what it holds.
        options: those of `Barn`.
    """

    def __init__(self, worlds: str | Path | Mapping[str, Any] | None = None, **options: Any) -> None:
        if worlds is None:
            raise OptionError("DynaBarn has no worlds of its own; give worlds=FILE, the JSON file of a set of motions")
        super().__init__(worlds, **{"footprint": "jackal"} | options)  # the file has another robot's radius

    def _write(self, world: str) -> float:
        source = self._file.with_suffix(".json")
        source.write_text(json.dumps({world: self.worlds[world]}), encoding="utf-8")
        import_world(source, self._file, motion=True)
        return float(np.hypot(*np.subtract(dynabarn.START, dynabarn.GOAL)[:2]))


def _unbounded(n: int) -> Box:
    """Return the space of n numbers."""
    return Box(-np.inf, np.inf, (n,), np.float64)


def method_of(environment: gymnasium.Env[Any, Any], **settings: Any) -> Policy:
    """Return one of our methods as the policy of an environment, such as method="mppi"; each run begins anew.

    Args:
        environment: a `Drive`, perhaps wrapped.
        settings: fields of `Settings` that differ from the environment's.

    Examples:
        >>> from sim import gym
        >>> env = gym.Drive("slit", noise=0.2, max_time=0.02, vertices=50, samples=20)
        >>> [row["outcome"] for row in gym.score(gym.method_of(env), environment=env, seeds=[0], method="pi-rrht")]
        ['timeout']
    """
    drive = environment.unwrapped
    assert isinstance(drive, Drive)
    driver: Driver | None = None

    def act(_: Any) -> Array:
        nonlocal driver
        x = drive.believed
        if driver is None or drive.frame is None:
            scenario = drive.scenario.with_settings(seed=drive.seed, **settings)
            driver = scenario.driver(None if scenario.settings.method in TREELESS else scenario.grown_tree())
            driver.begin(x)
        else:
            driver.observe(drive.frame.advance.states, drive.frame.advance.time)
        if isinstance(driver, Mapped) and isinstance(drive, Barn) and drive.scan is not None:
            driver.see(drive.scan)
        return driver.plan(x).at(x, 0.0)

    return act


def score(
    policy: Policy | Callable[[int], Policy], *, seeds: Iterable[int], method: str, anew: bool = False,
    environment: gymnasium.Env[Any, Any] | None = None, into: str | Path | None = None, again: bool = False,
    **options: Any,
) -> list[dict[str, Any]]:  # fmt: skip
    """Drive a policy once per seed; one record each, as those of `pirrht sweep`.

    Args:
        policy: takes the state x (n,) and returns the control u (m,), held for one period; with `anew` a function
            that takes a seed and makes such a policy, for one with a memory. (Of a wrapped environment: its
            observation, its action.)
        seeds: one run each, at least one whole number from 0 on.
        method: its name in tables and reports.
        environment: a wrapped `Drive`; else one of `options` is made.
        into: folder of a sweep (`pirrht sweep -o`) that the runs are added to for `pirrht report`; made if there is
            none. Task, plant and time limit must be the sweep's.
        again: replace runs of the same method, scene, noise and seed there; without it they are refused at once.

    Raises:
        OptionError: a seed, option, control or folder is none that fits.
    """
    if environment is not None and options:
        raise OptionError(f"{', '.join(options)}: no argument next to an environment, which has its own; leave it out")
    wanted = list(seeds) if isinstance(seeds, Iterable) else []
    if not wanted:
        raise OptionError(f"seeds is {reprlib.repr(seeds)}; give at least one whole number, as in range(10)")
    env = Drive(**options) if environment is None else environment
    drive = env.unwrapped
    assert isinstance(drive, Drive)
    job = replace(drive.job, method=method, noise=drive.scenario.settings.noise, label=Path(drive.job.scene).stem)
    job = replace(job, digest=runs.digest(*job.place))
    keys = [{**replace(job, seed=SEED.check(seed, "seed")).identity, "plan_seed": 0} for seed in wanted]
    records: list[dict[str, Any]] = []
    into_folder = scores.kept(Path(into), replace(job, method="passive"), keys, again) if into else None
    with into_folder or nullcontext(lambda record: None) as keep:
        for key in keys:
            began, step, over = time.perf_counter(), 0, False
            act: Any = policy(key["seed"]) if anew else policy  # type: ignore[arg-type]
            x, _ = env.reset(seed=key["seed"])
            while not over:
                action = act(x)
                _control(action, env.action_space.shape, f"seed {key['seed']}, step {step}: the policy returned")
                x, _, terminated, truncated, _ = env.step(action)
                step = step + 1
                over = terminated or truncated
            record = runs.finished(key, drive.scenario, drive.result(), time.perf_counter() - began, Planned())
            records.append({**record, "samples": None, "dt": None})  # they are the policy's own affair
            keep(records[-1])
    return records


def _control(action: Any, shape: tuple[int, ...] | None, where: str) -> Array:
    """Return a control as an array of a shape; OptionError, with `where` it came from, unless it is one."""
    try:
        u = np.asarray(action, dtype=float)
    except (TypeError, ValueError):
        u = np.array(np.nan)
    if u.shape != shape or not np.all(np.isfinite(u)):
        raise OptionError(f"{where} {reprlib.repr(action)}; a control is finite and of the shape {shape}")
    return u


def name_of(scene: str) -> str:
    """Gymnasium's name of a built-in scene's environment."""
    return "pirrht/" + "".join(word.capitalize() for word in scene.replace("-", "_").split("_")) + "-v0"


for _scene in scene_names():
    if _scene != "barn":  # its name is that of the challenge
        gymnasium.register(id=name_of(_scene), entry_point="sim.gym:Drive", kwargs={"scene": _scene})
gymnasium.register(id="pirrht/Scene-v0", entry_point="sim.gym:Drive")
gymnasium.register(id="pirrht/Barn-v0", entry_point="sim.gym:Barn")
gymnasium.register(id="pirrht/DynaBarn-v0", entry_point="sim.gym:DynaBarn")
