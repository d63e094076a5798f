"""A report as one HTML file with its pictures in it, which opens without a network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from sim.report import wording
from sim.report.plots import Picture
from sim.report.summary import Report

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


def page(report: Report, pictures: Sequence[Picture]) -> str:
    """The whole page."""
    name = escape(report.name)
    lead = "".join(f"<p>{escape(line)}</p>" for line in wording.lead(report))
    found = "".join(f"<li>{escape(line)}</li>" for line in wording.findings(report))
    tables = "".join(_table(table) for table in wording.tables(report) if table.rows)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>Sweep {name}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{_STYLE}</style></head><body>\n<h1>Sweep {name}</h1>{lead}\n"
        f"<h2>Findings</h2><ul>{found}</ul>\n{''.join(map(_figure, pictures))}\n{tables}\n"
        f'<h2>How</h2><p class="note">{escape(wording.method())}</p>\n</body></html>\n'
    )


def _figure(picture: Picture) -> str:
    text = escape(picture.text)
    return (
        f'<figure><img alt="{text}" src="data:image/png;base64,{picture.png}"><figcaption>{text}</figcaption></figure>'
    )


def _table(table: wording.Table) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.header)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in table.rows)
    return (
        f"<h2>{escape(table.heading)}</h2><p>{escape(table.text.replace('`', ''))}</p>"
        f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>\n'
    )
