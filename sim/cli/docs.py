"""Write docs/cli.md and docs/json.md, on options and results of commands: `python -m sim.cli.docs`."""

from collections.abc import Sequence
from pathlib import Path

from sim.cli.fields import FILES
from sim.cli.parser import COMMANDS, PRESETS_TEXT, default_of, robots_text, usage_of
from sim.drive.result import Column
from sim.options import NUMERICS, options_of
from sim.settings import DRIVES, SINGLE, Option

DOCS = Path(__file__).resolve().parents[2] / "docs"
HEAD = """# Command line

<!-- Made by `python -m sim.cli.docs`; a test compares both. -->

`pirrht COMMAND --help` lists the options used daily, `--help-all` lists all. Exit status: 0 success; 1 a run that
ended in a collision or time-out, or a sweep with errors; 2 bad input, explained in one line; 130 an interruption.

Precedence: command line, preset, scene, robot. A scene sets options marked \N{BULLET} by custom numerics, such as
`<custom><numeric name="pirrht_noise" data="0.1"/></custom>`, where `-` becomes `_`. Items end with [default; values].
"""
TYPES = {"float64": "number", "int64": "integer"}
JSON_HEAD = """# JSON files

<!-- Made by `python -m sim.cli.docs` of sim/cli/fields.py and sim/drive/result.py; a test compares them. -->

What `--json FILE` writes: each field with its type, or its unit if it is a number that has one. The unit `u` is
that of a control, `cost` that of q times seconds. Infinite and missing values are null. `estimate` has an entry for
each repeat in its lists, null where every sample died. `sweep` writes a list of records; its dataset has the same
names, with `timing_` before wall times. Later versions add fields and rename none.
"""


def json_page() -> str:
    """Return the page of all fields as Markdown: those of several commands once, then those of each."""
    shared = [one for one in FILES["run"] if sum(one in fields for fields in FILES.values()) > 1]
    parts = [JSON_HEAD, "\n## Of several commands\n\n", _fields(shared)]
    for command, fields in FILES.items():
        parts += [f"\n## pirrht {command}\n\n", _fields([one for one in fields if one not in shared])]
    return "".join(parts)


def _fields(fields: Sequence[Column]) -> str:
    return "".join(f"* `{one.name}` ({_kind(one)}): {one.text}\n" for one in fields)


def _kind(field: Column) -> str:
    """Return the unit of a number that has one, else the type of the field."""
    return TYPES.get(field.kind, field.kind) if field.unit in ("", "1") else field.unit


def page() -> str:
    """Return the page as Markdown: options that commands share once, then those of each command."""
    shared = [option for option in options_of("run") if set(SINGLE) <= set(option.commands)]
    described = list[Option]()
    robots = f"\n```\n{robots_text()}\n```\n\n```\n{PRESETS_TEXT}\n```\n"
    parts = [HEAD, f"\n## Options of {', '.join(DRIVES)}\n", *_lists(shared), robots]
    for command, (text, _) in COMMANDS.items():
        parts.append(f"\n## pirrht {command}\n\n{text[0].upper()}{text[1:]}.\n")
        own = [option for option in options_of(command) if option not in shared]
        again = [f"`{usage_of(option)}`" for option in own if option in described]
        parts += _lists([option for option in own if option not in described])
        parts += [f"\nAs above: {', '.join(again)}.\n"] if again else []
        described += own
    return "".join(parts)


def _lists(options: list[Option]) -> list[str]:
    """Return a list for each group of options."""
    lists = []
    for group in dict.fromkeys(option.group for option in options):
        title = f"**{group[0].upper()}{group[1:]}**\n\n" if group else ""
        lists.append(f"\n{title}" + "".join(_item(o) for o in options if o.group == group))
    return lists


def _item(option: Option) -> str:
    typed = (f"-{option.short}, " if option.short else "") + usage_of(option)
    unnamed = not all(str(choice) in option.text for choice in option.choices)
    values = ", ".join(f"`{choice}`" for choice in option.choices if unnamed) or "required" * option.required
    if option.bounds is not None:
        low, high = (f"{bound:g}" if isinstance(bound, float) else bound for bound in option.bounds)
        values = f"{low} to {high}" + (", or `inf`" if option.infinite else "")
    mark = " \N{BULLET}" if option.name in NUMERICS and "import" not in option.commands else ""
    known = "; ".join(part for part in (default_of(option), values) if part)
    return f"* `{typed}`{mark}: {option.text}" + (f" [{known}]" if known else "") + "\n"


if __name__ == "__main__":
    for file, text in ((DOCS / "cli.md", page()), (DOCS / "json.md", json_page())):
        file.write_text(text)
        print(file)
