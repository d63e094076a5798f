"""A report for people: tables and sentences, and of them Markdown, a page that opens without a network, and lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from math import isfinite
from typing import Any

from sim.drawing.colors import title
from sim.report.comparisons import BASE, LEVEL, Comparison, pairs_needed
from sim.report.plots import Picture
from sim.report.statistics import Interval
from sim.report.summary import ALL, BEST, Point, Report, p_value
from sim.text import counted, table

SHOWN = 4  # classes in a table
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #1b1f24;
       background: #fff; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 2.2rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .6rem; border-bottom: 1px solid #d8dee4; text-align: right; white-space: nowrap; }
th:first-child, td:first-child, th:nth-child(3), td:nth-child(3) { text-align: left; }
thead th { border-bottom: 2px solid #8c959f; } tbody tr:hover { background: #f3f6f9; }
figure { margin: 1.5rem 0; } figure img { max-width: 100%; height: auto; } figcaption, .note { color: #57606a; }
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A heading, what it is about, and cells as text."""

    heading: str
    text: str
    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


def lead(report: Report) -> list[str]:
    """Say how complete the sweep is, and how it was made."""
    lines = [f"{report.found} of {counted(report.asked, 'run')} asked for {_be(report.asked)} there."]
    if report.found < report.asked:
        lines[0] += " The sweep is unfinished: its command, given again, goes on."
    failed = sum(report.errors.values())
    if failed:
        count = "counts" if failed == 1 else "count"
        lines.append(f"{counted(failed, 'run')} ended with an error and {count} in no figure:")
        lines += [f"{number} x {error}" for error, number in report.errors.items()]
    settings = report.manifest["settings"]
    said = " ".join(
        f"--{name.replace('_', '-')} {' '.join(map(str, value)) if isinstance(value, list) else value}"
        for name, value in settings.items()
    )
    versions = ", ".join(f"{name} {number}" for name, number in report.manifest["libraries"].items())
    return [*lines, f"Settings: {said}. pirrht {report.manifest['version']}, {versions}."]


def findings(report: Report) -> list[str]:
    """State plainly what is significant."""
    questions = report.questions
    if not questions:
        return [f"No comparison: {_why_none(report)}."]
    if not report.findings:
        none = f"None of {questions} comparisons" if questions > 1 else "The only comparison"
        told = f"{none} with {BASE} is {'not ' if questions == 1 else ''}significant."
        return [told, *([_hopeless(report)] if report.least_p >= LEVEL else [])]
    return [*(f"Significant: {line}." for line in report.findings), _rest(questions - len(report.findings))]


def _why_none(report: Report) -> str:
    if not report.found:
        return "there are no runs"
    if sum(report.errors.values()) == report.found:
        return "every run ended with an error"
    if not report.comparisons:
        return f"the sweep has no method beside {BASE}, or not {BASE}"
    return f"there is no seed with which both {BASE} and another method came to an end"


def _hopeless(report: Report) -> str:
    pairs, questions = max(c.pairs for c in report.comparisons), report.questions
    return (
        f"None could be, with so few seeds: if all of {counted(pairs, 'pair')} differed one way, McNemar's p would be "
        f"{p_value(report.least_p)} after adjustment for {counted(questions, 'comparison')}. "
        f"It takes at least {pairs_needed(questions)} pairs."
    )


def _rest(others: int) -> str:
    if not others:
        return "There are no other comparisons."
    return f"The other {f'{others} comparisons' if others > 1 else 'comparison'} {_be(others)} not significant."


def _be(number: int) -> str:
    return "is" if number == 1 else "are"


def tables(report: Report) -> list[Table]:
    """All figures."""
    return [_outcomes(report.points), _costs(report.points), _decisions(report.points), _against(report.comparisons)]


def method() -> str:
    """Explain how the figures were made."""
    return (
        "Brackets hold 95 % intervals: Wilson's for shares, percentile bootstrap (10 000 draws) for means and ratios, "
        "Bonett and Price's for differences of paired shares. Equal seeds meet equal plant noise; comparisons are "
        f"paired by scene and seed. p: McNemar's exact test for reaching the goal, sign flips for cost where both "
        f"arrive; Holm's adjustment is over all comparisons of this report, and significant means adjusted p < 0.05. "
        f"'{ALL}' treats runs as independent, so it speaks of these scenes only. Step times depend on the machine and "
        "on what else it did."
    )


def terminal(report: Report) -> str:
    """Format the report for a terminal: of many scenes only all of them together."""

    many = ALL in report.scenes and len(report.scenes) > 4
    parts = ["\n".join(lead(report))]
    for one in tables(report):
        rows = [row for row in one.rows if not many or row[0] == ALL]
        if rows:
            parts.append(f"{one.heading}\n\n{table(one.header, rows)}")
    return "\n\n".join([*parts, "\n".join(findings(report))])


def markdown(report: Report) -> str:
    """The report as a Markdown file."""
    parts = [f"# Sweep {report.name}", *lead(report), "## Findings"]
    parts.append("\n".join(f"* {line}" for line in findings(report)))
    for one in tables(report):
        if one.rows:
            parts += [f"## {one.heading}", one.text, _markdown_table(one)]
    return "\n\n".join([*parts, "## How", method()]) + "\n"


def _markdown_table(table: Table) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    return "\n".join([line(table.header), line(["---"] * len(table.header)), *map(line, table.rows)])


def _outcomes(points: Sequence[Point]) -> Table:
    rows = [
        (*_where(p), str(p.runs), str(p.errors), _share(p.success), _share(p.collision), _share(p.timeout))
        for p in points
    ]
    header = ("scene", "b", "method", "runs", "errors", "goal %", "collision %", "time-out %")
    return Table(heading="Outcomes", text="Shares of the runs that came to an end.", header=header, rows=rows)


def _costs(points: Sequence[Point]) -> Table:
    known = any(p.method == BEST for p in points)
    rows = [
        (
            *_where(p),
            _mean(p.cost),
            *((_mean(p.cost_over_optimal, 4),) if known else ()),
            _mean(p.path_length),
            _mean(p.time),
        )
        for p in points
    ]
    text, ratios = "Of runs that reached the goal.", ("cost over optimal",) if known else ()
    if known:
        text += f" Cost over optimal is the ratio of mean costs on the seeds by which `{BEST}` reached it too."
    header = ("scene", "b", "method", "cost", *ratios, "path [m]", "time [s]")
    return Table(heading="Cost and path", text=text, header=header, rows=rows)


def _decisions(points: Sequence[Point]) -> Table:
    rows = [
        (
            *_where(p),
            _mean(p.class_switches, 2),
            _mean(p.class_reversals, 2),
            _mean(p.step_ms, 2),
            _mean(p.step_p95_ms, 2),
            _classes(p),
        )
        for p in points
    ]
    text = (
        "Class switches per run, and reversals: from a class of nine tenths of the weight to another such one; wall "
        "time of a control step: means over runs of its median and 95th percentile; "
        "shares of the driven homology classes among the runs that reached the goal."
    )
    header = ("scene", "b", "method", "switches", "reversals", "step median [ms]", "step p95 [ms]", "classes %")
    return Table(heading="Decisions", text=text, header=header, rows=rows)


def _against(comparisons: Sequence[Comparison]) -> Table:
    rows = [
        (
            *_where(c),
            str(c.pairs),
            f"+{c.gained} -{c.lost}",
            _points(c.success),
            f"{p_value(c.success_p)} ({p_value(c.success_adjusted)})",
            str(c.arrived),
            _mean(c.cost, sign="+"),
            f"{p_value(c.cost_p)} ({p_value(c.cost_adjusted)})",
        )
        for c in comparisons
    ]
    header = ("scene", "b", "method", "pairs", "goals", "points", "p goals", "both arrive", "cost", "p cost")
    text = (
        f"Differences from `{BASE}` on equal seeds: goals gained and lost, percentage points, mean cost difference; "
        "p with the adjusted one in brackets."
    )
    return Table(heading=f"Against {BASE}", text=text, header=header, rows=rows)


def _where(row: Any) -> tuple[str, str, str]:
    return row.scene, f"{row.noise:g}", row.method


def _share(interval: Interval) -> str:
    return _text(interval, lambda x: f"{100 * x:.1f}")


def _points(interval: Interval) -> str:
    return _text(interval, lambda x: f"{100 * x:+.1f}")


def _mean(interval: Interval, digits: int = 3, sign: str = "") -> str:
    return _text(interval, lambda x: f"{x:{sign}.{digits}f}")


def _text(interval: Interval, number: Any) -> str:
    if not isfinite(interval.value):
        return "-"
    if not isfinite(interval.low):
        return str(number(interval.value))
    return f"{number(interval.value)} [{number(interval.low)}, {number(interval.high)}]"


def _classes(point: Point) -> str:
    shown = list(point.classes.items())[:SHOWN]
    more = len(point.classes) - len(shown)
    told = ["none" if name == "None" else title(name) for name, _ in shown]
    texts = [f"{name}: {_share(share)}" for name, (_, share) in zip(told, shown, strict=True)]
    return "; ".join([*texts, *([f"{more} more"] if more else [])]) or "-"


def page(report: Report, pictures: Sequence[Picture]) -> str:
    """The whole page."""
    name = escape(report.name)
    begin = "".join(f"<p>{escape(line)}</p>" for line in lead(report))
    found = "".join(f"<li>{escape(line)}</li>" for line in findings(report))
    every = "".join(_html_table(table) for table in tables(report) if table.rows)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>Sweep {name}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{_STYLE}</style></head><body>\n<h1>Sweep {name}</h1>{begin}\n"
        f"<h2>Findings</h2><ul>{found}</ul>\n{''.join(map(_figure, pictures))}\n{every}\n"
        f'<h2>How</h2><p class="note">{escape(method())}</p>\n</body></html>\n'
    )


def _figure(picture: Picture) -> str:
    text = escape(picture.text)
    return (
        f'<figure><img alt="{text}" src="data:image/png;base64,{picture.png}"><figcaption>{text}</figcaption></figure>'
    )


def _html_table(table: Table) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.header)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in table.rows)
    return (
        f"<h2>{escape(table.heading)}</h2><p>{escape(table.text.replace('`', ''))}</p>"
        f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>\n'
    )
