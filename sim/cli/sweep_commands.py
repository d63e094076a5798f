"""Commands `pirrht sweep` and `pirrht report`."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pirrht.errors import OptionError, printable
from pirrht.files import path_text
from sim.cli import tables
from sim.files import check_writable, refused, write_json
from sim.options import table as options
from sim.text import counted, width

SHOWN = 3  # errors that are told on the terminal


def sweep(arguments: argparse.Namespace) -> int:
    """Many seeds, methods and noise levels: a table on the terminal, and rows on disk."""
    from sim.sweeps import sweep as engine

    if arguments.json is not None:
        check_writable(arguments.json, "--json")
    grid = parse_grid(arguments)
    if arguments.scheduler is not None:
        from sim.sweeps import cluster

        cluster.check_address(arguments.scheduler)
    if arguments.output is not None:
        records = _stored(grid, arguments)
    elif arguments.again:
        raise OptionError("--again makes runs of a dataset anew; add its folder, -o DIR")
    else:
        records = engine.sweep(grid.jobs(), jobs_at_once=arguments.jobs, scheduler=arguments.scheduler)
    print(tables.sweep_table(records, width()))
    if arguments.json:
        write_json(arguments.json, records)
    errors = [str(record["error"]) for record in records if record["outcome"] is None]
    if arguments.output is not None:
        print(
            f"{path_text(arguments.output)}: {counted(len(records), 'run')}, {len(errors)} of them ended with an error"
        )
    _tell(errors, stored=arguments.output is not None)
    return 1 if errors else 0


def parse_grid(arguments: argparse.Namespace) -> Any:
    """The grid of a command line.

    Raises:
        OptionError: an option that cannot work, or too many runs.
    """
    from sim.sweeps import grid

    said = vars(arguments)
    return grid.parse(
        scenes=arguments.scenes,
        methods=arguments.methods,
        noise=arguments.noise,
        seeds=arguments.seeds,
        task=options.task(said),
        given=options.settings("sweep", said),
    )


def _tell(errors: Sequence[str], *, stored: bool) -> None:
    """The most frequent errors, and how to try again."""
    if not errors:
        return
    known = Counter((error.splitlines() or [""])[0] for error in errors).most_common()
    lines = [f"{counted(len(errors), 'run')} ended with an error:"]
    lines += [f"  {count} x {printable(error)}" for error, count in known[:SHOWN]]
    if len(known) > SHOWN:
        lines.append(f"  and {counted(len(known) - SHOWN, 'other error')}")
    if stored:
        lines.append(f"the same command with --again makes {'it' if len(errors) == 1 else 'them'} anew")
    print("\n".join(lines), file=sys.stderr)


def _stored(grid: Any, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """The records of a sweep whose finished runs a folder keeps."""
    from sim.sweeps import sweep as engine
    from sim.sweeps.dataset import Dataset

    folder: Path = arguments.output
    dataset = Dataset(folder)
    dataset.check(grid.settings, {})
    jobs = engine.checked(grid.jobs())
    scenes = {job.name: job.digest for job in jobs}
    noises: dict[str, list[float | None]] = {}
    for job in jobs:
        of_scene = noises.setdefault(job.name, [])
        if job.noise not in of_scene:
            of_scene.append(job.noise)
    asked = {"methods": list(grid.methods), "noise": noises, "seeds": [grid.seeds.start, grid.seeds.stop]}
    dataset.check(grid.settings, scenes)
    with dataset.locked():
        dataset.begin(grid.settings, scenes, asked)
        if arguments.again:
            dataset.forget_errors()
        return engine.sweep(jobs, jobs_at_once=arguments.jobs, scheduler=arguments.scheduler, dataset=dataset)


def report(arguments: argparse.Namespace) -> int:
    """Sum up a sweep: on the terminal, as Markdown and as a page."""
    from pirrht.files import replaced
    from sim.report import summary as engine
    from sim.report.plots import pictures
    from sim.report.wording import markdown, page, terminal
    from sim.sweeps.dataset import Dataset

    folder: Path = arguments.output or arguments.folder
    if arguments.output is not None and folder.is_file():
        raise OptionError(f"--output {folder} is a file; give the path of a folder")
    text, web = folder / "report.md", folder / "report.html"
    known = engine.report(Dataset(arguments.folder), _watched)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # ValueError: a name that is no text
        raise refused("--output", folder, error) from None
    for option, file in (("--output", text), ("--output", web), ("--json", arguments.json)):
        if file is not None:
            check_writable(file, option)
    try:
        drawn = pictures(known, _watched)
    except OptionError as error:
        drawn = []
        print(f"pirrht: {error}; report.html has no pictures", file=sys.stderr)
    print(terminal(known))
    for file, content in ((text, markdown(known)), (web, page(known, drawn))):
        with replaced(file, "--output") as stream:
            stream.write(content.encode())
        print(f"written: {path_text(file)}")
    if arguments.json is not None:
        write_json(arguments.json, known.json())
    return 0


def _watched(what: str, items: Sequence[Any]) -> Iterable[Any]:
    """The items, with a line on a terminal that says how many of them are done."""
    watched: Iterable[Any] = tqdm(items, desc=what, leave=False, disable=None, dynamic_ncols=True)
    return watched
