"""Drives of other people's controllers as rows of a sweep's dataset, so that its report shows them next to ours."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.errors import OptionError
from sim.sweeps import runs
from sim.sweeps.dataset import Dataset
from sim.sweeps.parts import key_of
from sim.sweeps.runs import Job

PLANT = ("max_time", "plant", "phi", "speed", "rho")  # settings by which drives of any controller must agree
Record = Mapping[str, Any]


@contextmanager
def kept(folder: Path, job: Job, identities: Sequence[Record], again: bool) -> Iterator[Callable[[Record], bool]]:
    """Yield what adds records to a sweep's folder as runs of the job end; all are written when it is left.

    Args:
        folder: made if need be; of an existing sweep task and plant must be the same.
        job: the drives' task; seed and method are the identities' affair.
        identities: the keys of what will be driven.
        again: whether runs that are there already are replaced; otherwise they are refused.

    Raises:
        OptionError: another task, runs that are there already, or a folder that cannot be written.
    """
    dataset = Dataset(folder)
    settings = _agreed(dataset, job)
    dataset.check(settings, {})
    with dataset.locked():
        known = {key_of(record) for record in dataset.records()}
        twice = [one for one in identities if key_of(one) in known]
        if twice and not again:
            held = f"{len(twice)} of these runs already (method {twice[0]['method']!r}, seed {twice[0]['seed']})"
            raise OptionError(f"{folder} holds {held}; give them another name, or again=True to replace them")
        seeds = np.unique([int(one["seed"]) for one in identities])
        stretches = np.split(seeds, np.flatnonzero(np.diff(seeds) > 1) + 1)
        wish = {"methods": [identities[0]["method"]], "noise": {job.label: [job.noise]}}
        wishes = ({**wish, "seeds": [int(known[0]), int(known[-1]) + 1]} for known in stretches)
        dataset.begin(settings, {job.label: job.digest}, *wishes)
        try:
            yield dataset.add
        finally:
            dataset.compact()


def _agreed(dataset: Dataset, job: Job) -> dict[str, Any]:
    """The settings of a folder, which must mean the same task and plant; those of the job if it holds no sweep yet."""
    if not dataset.file.exists():
        known = {name: value for name, value in job.given if name != "noise"}  # it is each run's own
        return {**known, "plan_seed": 0}
    settings: dict[str, Any] = dataset.manifest()["settings"]
    here = _meaning(job)
    for name, asked in _meaning(replace(job, given=runs.frozen(settings))).items():
        if asked != here[name]:
            raise OptionError(
                f"{dataset.folder} was made with --{name.replace('_', '-')} {asked} and these drives are with "
                f"{here[name]}; choose another folder"
            )
    return settings


def _meaning(job: Job) -> dict[str, Any]:
    """Plant and task of a job, by option, whether they were given or follow from the scene."""
    scenario = runs.settled(job)
    scene = scenario.loaded.scene
    start, goal = (" ".join(map(str, values)) for values in (scenario.start, (*scene.goal.center, scene.goal.radius)))
    task = {"robot": scenario.loaded.robot, "radius": scene.robot_radius, "start": start, "goal": goal}
    if not scene.body.is_disc:
        task |= {"footprint": str(scene.body.corners)}
    return {name: getattr(scenario.settings, name) for name in PLANT} | task
