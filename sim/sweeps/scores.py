"""Drives of other people's controllers as rows of a sweep's dataset, so that its report shows them beside ours."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.errors import OptionError
from sim.scenario import Scenario
from sim.settings import BY_SCENE
from sim.sweeps import runs
from sim.sweeps.dataset import Dataset
from sim.sweeps.parts import key_of
from sim.sweeps.runs import Job
from sim.text import counted

PLANT = ("max_time", "plant", "phi", "speed", "rho")  # settings by which drives of any controller must agree

Keep = Callable[[Mapping[str, Any]], None]  # takes a record


@contextmanager
def kept(folder: Path, job: Job, identities: Sequence[Mapping[str, Any]], again: bool) -> Iterator[Keep]:
    """Yield what adds records to a sweep's folder as runs of the job end; they are written at the latest when it is
    left.

    Args:
        folder: made if need be; of an existing sweep task and plant must be the same.
        job: the drives' task; seed and method are the identities' affair.
        identities: the keys of what will be driven.
        again: whether runs that are there already are replaced; otherwise they are refused.

    Raises:
        OptionError: another task, runs that are there already, or a folder that cannot be written.
    """
    dataset, scenario = Dataset(folder), runs.settled(job)
    settings = _agreed(dataset, job, scenario)
    known, keys = {key_of(record) for record in dataset.records()}, {key_of(one) for one in identities}
    twice = [one for one in identities if key_of(one) in known]
    if twice and not again:
        first = f"method {twice[0]['method']!r}, seed {twice[0]['seed']}"
        raise OptionError(
            f"{folder} holds {counted(len(twice), 'of these runs', 'of these runs')} already ({first}); give them "
            "another name, or again=True to replace them"
        )
    scene, digest, method = (identities[0][name] for name in ("scene", "scene_digest", "method"))
    seeds = [int(one["seed"]) for one in identities]
    dataset.ask(settings, {scene: digest}, _wishes(method, scene, scenario.settings.noise, seeds))
    done: set[tuple[Any, ...]] = set()

    def keep(record: Mapping[str, Any]) -> None:
        dataset.add(record)
        done.add(key_of(record))
        if not again:
            dataset.tend()

    try:
        yield keep
    finally:
        dataset.replace(done & keys) if again else dataset.flush()


def _agreed(dataset: Dataset, job: Job, scenario: Scenario) -> dict[str, Any]:
    """The settings of a folder, which must mean the same task and plant; those of the job if it holds no sweep yet."""
    if not (dataset.folder / "manifest.json").exists():
        given = {name: value for name, value in job.given if name != "noise"}  # it is each run's own
        return {**dict(job.task), **given, "plan_seed": 0}
    settings: dict[str, Any] = dataset.manifest()["settings"]
    theirs = runs.settled(_under(job, settings))
    for name in PLANT:
        asked, here = getattr(theirs.settings, name), getattr(scenario.settings, name)
        if asked != here:
            raise _other(dataset, f"--{name.replace('_', '-')}", asked, here)
    asked, here = _task(theirs), _task(scenario)
    for name in asked:
        if not np.array_equal(asked[name], here[name]):
            raise _other(dataset, f"--{name}", *(" ".join(map(str, np.ravel(task[name]))) for task in (asked, here)))
    return settings


def _under(job: Job, settings: Mapping[str, Any]) -> Job:
    """Return the job with the task and the settings of a manifest."""
    values = {name: tuple(value) if isinstance(value, list) else value for name, value in settings.items()}
    return replace(
        job,
        task=tuple((name, values.get(name)) for name in BY_SCENE),
        given=tuple((name, value) for name, value in values.items() if name not in BY_SCENE),
    )


def _task(scenario: Scenario) -> dict[str, Any]:
    scene = scenario.loaded.scene
    goal = [*scene.goal.center.tolist(), scene.goal.radius]
    return {"robot": scenario.loaded.robot, "radius": scene.robot_radius, "start": scenario.start, "goal": goal}


def _other(dataset: Dataset, option: str, asked: Any, here: Any) -> OptionError:
    return OptionError(
        f"{dataset.folder} was made with {option} {asked} and these drives are with {here}; choose another folder"
    )


def _wishes(method: str, scene: str, noise: float, seeds: Sequence[int]) -> Iterator[dict[str, Any]]:
    """Drives of one method as entries of "asked", one per stretch of seeds."""
    known = np.unique(seeds)
    for stretch in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        yield {"methods": [method], "noise": {scene: [noise]}, "seeds": [int(stretch[0]), int(stretch[-1]) + 1]}
