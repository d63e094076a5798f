"""Rollouts per second, ours and those of JAX and pytorch_mppi, on `slit` with a reference per class.

All hold the same tapes and judge exits at the ends of steps; ours with the defaults, feedback and exits along the
steps, is a row of its own, since no peer offers that.
"""

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from benchmarks import limit, peers
from benchmarks.timing import interleaved, row

from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.proposals.proposal import Batch, Proposal
from pirrht.rollouts.cpu import Cpu
from sim.scenario import Scenario, prepare

NUMBERS = (600, 6000, 60_000)  # rollouts of all classes together
STEPS, DT = 60, 0.1
REPEATS = (31, 15, 7)
WITHIN = 3.0  # standard errors
PEERS = {"jitted JAX": ("jax", peers.jax_rollouts), "pytorch_mppi": ("pytorch_mppi", peers.torch_rollouts)}
OURS, DEFAULT = "ours, paper's kernel", "ours, default"
Result = tuple[list[list[str]], dict[str, Any]]


class Setting:
    """One scene, its references, and both of our kernels."""

    def __init__(self, scene: str) -> None:
        self.paper = prepare(scene, preset="paper", given={"weights": "balance"})
        self.default = prepare(scene)
        references = self.paper.grown_tree().references(self.paper.start)
        self.times = np.arange(STEPS + 1) * DT
        self.trajectories = [reference.trajectory for reference in references]
        self.tapes = np.array([trajectory.tape(self.times) for trajectory in self.trajectories])
        self.kernels = {OURS: _integral(self.paper), DEFAULT: _integral(self.default)}

    @property
    def H(self) -> int:
        """Number of references."""
        return len(self.tapes)

    def task(self) -> peers.Task:
        """The same for a peer."""
        problem = self.paper.problem
        return peers.Task(
            start=self.paper.start, tapes=self.tapes, dt=DT, noise=self.paper.settings.noise,
            temperature=problem.temperature, rate=problem.least_rate, field=self.paper.space.field,
            goal=problem.scene.goal,
        )  # fmt: skip

    def estimate(self, kernel: str, samples: int, seed: int) -> Estimate:
        """Sample and weigh."""
        integral, x = self.kernels[kernel], self.paper.start
        leads = integral.proposals.controls(x, self.times, self.trajectories, drops=False)
        proposals = tuple(Proposal(lead=lead, count=samples // self.H) for lead in leads)
        return integral.estimate(integral.rollout(Batch(state=x, times=self.times, proposals=proposals), seed))


def _integral(scenario: Scenario) -> PathIntegral:
    integral = path_integral(scenario.problem, scenario.space, scenario.sampling)
    integral.warm_up()
    return integral


def rows(options: argparse.Namespace) -> Result:
    """Table and JSON of rollouts, limit and threads."""
    setting = Setting(options.scene or "slit")
    table: list[list[str]] = []
    values: dict[str, Any] = {"references": setting.H, "noise": setting.paper.settings.noise}
    for number, repeats in zip(NUMBERS, REPEATS, strict=True):
        found, values[str(number)] = _compare(setting, number - number % setting.H, repeats)
        table += found
    found, values["limit"] = _limit(setting)
    same = _same_on_threads(setting)
    values["same_on_1_and_2_threads"] = same
    return [*table, *found, ["1 and 2 threads", *5 * "-", "identical" if same else "DIFFERENT"]], values


def _compare(setting: Setting, samples: int, repeats: int) -> Result:
    """One number of rollouts: medians of ours and the peers', taking turns."""
    work: dict[str, Callable[[int], Any]] = {name: partial(setting.estimate, name, samples) for name in setting.kernels}
    absent = [name for name, (module, _) in PEERS.items() if peers.missing(module)]
    for name, (_, build) in PEERS.items():
        if name not in absent:
            work[name] = build(setting.task(), samples)
    seconds = interleaved(work, repeats, warm=True)
    table, values = [], {}
    for name, spent in seconds.items():
        own = name in setting.kernels
        figures = _ours(setting, name, samples, spent) if own else _peer(setting, work[name], samples)
        ess = float(np.median([work[name](seed).ess for seed in range(repeats)]))
        values[name] = {"seconds": spent, "over_ours": spent / seconds[OURS], "ess": ess, **figures}
        rate = f"{figures['steps_per_second'] / 1e6:.1f} M steps/s" if "steps_per_second" in figures else "-"
        columns = {"rate": rate, "effective": f"{ess / spent:.3g}", "note": f"ESS {ess:.0f}, {_note(figures)}"}
        table.append(row(f"{samples} rollouts: {name}", spent, spent / seconds[OURS], **columns))
    table += [[f"{samples} rollouts: {name}", *5 * "-", peers.HINT] for name in absent]
    return table, values


def _ours(setting: Setting, name: str, samples: int, seconds: float) -> dict[str, Any]:
    estimate = setting.estimate(name, samples, 0)
    steps = int(estimate.rollouts.paths.steps.sum())
    return {
        "steps": steps,
        "steps_per_second": steps / seconds,
        "goal_share": estimate.survivors / samples,
        "log_psi": estimate.log_psi,
    }


def _peer(setting: Setting, work: Callable[[int], Any], samples: int) -> dict[str, Any]:
    """A peer's answer and how far it is from ours, in standard errors of the difference."""
    answer, ours = work(0), setting.estimate(OURS, samples, 0)
    share = ours.survivors / samples
    error = np.sqrt(2.0 * max(share * (1.0 - share), 1.0 / samples) / samples)
    figures = {"goal_share": answer.goal_share, "off": abs(answer.goal_share - share) / error}
    if answer.log_psi is not None:
        error = np.sqrt(2.0) * ours.value_error / setting.paper.problem.temperature
        figures |= {"log_psi": answer.log_psi, "log_psi_off": abs(answer.log_psi - ours.log_psi) / error}
    return {**figures, "agrees": bool(figures["off"] <= WITHIN)}


def _note(figures: dict[str, Any]) -> str:
    said = f"{100 * figures['goal_share']:.1f} % reach the goal"
    return said if "off" not in figures else f"{said} ({figures['off']:.1f} s.e. from ours)"


def _limit(setting: Setting) -> Result:
    """Time per step of what no rollout can do without, on as many threads as ours."""
    integral, samples = setting.kernels[OURS], NUMBERS[-1]
    threads, setup = integral.threads, integral.setup
    work: dict[str, Callable[[int], int]] = {
        "two normals": lambda _: limit.normals(samples, threads),
        "two normals and the arithmetic": lambda _: limit.steps(
            setup.world, integral.homology.table, setting.H, samples, threads
        ),
    }
    seconds = interleaved(work, 5, warm=True)
    rates = {name: work[name](0) / spent for name, spent in seconds.items()}
    table = [
        row(f"limit: {name}", seconds[name], rate=f"{rate / 1e6:.1f} M steps/s", note=f"{1e9 / rate:.2f} ns a step")
        for name, rate in rates.items()
    ]
    return table, {name: {"steps_per_second": rate, "threads": threads} for name, rate in rates.items()}


def _same_on_threads(setting: Setting) -> bool:
    """Whether both kernels draw the same paths on one thread and on two."""
    same = True
    for name, integral in setting.kernels.items():
        kept, found = integral.backend, []
        for threads in (1, 2):
            integral.backend = Cpu.of(integral.problem, integral.setup, integral.homology.table.kernels, threads)
            found.append(setting.estimate(name, 6000, 0))
        integral.backend = kept
        one, two = (estimate.rollouts.paths for estimate in found)
        same &= all(np.array_equal(getattr(one, field), getattr(two, field)) for field in one._fields)
        same &= bool(np.array_equal(found[0].weight, found[1].weight))
    return same
