"""Grid of a sweep: scenes, methods, noise levels and seeds, of which every combination is a run."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pirrht.control.settings import METHODS
from pirrht.errors import OptionError, printable
from sim import options
from sim.mjcf import scene_names
from sim.settings import BY_SETTING, IDENTIFYING, SEED, refuse_unused
from sim.sweeps.runs import Frozen, Job, frozen

MOST_RUNS = 1_000_000  # jobs and records of so many fit into some gigabytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Runs that a command line asks for."""

    scenes: tuple[str, ...]
    methods: tuple[str, ...]
    noises: tuple[float | None, ...]  # None: what the scene asks for
    seeds: range
    task: Frozen
    given: Frozen

    def __post_init__(self) -> None:
        for option, values in (("SCENE", self.scenes), ("--methods", self.methods), ("--noise", self.noises)):
            twice = [value for i, value in enumerate(values) if value in values[:i]]
            if twice:
                raise OptionError(f"{option} names {twice[0]} twice; every combination is one run: leave one out")
        if self.size > MOST_RUNS:
            raise OptionError(
                f"{self.size} runs are asked for, and a sweep has {MOST_RUNS} at most; ask for fewer --seeds at a "
                "time: the same -o DIR takes the others later"
            )

    @property
    def size(self) -> int:
        """Number of runs; `len(seeds)` alone knows no more than a machine word."""
        return len(self.scenes) * len(self.methods) * len(self.noises) * (self.seeds.stop - self.seeds.start)

    def jobs(self) -> list[Job]:
        """All combinations, by scene, noise, method and seed."""
        return [
            Job(
                scene=scene,
                method=method,
                noise=noise,
                seed=seed,
                task=self.task,
                given=self._given(noise),
                label=label,
            )
            for scene, label in zip(self.scenes, labels(self.scenes), strict=True)
            for noise in self.noises
            for method in self.methods
            for seed in self.seeds
        ]

    def _given(self, noise: float | None) -> Frozen:
        """Settings of the runs of a noise level: that decides on the margin where a risk does."""
        known = dict(self.given).get("risk") is not None and noise is not None
        return (*self.given, ("noise", noise)) if known else self.given

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that all runs share and results depend on, by option."""
        return {name: value for name, value in (*self.task, *self.given) if name in IDENTIFYING}


def parse(words: Mapping[str, Any]) -> Grid:
    """Return the grid of a parsed command line.

    Args:
        words: scenes; methods and noise levels with commas between them, None for the noise of each scene; seeds as
            `A:B` for A to B-1, or one seed; scene options and settings that all runs share, None where not given.

    Raises:
        OptionError: an unknown method, seeds or noise that are no numbers, a value twice, too many runs.
    """
    given = options.settings("sweep", words)
    names = tuple(name.strip() for name in words["methods"].split(","))
    for name in names:
        if name not in METHODS:
            raise OptionError(f"--methods names {name!r}; known are {', '.join(METHODS)}")
    refuse_unused(given, names)
    return Grid(
        scenes=tuple(words["scenes"]),
        methods=names,
        noises=(None,) if words["noise"] is None else tuple(noises_of(words["noise"])),
        seeds=seeds_of(words["seeds"]),
        task=frozen(options.scene_options(words)),
        given=frozen(given),
    )


def noises_of(text: str) -> Iterator[float]:
    """Noise levels as in 0.1,0.3; OptionError if one is no positive number."""
    for part in text.split(","):
        try:
            level = float(part)
        except ValueError:
            raise OptionError(f"--noise: {part!r} is no number; write for instance 0.1,0.3") from None
        yield BY_SETTING["noise"].check(level)


def seeds_of(text: str) -> range:
    """Seeds as in 0:100, or one; OptionError if it is no range, empty, or beyond what a dataset can hold."""
    first, _, last = text.partition(":")
    try:
        start, stop = int(first), int(last) if last else int(first) + 1
    except ValueError:
        raise OptionError(f"--seeds: {text[:60]!r} is no range; write for instance 0:100") from None
    if start < 0 or stop <= start:
        raise OptionError(f"--seeds: {text[:60]!r} holds no seed; write for instance 0:100")
    if stop - 1 > SEED:
        raise OptionError(f"--seeds: {text[:60]!r} goes beyond {SEED}, the largest seed; write smaller ones")
    return range(start, stop)


def labels(scenes: Sequence[str]) -> list[str]:
    """Names of built-in scenes, and of files where they differ."""
    stems = [printable(scene if scene in scene_names() else Path(scene).stem) for scene in scenes]
    return [stem if stems.count(stem) == 1 else printable(scene) for scene, stem in zip(scenes, stems, strict=True)]
