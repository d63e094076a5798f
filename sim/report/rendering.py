"""A report for people: tables and sentences for a terminal and as Markdown, and with pictures as a page by itself."""

import io
import re
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from html import escape
from math import isfinite, log2
from typing import Any

import numpy as np

from pirrht.control.settings import METHODS
from pirrht.errors import printable
from pirrht.plotting.colors import OTHER_COLOR, ClassColors, rgb
from pirrht.plotting.maps import literal, pyplot
from sim.drawing.colors import method_color, title
from sim.report.summary import ALL, BASE, BEST, LEVEL, Row, p_value
from sim.text import counted, table

SHOWN = 4  # classes in a table
MOST = 6  # scenes with pictures of their own; of more, all together
LEVELS = 24  # noise levels of a scene in pictures at most
METHODS_SHOWN = 8  # methods in pictures at most
COLORED = 6  # classes with a colour of their own
MARKS = "osD^vP"  # of methods
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
div { overflow-x: auto; } img { max-width: 100%; } table { border-collapse: collapse; font-size: 13px; }
th, td { padding: .25rem .6rem; border-bottom: 1px solid #d8dee4; text-align: right; white-space: nowrap; }
th:first-child, td:first-child, th:nth-child(3), td:nth-child(3) { text-align: left; }
"""
METHOD = (
    "Brackets hold 95 % intervals: Wilson's for shares, percentile bootstrap for means and ratios, Bonett and Price's "
    "for differences of paired shares. Comparisons are paired by scene and seed. The p-values are those of McNemar's "
    "exact test for reaching the goal, and of sign flips for the cost where both methods arrive. Brackets after them "
    "hold Holm's adjustment over all comparisons; a difference is significant if its adjusted p-value is below "
    f"{LEVEL:g}. Rows of '{ALL}' treat runs as independent. Step times depend on the machine and its load."
)
Block = tuple[str, Sequence[Any]]  # a tag of HTML, and texts; of a table rows of cells, of pictures texts and PNGs
PREFIXES = {"h1": "# ", "h2": "## ", "li": "* "}  # of Markdown, by HTML's tag
MARKUP = re.compile(r"[\\`*_<&|$~]|(?<=\])\(")  # what Markdown and its renderers take for more than text


def lead(report: Row) -> list[str]:
    """State how complete the sweep is, and how it was made."""
    asked = f"{counted(report['asked'], 'run')} asked for {'is' if report['asked'] == 1 else 'are'} there."
    lines = [f"{report['found']} of {asked}"]
    if report["found"] < report["asked"]:
        lines[0] += " The sweep is unfinished; give its command again to continue it."
    failed = sum(report["errors"].values())
    if failed:
        lines.append(f"{counted(failed, 'run')} ended with an error; no figure counts them:")
        lines += [f"{number} x {error}" for error, number in report["errors"].items()]
    settings = " ".join(
        f"--{name.replace('_', '-')} {' '.join(map(str, value)) if isinstance(value, list) else value}"
        for name, value in report["sweep"]["settings"].items()
    )
    versions = ", ".join(f"{name} {number}" for name, number in report["sweep"]["libraries"].items())
    return [*lines, f"Settings: {settings}. pirrht {report['sweep']['version']}, {versions}."]


def findings(report: Row) -> list[str]:
    """State which differences are significant."""
    questions = counted(report["questions"], "comparison")
    if not report["questions"]:
        return [f"No comparison: no seed came to an end both with {BASE} and with another method."]
    if report["findings"]:
        found = [f"Significant: {line}." for line in report["findings"]]
        verb = "is" if len(found) == 1 else "are"
        return [*found, f"{len(found)} of {questions} with {BASE} {verb} significant."]
    line = f"None of {questions} with {BASE} is significant."
    if report["least_p"] >= LEVEL:
        line += (
            f" None could be: with so few seeds McNemar's adjusted p is {p_value(report['least_p'])} at best. "
            f"It takes at least {int(log2(2 * report['questions'] / LEVEL)) + 1} pairs."
        )
    return [line]


def tables(points: Sequence[Row], comparisons: Sequence[Row]) -> list[tuple[str, str, list[list[str]]]]:
    """Return the tables that have rows: a heading, what it is about, and rows of cells, those of the header first."""
    optimal = {"cost over optimal": _of("cost_over_optimal", ".4f")} if any(p["method"] == BEST for p in points) else {}
    every: list[tuple[str, str, Sequence[Row], dict[str, Callable[[Row], str]]]] = [
        ("Outcomes", "Shares of the runs that came to an end.", points,
         {"runs": _of("runs"), "errors": _of("errors"), "goal %": _of("success", ".1f", 100),
          "collision %": _of("collision", ".1f", 100), "time-out %": _of("timeout", ".1f", 100)}),
        ("Cost and path", "Means over runs that reached the goal. Ratios to the optimal law are over seeds with which "
         "both reached it.", points,
         {"cost": _of("cost"), **optimal, "path [m]": _of("path_length"), "time [s]": _of("time")}),
        ("Decisions", "Class switches per run. A reversal is a switch between two classes that each had nine tenths of "
         "the weight. Step times are wall times of a control step, medians and 95th percentiles averaged over runs. "
         "Classes are those of the driven paths.", points,
         {"switches": _of("class_switches", ".2f"), "reversals": _of("class_reversals", ".2f"), "step median [ms]":
          _of("step_ms", ".2f"), "step p95 [ms]": _of("step_p95_ms", ".2f"), "classes %": _classes}),
        (f"Against {BASE}", f"Differences from {BASE} on equal seeds: goals gained and lost, percentage points, mean "
         "cost.", comparisons,
         {"pairs": _of("pairs"), "goals": lambda c: f"+{c['gained']} -{c['lost']}",
          "points": _of("success", "+.1f", 100), "p goals": _p_values("success"), "both arrive": _of("arrived"),
          "cost": _of("cost", "+.3f"), "p cost": _p_values("cost")}),
    ]  # fmt: skip
    found = []
    for heading, text, rows, own in every:
        cells = [[p["scene"], f"{p['noise']:g}", p["method"], *(cell(p) for cell in own.values())] for p in rows]
        found += [(heading, text, [["scene", "b", "method", *own], *cells])] if cells else []
    return found


def terminal(report: Row) -> str:
    """Format the report for a terminal."""
    tables = figures(report["points"], report["comparisons"])
    first, last = ("\n".join(map(printable, lines)) for lines in (lead(report), findings(report)))
    return f"{first}\n\n{tables}\n\n{last}"


def figures(points: Sequence[Row], comparisons: Sequence[Row]) -> str:
    """Format all tables for a terminal: of many scenes only all of them together."""
    scenes = {point["scene"] for point in points}
    many = ALL in scenes and len(scenes) > 4
    shown = [
        (heading, header, [row for row in rows if not many or row[0] == ALL])
        for heading, _, (header, *rows) in tables(points, comparisons)
    ]
    return "\n\n".join(f"{heading}\n\n{table(header, rows)}" for heading, header, rows in shown if rows)


def _blocks(report: Row, pictures: Mapping[str, str]) -> list[Block]:
    """Return all that a report says, by the tags of HTML."""
    blocks: list[Block] = [("h1", [f"Sweep {report['name']}"]), ("p", lead(report)), ("h2", ["Findings"])]
    blocks += [("li", findings(report)), ("img", list(pictures.items()))]
    for heading, text, rows in tables(report["points"], report["comparisons"]):
        blocks += [("h2", [heading]), ("p", [text]), ("table", rows)]
    return [*blocks, ("h2", ["How"]), ("p", [METHOD])]


def markdown(report: Row) -> str:
    """The report as a Markdown file."""
    parts = list[str]()
    for tag, content in _blocks(report, {}):
        lines = [PREFIXES.get(tag, "") + _plain(line) for line in content if tag != "table"]
        if tag == "table":
            lines = ["| " + " | ".join(map(_plain, row)) + " |" for row in content]
            lines.insert(1, "|" + " --- |" * len(content[0]))
        parts += ["\n".join(lines)] if tag in ("li", "table") else lines
    return "\n\n".join(parts) + "\n"


def _plain(text: str) -> str:
    """Return text in one line that Markdown shows as it is, whatever somebody called a scene."""
    return MARKUP.sub(r"\\\g<0>", printable(text))


def page(report: Row, pictures: Mapping[str, str]) -> str:
    """The whole page, with pictures: PNGs in base64 by what they show."""
    name = f"Sweep {report['name']}"
    parts = list[str]()

    for tag, content in _blocks(report, pictures):
        if tag == "img":
            image = '<p><img alt="{0}" src="data:image/png;base64,{1}"></p><p>{0}</p>'
            parts += [image.format(escape(text), png) for text, png in content]
        elif tag == "table":
            rows = ("".join(_element("td" if k else "th", cell) for cell in row) for k, row in enumerate(content))
            parts.append(f"<div><table><tr>{'</tr><tr>'.join(rows)}</tr></table></div>")
        else:
            parts += [_element("p" if tag == "li" else tag, line) for line in content]
    head = f'<meta charset="utf-8">{_element("title", name)}<style>{_STYLE}</style>'
    body = "\n".join(parts)

    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>\n{body}\n</body></html>\n'


def _element(tag: str, text: str) -> str:
    return f"<{tag}>{escape(printable(text))}</{tag}>"


def _of(field: str, form: str = ".3f", scale: float = 1.0) -> Callable[[Row], str]:
    """Return what writes a field of a row, a count or an interval, in a cell."""
    return lambda row: _text(row[field], form, scale)


def _p_values(field: str) -> Callable[[Row], str]:
    return lambda c: f"{p_value(c[f'{field}_p'])} ({p_value(c[f'{field}_adjusted'])})"


def _text(known: Any, form: str, scale: float) -> str:
    if isinstance(known, int):
        return str(known)
    value, low, high = (f"{scale * known[name]:{form}}" for name in ("value", "low", "high"))
    if not isfinite(known["low"]):
        return value if isfinite(known["value"]) else "-"
    return f"{value} [{low}, {high}]"


def _classes(point: Row) -> str:
    shown = list(point["classes"].items())[:SHOWN]
    texts = [f"{'none' if name == 'None' else title(name)}: {_text(share, '.1f', 100)}" for name, share in shown]
    more = len(point["classes"]) - len(shown)
    return "; ".join([*texts, *([f"{more} more"] if more else [])]) or "-"


def pictures(report: Row) -> dict[str, str]:
    """PNGs in base64 by what they show: success, cost, classes, step times; OptionError if matplotlib is missing."""
    plt = pyplot("report.html")
    scenes = list(dict.fromkeys(p["scene"] for p in report["points"]))
    scenes = [ALL] if len(scenes) > MOST + 1 else [scene for scene in scenes if scene != ALL]
    shown, left_out = _pictured([p for p in report["points"] if p["scene"] in scenes])
    drawn = dict[str, str]()
    for what, label, field, scale in (
        ("Success", "runs that reach the goal [%]", "success", 100.0),
        ("Cost", "cost of runs that reach the goal", "cost", 1.0),
        ("Cost over optimal", "cost over optimal", "cost_over_optimal", 1.0),
        ("Step times", "median step [ms]", "step_ms", 1.0),
    ):
        if known := [p for p in shown if np.isfinite(p[field]["value"])]:
            draw = partial(_levels, label=label, field=field, scale=scale)
            drawn[f"{what} against noise, with 95 % intervals{left_out}"] = _png(plt, known, draw)
    if known := [p for p in shown if p["classes"]]:
        drawn[f"Homology classes of the driven paths{left_out}"] = _png(plt, known, _shares)
    return drawn


def _pictured(points: Sequence[Row]) -> tuple[list[Row], str]:
    """Return the rows that pictures have space for, noise levels evenly picked, and a note if these are not all."""
    methods = list(dict.fromkeys(p["method"] for p in points))[:METHODS_SHOWN]
    kept = set[tuple[str, float]]()
    for scene in {p["scene"] for p in points}:
        levels = sorted({p["noise"] for p in points if p["scene"] == scene})
        picked = np.linspace(0, len(levels) - 1, min(LEVELS, len(levels)))
        kept |= {(scene, levels[round(k)]) for k in picked}
    shown = [p for p in points if p["method"] in methods and (p["scene"], p["noise"]) in kept]
    return shown, "" if len(shown) == len(points) else f" ({len(shown)} of {len(points)} rows of the tables)"


def _png(plt: Any, points: Sequence[Row], draw: Callable[[Any, list[Row]], None]) -> str:
    """A figure with a panel per scene, as base64."""
    scenes = list(dict.fromkeys(p["scene"] for p in points))
    height = max(3.6, 0.24 * len(points) / len(scenes) + 1.2)
    size = max(6.5, 3.6 * len(scenes) + 1.4), height
    figure = plt.Figure(figsize=size, layout="constrained")
    for axes, scene in zip(figure.subplots(1, len(scenes), squeeze=False)[0], scenes, strict=True):
        draw(axes, [p for p in points if p["scene"] == scene])
        axes.set_title(literal(scene), fontsize=10)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=120)
    return b64encode(stream.getvalue()).decode()


def _levels(axes: Any, points: Sequence[Row], label: str, field: str, scale: float) -> None:
    """A line with intervals per method."""
    noises = sorted({p["noise"] for p in points})
    methods = list(dict.fromkeys(p["method"] for p in points))

    for i, method in enumerate(methods):
        own = [p for p in points if p["method"] == method]
        rank = [*METHODS, method].index(method)
        x = [noises.index(p["noise"]) + 0.08 * (i - (len(methods) - 1) / 2) for p in own]
        y, low, high = scale * np.array([[p[field][name] for name in ("value", "low", "high")] for p in own]).T
        off = np.nan_to_num(np.clip([y - low, high - y], 0.0, None))
        look = {"fmt": MARKS[rank % len(MARKS)], "color": rgb(method_color(rank)), "label": literal(method)}
        axes.errorbar(x, y, yerr=off, ls="-", lw=1.0, ms=5, capsize=3, **look)
    axes.set_xticks(range(len(noises)), [f"{b:g}" for b in noises])
    axes.set(xlabel="noise b", ylabel=label, xlim=(-0.5, len(noises) - 0.5))
    axes.set_yscale("log" if "[ms]" in label else "linear")
    axes.grid(alpha=0.25, axis="y")


def _shares(axes: Any, points: Sequence[Row]) -> None:
    """A bar of class shares per noise level and method, the first on top."""
    rows = points[::-1]
    colors = ClassColors()
    left = np.zeros(len(points))

    shares = [{name: 100 * share["value"] for name, share in p["classes"].items()} for p in rows]
    total = Counter({name: sum(own.get(name, 0.0) for own in shares) for own in shares for name in own})
    for name, _ in total.most_common(COLORED):
        share = np.array([own.get(name, 0.0) for own in shares])
        axes.barh(range(len(rows)), share, left=left, color=rgb(colors[name]), label=literal(f"class {title(name)}"))
        left = left + share
    if len(total) > COLORED:
        axes.barh(range(len(rows)), 100 - left, left=left, color=rgb(OTHER_COLOR), label="other")
    names = [literal(f"b = {p['noise']:g}  {p['method']}  (n = {p['arrived']})") for p in rows]
    axes.set_yticks(range(len(rows)), names, fontsize=8)
    axes.set(xlim=(0, 100), xlabel="share of the runs that reached the goal [%]")
