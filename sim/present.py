"""What a person reads on the terminal and what a program reads from JSON."""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.estimation.estimate import FEW, Estimate
from pirrht.files import replaced
from pirrht.freespace import FreeSpace
from pirrht.tree.convergence import Convergence
from pirrht.tree.homology_tree import HomologyTree, Reference
from sim.colors import title
from sim.scenarios import Scenario
from sim.truth import Truth
from sim.words import counted

FEW_CLASSES = 4
LEAST = 30  # columns of a terminal that text is broken for
WORDS: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}
LONE = 1.5  # effective samples of a class of which no more than one has any weight
WORTH = 0.01  # weight of a class that any repeat finds, for others to be in doubt about it


def width() -> int | None:
    """Columns of the terminal that standard output goes to; None where it goes elsewhere."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def say(text: str) -> None:
    """Print lines, broken between words where a terminal is narrower."""
    room = width()
    for line in text.splitlines():
        print(line if room is None else textwrap.fill(line, max(room, LEAST), subsequent_indent="  ", **WORDS))


def table(header: Sequence[str], rows: Sequence[Sequence[str]], room: int | None = None, *, keep: int = 1) -> str:
    """Columns padded to their widest cell; the first is left-aligned, the others right.

    Args:
        room: a table that is wider becomes several, each with the first `keep` columns and some of the others.
    """
    cells = [list(header), *[list(row) for row in rows]]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    first = list(range(keep))
    parts = [list(first)]
    for i in range(keep, len(widths)):
        wide = sum(widths[k] + 2 for k in parts[-1]) + widths[i]
        if room is not None and wide > room and len(parts[-1]) > keep:
            parts.append(list(first))
        parts[-1].append(i)
    return "\n\n".join(_block([[row[i] for i in part] for row in cells], [widths[i] for i in part]) for part in parts)


def _block(cells: Sequence[Sequence[str]], widths: Sequence[int]) -> str:
    """A table's header, a line under it, and its rows."""
    lines = [
        "  ".join(
            cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]
    return "\n".join(line.rstrip() for line in [lines[0], "-" * len(lines[0]), *lines[1:]])


def class_table(references: Sequence[Reference], room: int | None = None) -> str:
    """One row per homology class, cheapest first."""
    if references and len(references[0].winding) > 4:  # too wide for a terminal; JSON has it all
        rows = [[title(r.id), f"{r.cost:.4f}", f"{r.length:.3f}"] for r in references]
        return table(["class", "cost", "length [m]"], rows, room)
    rows = [[r.id, f"{r.cost:.4f}", f"{r.length:.3f}", " ".join(f"{h:+.2f}" for h in r.signature)] for r in references]
    return table(["class", "cost", "length [m]", "H"], rows, room)


def estimate_table(
    estimates: Sequence[Estimate | None], ids: Sequence[str], truth: Truth | None = None, room: int | None = None
) -> str:
    """One row per repeat: value, control, their standard errors, effective sample size and class weights.

    With a truth also the errors.
    """
    off = [] if truth is None else ["v error", "u error"]
    if len(ids) > FEW_CLASSES:  # too wide for a terminal; JSON has them all
        ids = [name for name in ids if any(e and e.class_weights.get(name, 0.0) >= 5e-4 for e in estimates)]
    header = ["repeat", "value", "v stderr", "control", "u stderr", *off, "ESS", *map(title, ids), "other"]
    rows = []
    for i, e in enumerate(estimates):
        if e is None:
            rows.append([str(i), "none", "-", "none", "-", *["-"] * len(off), "0", *["-"] * (len(ids) + 1)])
            continue
        known = [e.class_weights.get(name, 0.0) for name in ids]
        weights = [f"{weight:.3f}" for weight in [*known, max(0.0, 1.0 - sum(known))]]
        errors = [] if truth is None else [f"{error:+.4f}" for error in truth.errors(e)]
        value = [f"{e.value:.4f}", f"{e.value_error:.4f}"]
        control = [_vector(e.control), "(" + ", ".join(f"{error:.3f}" for error in e.control_error) + ")"]
        rows.append([str(i), *value, *control, *errors, f"{e.ess:.1f}", *weights])
    if truth is not None:
        exact = [f"{truth.value:.4f}", "-", _vector(truth.control), "-"]
        rows.append(["truth", *exact, *["-"] * (len(ids) + 4)])
    return table(header, rows, room)


def doubts(estimates: Sequence[Estimate | None], ids: Sequence[str], target: float | None) -> list[str]:
    """What standard errors do not tell: that few samples have any weight, or are of a class, and targets missed."""
    known = [e for e in estimates if e is not None]
    lines = []
    poor = sum(e.doubtful for e in known)
    if poor:
        lines.append(
            f"effective sample size (ESS) below {FEW:g} in {poor} of {len(known)} repeats; standard errors say "
            "nothing there, try more --samples"
        )
    for name in ids:
        thin = sum(e.class_ess.get(name, 0.0) < LONE for e in known)
        if thin and max(e.class_weights.get(name, 0.0) for e in known) >= WORTH:
            lines.append(
                f"class {title(name)}: hardly a sample in {thin} of {len(known)} repeats; standard errors do not know "
                "what it is worth, try more --samples"
            )
    if target is not None:
        missed = sum(float(e.control_error.max()) > target for e in known)
        drawn = [sum(part.size for part in e.parts) for e in known]
        lines.append(
            f"--target-error {target:g}: not reached in {missed} of {len(known)} repeats, "
            f"at most {max(drawn, default=0)} samples drawn"
        )
    return lines


def _vector(values: Array) -> str:
    return "(" + ", ".join(f"{v:+.3f}" for v in values) + ")"


def obstacles_json(space: FreeSpace) -> list[dict[str, Any]]:
    """The topological obstacles, in the order of every winding."""
    return [
        {"marker": [float(v) for v in part.marker], "geoms": list(part.names)}
        for part in space.obstacles
        if part.marker is not None
    ]


def classes_json(references: Sequence[Reference], ids: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """The classes, cheapest first."""
    return [
        {
            "id": name,
            "winding": list(r.winding),
            "signature": r.signature.tolist(),
            "cost": r.cost,
            "length": r.length,
        }
        for r, name in zip(references, ids or [r.id for r in references], strict=True)
    ]


def passages_json(tree: HomologyTree, references: Sequence[Reference]) -> dict[str, Any]:
    """How many passages are open, and through which of them no reference leads, narrowest first, lengths [m]."""
    passages, collision = tree.passages, tree.space.collision
    used = np.zeros(passages.count, dtype=bool)
    for reference in references:
        used |= passages.crossed(reference.trajectory.points)
    unused = [
        {
            "at": passages.place[k].tolist(),
            "width": float(passages.width[k]),
            "between": passages.between(k, collision),
        }
        for k in np.flatnonzero(~used).tolist()
    ]
    return {"open": passages.count, "unused": unused}


def passages_line(found: dict[str, Any]) -> str:
    """What a person should know of open passages (`passages_json`) that no path leads through; empty without any."""
    unused = found["unused"]
    if not unused:
        return ""
    first = unused[0]
    return (
        f"{len(unused)} of {counted(found['open'], 'open passage')} on no path, the narrowest "
        f"{first['width']:.2f} m wide at ({first['at'][0]:.2f}, {first['at'][1]:.2f}) between "
        f"{' and '.join(first['between'])}: more --vertices or --classes or a higher --limit may lead there"
    )


def plan_json(
    scenario: Scenario,
    tree: HomologyTree,
    references: Sequence[Reference],
    seconds: float,
    convergence: Convergence | None = None,
) -> dict[str, Any]:
    """The public JSON of `plan`; with a convergence also the lengths [m] per class while the tree grew."""
    watched = {} if convergence is None else {"convergence": convergence_json(convergence)}
    return {
        "scene": scenario.loaded.scene.name,
        "robot": scenario.loaded.robot,
        "vertices": tree.size,
        "nodes": tree.node_count,
        "pruned_classes": int(tree.graph.pruned[0]),
        "seconds": seconds,
        "fcl_calls": scenario.space.collision.calls,
        "obstacles": obstacles_json(scenario.space),
        "classes": classes_json(references),
        "passages": passages_json(tree, references),
        **watched,
    }


def convergence_json(convergence: Convergence) -> dict[str, Any]:
    """Iterations, vertices and, by class id, the length [m] of the best path; null where there is none."""
    return {
        "iterations": convergence.iterations.tolist(),
        "vertices": convergence.vertices.tolist(),
        "lengths": {name: convergence.lengths[:, c].tolist() for c, name in enumerate(convergence.ids)},
    }


def settings_json(scenario: Scenario) -> dict[str, Any]:
    """What a run was asked for, by the names of the public JSON."""
    s = scenario.settings
    return {
        "scene": scenario.loaded.scene.name,
        "robot": scenario.loaded.robot,
        "method": s.method,
        "seed": s.seed,
        "noise": s.noise,
        "lambda": scenario.problem.temperature,
        "samples": s.samples,
        "dt": s.dt,
        "period": s.period,
    }


def run_json(scenario: Scenario, references: Sequence[Reference], result: dict[str, Any]) -> dict[str, Any]:
    """The public JSON of `run`."""
    s = scenario.settings
    return {
        **settings_json(scenario),
        "grow": s.grow if s.real_time else s.grow or 0,
        **result,
        "obstacles": obstacles_json(scenario.space),
        "classes": classes_json(references),
    }


def estimate_json(
    scenario: Scenario,
    references: Sequence[Reference],
    estimates: Sequence[Estimate | None],
    truth: Truth | None = None,
) -> dict[str, Any]:
    """The public JSON of `estimate`; null where every sample died. With a truth also that and the errors."""
    return {
        **({} if truth is None else _truth_json(truth, estimates)),
        "control": [None if e is None else e.control.tolist() for e in estimates],
        "value": [None if e is None else e.value for e in estimates],
        "value_stderr": [None if e is None else e.value_error for e in estimates],
        "control_stderr": [None if e is None else e.control_error.tolist() for e in estimates],
        "ess": [None if e is None else e.ess for e in estimates],
        "doubtful": [None if e is None else e.doubtful for e in estimates],
        "samples": [None if e is None else sum(part.size for part in e.parts) for e in estimates],
        "class_weights": [None if e is None else e.class_weights for e in estimates],
        "class_ess": [None if e is None else e.class_ess for e in estimates],
        "proposal_weights": [None if e is None else e.proposal_weights for e in estimates],
        "classes": classes_json(references),
        "obstacles": obstacles_json(scenario.space),
    }


def _truth_json(truth: Truth, estimates: Sequence[Estimate | None]) -> dict[str, Any]:
    errors = [None if e is None else truth.errors(e) for e in estimates]
    return {
        "truth": {"value": truth.value, "control": truth.control.tolist()},
        "value_error": [None if error is None else error[0] for error in errors],
        "control_error": [None if error is None else error[1] for error in errors],
    }


def plain(value: Any) -> Any:
    """A value that JSON can hold: arrays as lists, infinities and NaN as null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def check_writable(path: Path, option: str) -> None:
    """Refuse an output path before any work is done.

    Raises:
        OptionError: the folder is missing or may not be written to, or the path is a folder.
    """
    folder = path.resolve().parent
    if path.is_dir():
        raise OptionError(f"{option} {path} is a folder; give the path of a file")
    if not folder.is_dir():
        raise OptionError(f"{option} {path}: the folder {folder} does not exist; create it first")
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise OptionError(f"{option} {path} may not be written; choose another place or mend the permissions")


def write_json(path: Path, value: Any) -> None:
    """Write JSON so that the old file stays until the new one is complete."""
    text = json.dumps(plain(value), indent=2, allow_nan=False) + "\n"
    with replaced(path, "--json") as stream:
        stream.write(text.encode())
