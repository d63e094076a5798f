"""What `pirrht sweep` and `pirrht report` do."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pirrht.errors import OptionError
from sim import present


def sweep(arguments: argparse.Namespace) -> int:
    """Many seeds, methods and noise levels: a table on the terminal, and rows on disk."""
    from sim.sweeps import sweep as engine

    if arguments.json is not None:
        present.check_writable(arguments.json, "--json")
    grid = engine.parse_grid(arguments)
    if arguments.output is not None:
        records = _stored(grid, arguments)
    elif arguments.again:
        raise OptionError("--again makes runs of a dataset anew; add its folder, -o DIR")
    else:
        records = engine.sweep(grid.jobs(), jobs_at_once=arguments.jobs, scheduler=arguments.scheduler)
    print(engine.summary(records, present.width()))
    if arguments.json:
        present.write_json(arguments.json, records)
    errors = sum(record["outcome"] is None for record in records)
    if arguments.output is not None:
        print(f"{arguments.output}: {len(records)} runs, {errors} of them ended with an error")
    return 1 if errors else 0


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
    from sim.files import replaced
    from sim.sweeps import report as engine
    from sim.sweeps import report_text
    from sim.sweeps.dataset import Dataset
    from sim.sweeps.report_html import page
    from sim.sweeps.report_pictures import pictures

    folder: Path = arguments.output or arguments.folder
    text, web = folder / "report.md", folder / "report.html"
    known = engine.report(Dataset(arguments.folder))
    for option, file in (("--output", text), ("--output", web), ("--json", arguments.json)):
        if file is not None:
            present.check_writable(file, option)
    try:
        drawn = pictures(known)
    except OptionError as error:
        drawn = []
        print(f"pirrht: {error}; report.html has no pictures", file=sys.stderr)
    print(report_text.terminal(known))
    for file, content in ((text, report_text.markdown(known)), (web, page(known, drawn))):
        with replaced(file, "--output") as stream:
            stream.write(content.encode())
        print(f"written: {file}")
    if arguments.json is not None:
        present.write_json(arguments.json, known.json())
    return 0
