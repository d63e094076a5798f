"""The reference of the command line as a page of the documentation: `python -m sim.cli.docs` writes docs/cli.md."""

from __future__ import annotations

import sys
from pathlib import Path

from pirrht.files import replaced
from sim.cli.parser import COMMANDS, default_of, meaning
from sim.options.record import Option, shown
from sim.options.table import NUMERICS, options_of

PAGE = Path(__file__).resolve().parents[2] / "docs" / "cli.md"
COLUMNS = "| option | meaning | default | values |\n|---|---|---|---|\n"
HEAD = """# Command line

<!-- Made by `python -m sim.cli.docs` of the table in sim/options; a test holds the two against each other. -->

```
pirrht COMMAND [options]
pirrht COMMAND --help
pirrht --version
```

Exit status: 0 success, 1 a drive that ended in a collision or a time-out, or a sweep with errors, 2 bad input (one line
on standard error says what was wrong and what would have worked), 130 an interruption.

Who wins: the command line over a preset, that over the defaults of a scene, those over the defaults of what moves. A
scene's defaults are custom numerics of its MJCF, `<custom><numeric name="pirrht_noise" data="0.1"/></custom>`; options
that may stand there are marked with \N{BULLET} below, and `-` becomes `_`.
"""


def page() -> str:
    """The page as Markdown."""
    parts = [HEAD]
    for command, (text, _) in COMMANDS.items():
        parts.append(f"\n## pirrht {command}\n\n{text[0].upper()}{text[1:]}.\n")
        options = options_of(command)
        for group in dict.fromkeys(option.group for option in options):
            rows = [_row(option) for option in options if option.group == group]
            title = f"**{group[0].upper()}{group[1:]}**\n\n" if group else ""
            parts.append(f"\n{title}{COLUMNS}" + "\n".join(rows) + "\n")
    return "".join(parts)


def _row(option: Option) -> str:
    metavar = " ".join(option.metavar) if isinstance(option.metavar, tuple) else option.metavar
    several = " ..." if option.count == "+" else ""
    typed = option.flag if option.positional else f"{option.flag} {metavar}".rstrip()
    short = f"-{option.short}, " if option.short else ""
    mark = " \N{BULLET}" if option.name in NUMERICS and NUMERICS[option.name].dest == option.dest else ""
    cells = (f"`{short}{typed}{several}`{mark}", meaning(option), default_of(option), _values(option))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _values(option: Option) -> str:
    if option.choices:
        return ", ".join(f"`{choice}`" for choice in option.choices)
    if option.bounds is None:
        return "required" if option.required else ""
    whole = option.kind is int
    low, high = ((shown(int(b)) if whole else f"{b:g}") for b in (option.bounds.low, option.bounds.high))
    extra = ", or `inf`" if option.bounds.infinite else ""
    return f"{low} to {high}{extra}: {option.bounds.why}"


def main() -> int:
    """Write the page."""
    with replaced(PAGE, "docs/cli.md") as stream:
        stream.write(page().encode())
    print(PAGE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
