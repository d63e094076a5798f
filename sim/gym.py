"""The noisy robot as Gymnasium environments, so that other people's controllers drive what ours drive.

Importing this module registers `pirrht/Slit-v0` and so on for every built-in scene, and `pirrht/Scene-v0` for any
other; `gymnasium.make("sim.gym:pirrht/Slit-v0")` imports it.

* Observation: the state x (n,): x, y [m] and of a car the unwrapped heading [rad].
* Action: the control u (m,), held for one period: velocity [m/s] of a point, turn rate over V/rho of a car.
* Reward: -(q + u'Ru/2) dt over the period, less the problem's phi at a collision, or `penalty` where that is infinite.
* `terminated` in the goal or at a collision, `truncated` after `max_time`.
* `info`: outcome ("goal", "collision", "timeout" or None), cost, time [s], min_clearance [m], path_length [m].

`reset(seed=s)` gives the plant the noise that it has under `pirrht run --seed s`.
"""

import reprlib
import time
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.errors import OptionError
from pirrht.outcome import Outcome
from sim.drive.metrics import EpisodeMetrics, Frame, TimedPlan
from sim.extras import require
from sim.mjcf import scene_names
from sim.mjcf.robot import control_limits
from sim.scenario import prepare
from sim.settings import BY_SCENE, BY_SETTING
from sim.sweeps import runs, scores
from sim.sweeps.runs import Job, Planned

require("sim.gym", "gym")
import gymnasium  # noqa: E402 - the line above reports how to install it
from gymnasium.spaces import Box  # noqa: E402

PENALTY = 100.0  # of a collision, where phi is infinite [cost]
OTHERS = {"method", "seed", "plan_seed", "real_time"}  # options of a run that are the policy's, or of `reset`
ARGUMENTS = {*BY_SCENE, *BY_SETTING} - OTHERS
SEED = BY_SETTING["seed"]

Policy = Callable[[Array], Any]  # observation (n,) -> action (m,)


class Drive(gymnasium.Env[Array, Array]):
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
        given = dict.fromkeys(BY_SCENE) | {name: value for name, value in options.items() if value is not None}
        self.job = Job(scene=str(scene), method="", noise=given.get("noise"), seed=0, given=runs.frozen(given))
        self._asked: float | None = None  # when an action was asked for, on the clock [s]
        self.frame: Frame | None = None  # the last period
        self.scenario = s = prepare(scene, given=given)
        self._plant, d = s.plant(), s.problem.dynamics
        self._fall = s.problem.phi if np.isfinite(s.problem.phi) else penalty
        self.observation_space = Box(-np.inf, np.inf, (d.n,), np.float64)
        low = np.full(d.m, -bound)
        high = np.full(d.m, bound)

        if s.settings.plant == "mujoco":
            least, most = control_limits(s.loaded.model, s.loaded.command, d)
            low = np.maximum(low, least)
            high = np.minimum(high, most)
        if not np.all(low < high):
            raise OptionError("the robot's ctrlranges leave no control; widen them, or choose another speed or bound")
        self.action_space = Box(low, high, (d.m,), np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Stand at the start; without a seed one is drawn."""
        super().reset(seed=None if seed is None else SEED.check(seed, "seed"))
        self.seed = int(self.np_random.integers(2**31)) if seed is None else int(seed)
        scenario, s, self.frame = self.scenario, self.scenario.settings, None
        self._rng = scenario.with_settings(seed=self.seed).plant_rng()
        self._plant.reset(scenario.start)
        self._metrics = EpisodeMetrics(scenario, self._plant.state, period=s.period, max_time=s.max_time)
        self._asked = time.perf_counter()
        return self._plant.state, self._info()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
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
        reward = -advance.cost - (self._fall if outcome is Outcome.COLLISION else 0.0)
        self._asked = time.perf_counter() if outcome is None else None
        over = outcome in (Outcome.GOAL, Outcome.COLLISION)
        return self._plant.state, float(reward), over, outcome is Outcome.TIMEOUT, self._info()

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
    gymnasium.register(id=name_of(_scene), entry_point="sim.gym:Drive", kwargs={"scene": _scene})
gymnasium.register(id="pirrht/Scene-v0", entry_point="sim.gym:Drive")
