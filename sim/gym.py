"""The noisy robot as Gymnasium environments, so that other people's controllers drive what ours drive.

Importing this module registers `pirrht/Slit-v0`, `pirrht/Clutter-v0` and so on for every built-in scene, and
`pirrht/Scene-v0` for any other: Gymnasium looks for no plugins since version 1.0, so import it, or name it, as in
`gymnasium.make("sim.gym:pirrht/Slit-v0")`.

* Observation: the state x (n,): x, y [m] and of a car the unwrapped heading [rad].
* Action: the control u (m,), held for one period: velocity [m/s] of a point, turn rate over V/rho of a car.
* Reward: -(q + u'Ru/2) dt, summed over the period; at a collision also the problem's phi is taken off, or `penalty`
  where that is infinite.
* `terminated` in the goal or at a collision, `truncated` after `max_time`.
* `info`: outcome ("goal", "collision", "timeout" or None), cost, time [s], min_clearance [m], path_length [m]
  (without the path's noise, as `pirrht run` tells it).

`reset(seed=s)` gives the plant the noise that it has under `pirrht run --seed s`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control import policy as control
from pirrht.control.plan import Plan
from pirrht.errors import OptionError
from pirrht.outcome import Outcome
from sim.drive.episode import Tally
from sim.drive.odometer import Frame, Odometer
from sim.drive.result import DriveResult
from sim.mjcf import scene_names
from sim.mjcf.robot import control_limits
from sim.scenario import prepare
from sim.settings import BY_SCENE
from sim.sweeps import runs, scores
from sim.sweeps.runs import Job

try:
    import gymnasium
    from gymnasium.spaces import Box
except ImportError:
    raise OptionError("environments need Gymnasium; install it with `pip install 'pirrht[gym]'`") from None

PENALTY = 100.0  # of a collision, where phi is infinite [cost]
SETTINGS = ("noise", "period", "max_time", "plant", "phi")  # of a run, that an environment has

Policy = Callable[[Array], Any]  # observation (n,) -> action (m,)


class Drive(gymnasium.Env[Array, Array]):
    """One robot in one scene.

    Args:
        scene: built-in name or MJCF file.
        penalty: taken off at a collision where phi is infinite.
        bound: actions are clipped to [-bound, bound], and to what the robot's ctrlranges allow; infinite by default,
            but learners like a finite one.
        options: fields of `SceneOptions` but preset, and noise b, period [s], max_time [s], plant and phi of
            `Settings`; without them the scene or the robot decides.

    Raises:
        SceneError, OptionError: with one line for a person.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        scene: str | Path = "slit",
        *,
        penalty: float = PENALTY,
        bound: float = np.inf,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        if render_mode is not None:
            raise OptionError(f"render_mode is {render_mode!r}; there is none: film drives with `pirrht run --video`")
        if not bound > 0 or not penalty >= 0:
            raise OptionError(f"bound is {bound:g} and penalty {penalty:g}; they must be positive, and 0 or more")
        given = {name: options.pop(name) for name in SETTINGS if options.get(name) is not None}
        task = {name: options.pop(name, None) for name in BY_SCENE if name != "preset"} | {"preset": None}
        task["freeze"] = task["freeze"] or None
        if strange := options.keys() - set(SETTINGS):
            raise OptionError(f"{', '.join(sorted(strange))}: no argument of an environment")
        self.scenario = prepare(scene, **task, given=given)
        self.job = Job(
            scene=str(scene), method="", noise=given.get("noise"), seed=0, task=runs.frozen(task),
            given=runs.frozen(given),
        )  # fmt: skip
        phi_or = self.scenario.problem.phi
        self._fall = phi_or if np.isfinite(phi_or) else penalty
        self._plant = self.scenario.plant()
        d = self.scenario.problem.dynamics
        self.render_mode = None
        self.observation_space = Box(-np.inf, np.inf, (d.n,), np.float64)
        low, high = np.full(d.m, -bound), np.full(d.m, bound)
        if self.scenario.settings.plant == "mujoco":
            least, most = control_limits(self.scenario.loaded.model, self.scenario.loaded.command, d)
            low, high = np.maximum(low, least), np.minimum(high, most)
        if not np.all(low < high):
            raise OptionError("the robot's ctrlranges leave no control; widen them, or choose another speed or bound")
        self.action_space = Box(low, high, (d.m,), np.float64)
        self._frame: Frame | None = None
        self._tally: Tally | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Stand at the start; without a seed one is drawn.

        Raises:
            OptionError: the seed is negative or no whole number.
        """
        if seed is not None:
            seed = _seed(seed)
        super().reset(seed=seed)
        self.seed = int(self.np_random.integers(2**31)) if seed is None else seed
        self._rng = self.scenario.with_settings(seed=self.seed).plant_rng()
        self._plant.reset(self.scenario.start)
        self._tally, self._frame = Tally(self.scenario.settings.period), None
        problem, space = self.scenario.problem, self.scenario.space
        self._odometer = Odometer(
            problem, space, self._plant.state, self.scenario.settings.max_time, homology=self.scenario.homology
        )
        self._asked = time.perf_counter()
        return self._plant.state, self._info()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold a control for one period.

        Raises:
            OptionError: before `reset`, after the end, or the action is no control.
        """
        thought = time.perf_counter() - self._asked if self._tally is not None else 0.0
        if self._tally is None or (self._frame is not None and self._frame.outcome is not None):
            raise OptionError("the drive has not begun or is over; call reset() first")
        wanted, m = np.asarray(action, dtype=float), self.scenario.problem.dynamics.m
        if wanted.shape != (m,) or not np.all(np.isfinite(wanted)):
            raise OptionError(f"the action is {wanted.tolist()}; it must be {m} finite numbers")
        u = np.clip(wanted, self.action_space.low, self.action_space.high)  # type: ignore[attr-defined]
        self._frame = self._held(u, thought)
        self._tally.add(self._frame)
        outcome = self._frame.outcome
        reward = -self._frame.advance.cost - (self._fall if outcome is Outcome.COLLISION else 0.0)
        self._asked = time.perf_counter()
        over = outcome in (Outcome.GOAL, Outcome.COLLISION)
        return self._plant.state, float(reward), over, outcome is Outcome.TIMEOUT, self._info()

    def result(self) -> dict[str, Any]:
        """Return the figures of this run so far, as `pirrht run --json` has them."""
        return self.figures().json()

    def figures(self) -> DriveResult:
        """Return the figures of this run so far as a record.

        Raises:
            OptionError: nothing has been driven yet.
        """
        if self._tally is None or self._frame is None:
            raise OptionError("nothing has been driven yet; call reset() and step() first")
        return self._tally.drive()

    def _held(self, u: Array, thought: float) -> Frame:
        """The next period as the frame of a drive."""
        x, times = self._plant.state, np.array([0.0, self.scenario.settings.period])
        plan = Plan(state=x, times=times, references=(), ids=(), estimate=None, fallback=None, instead=u[None])
        return self._odometer.frame(plan, self._plant.advance(lambda x, s: u, self._rng), seconds=thought)

    def _info(self) -> dict[str, Any]:
        frame = self._frame
        if frame is None or self._tally is None:
            clearance = self.scenario.space.clearance(self._plant.state)
            return {"outcome": None, "cost": 0.0, "time": 0.0, "min_clearance": clearance, "path_length": 0.0}
        return {
            "outcome": None if frame.outcome is None else frame.outcome.name.lower(),
            "cost": frame.cost,
            "time": frame.end_time,
            "min_clearance": self._tally.min_clearance,
            "path_length": frame.length,
        }


class Following:
    """A controller of this package as a policy, which may be asked more often than it plans.

    In an environment whose period is the physics step it makes the drive that `pirrht run` makes, feedback between
    plans included.

    Args:
        driver: `Scenario.controller` or `Scenario.optimal`.
        period: of its plans [s].
        step: period of the environment [s].
    """

    def __init__(self, driver: control.Policy, *, period: float, step: float) -> None:
        self.driver, self.period, self.step = driver, period, step
        self._plan: Plan | None = None

    def __call__(self, x: Array) -> Array:
        """The control at state x (n,), a step after the last one."""
        each = round(self.period / self.step)
        if self._plan is None:
            self.driver.begin(x)
            self._since: list[Array] = []
        else:
            self._since.append(x)
        if self._plan is None or len(self._since) == each:
            if self._since:
                self.driver.observe(np.array(self._since), len(self._since) * self.step)
            self._plan, self._since = self.driver.plan(x), []
        return self._plan.at(x, len(self._since) * self.step)


def score(
    policy: Policy | Callable[[int], Policy],
    *,
    seeds: Iterable[int],
    method: str,
    anew: bool = False,
    environment: gymnasium.Env[Any, Any] | None = None,
    into: str | Path | None = None,
    again: bool = False,
    **options: Any,
) -> list[dict[str, Any]]:
    """Drive a policy once per seed; one record each, as those of `pirrht sweep`.

    Args:
        policy: takes the state x (n,) and returns the control u (m,), held for one period; with `anew` a function
            that takes a seed and makes such a policy. (Of a wrapped environment: its observation, its action.)
        seeds: one drive each, whole numbers from 0 on.
        method: what tables and reports call it.
        environment: a wrapped `Drive`; without it one of `options` is made.
        into: folder of a sweep (`pirrht sweep -o`) that the drives are added to, so that `pirrht report` shows the
            method beside ours; made if there is none. Task, plant and time limit must be the sweep's.
        again: replace drives of the same method, scene, noise and seed that the folder holds; without it they are
            refused before anything is driven.

    Returns:
        records that `sim.sweeps.parts` makes rows of a dataset of.

    Raises:
        OptionError: a negative seed, a policy whose control has another shape or is not finite, or a folder that the
            drives cannot be added to.
    """
    env = Drive(**options) if environment is None else environment
    made: Callable[[int], Any] = policy if anew else lambda seed: policy  # type: ignore[assignment]
    drive = env.unwrapped
    assert isinstance(drive, Drive)
    job = replace(drive.job, method=method, noise=drive.scenario.settings.noise)
    identities = [_identity(replace(job, seed=_seed(seed))) for seed in seeds]
    if into is None or not identities:
        return [_scored(env, made(one["seed"]), one) for one in identities]
    found = []
    with scores.kept(Path(into), replace(job, method="passive"), identities, again) as keep:
        for one in identities:
            found.append(_scored(env, made(one["seed"]), one))
            keep(found[-1])
    return found


def _identity(job: Job) -> dict[str, Any]:
    """Return the key of a run, scene and trees included."""
    return {**runs.key(job, job.noise), "scene": Path(job.scene).stem, "scene_digest": runs.digest(job), "plan_seed": 0}


def _scored(env: gymnasium.Env[Any, Any], policy: Any, identity: dict[str, Any]) -> dict[str, Any]:
    """The record of one drive."""
    drive, seed = env.unwrapped, identity["seed"]
    assert isinstance(drive, Drive)
    began = time.perf_counter()
    x, _ = env.reset(seed=seed)
    over, step = False, 0
    while not over:
        action = policy(x)
        _check_action(action, env.action_space, f"seed {seed}, step {step}")
        x, _, terminated, truncated, _ = env.step(action)
        step += 1
        over = terminated or truncated
    record = runs.finished(identity, drive.scenario, drive.figures(), time.perf_counter() - began)
    return {**record, "samples": None, "dt": None}  # they are the policy's own affair


def _check_action(action: Any, space: Any, where: str) -> None:
    """Refuse what no environment with a box of actions could hold."""
    if not isinstance(space, Box):
        return
    try:
        u = np.asarray(action, dtype=float)
    except (TypeError, ValueError):
        u = np.full(0, np.nan)
    if u.shape != space.shape:
        found = f"the shape {u.shape}" if u.size else f"{action!r}"
        raise OptionError(f"{where}: the policy returned {found}; expected is a control of the shape {space.shape}")
    if not np.all(np.isfinite(u)):
        raise OptionError(f"{where}: the policy returned {u.tolist()}; a control must be finite")


def _seed(seed: int) -> int:
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise OptionError(f"seed is {seed}; it must be a whole number of at least 0")
    return int(seed)


def name_of(scene: str) -> str:
    """Gymnasium's name of a built-in scene's environment."""
    return "pirrht/" + "".join(word.capitalize() for word in scene.replace("-", "_").split("_")) + "-v0"


for _scene in scene_names():
    gymnasium.register(id=name_of(_scene), entry_point="sim.gym:Drive", kwargs={"scene": _scene})
gymnasium.register(id="pirrht/Scene-v0", entry_point="sim.gym:Drive")
