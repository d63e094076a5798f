"""Hold the standard terms in names, docstrings, comments and messages of the method, and in the documents.

    python scripts/words.py [PATH...]    # default: `CHECKED`; exit 1 where a retired term is found

Each line of the output is `file:line: term: use instead`. Docstrings begin with a verb or an equation and refer to no
neighbour. Messages of a library name no option of a command line.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
CHECKED = (
    *("pirrht", "sim/cli", "sim/options.py", "sim/settings.py", "sim/result.py", "sim/files.py"),
    *("sim/text.py", "scripts/examples", "docs", "README.md", "CHANGELOG.md", "CONTRIBUTING.md"),
)
OPTIONS = ("sim", "scripts")  # below these messages name options

# Retired names of classes, functions, parameters, attributes, constants and modules.
NAMES = {
    "Around": "ProposalBuilder, Neighbourhood",
    "Aside": "defensive mixture component",
    "beside": "defensive mixture component; next_to",
    "Pace enough_of pressed_of hurry": "TimeBudget, over_budget",
    "Remembered": "ReferenceCache",
    "check_fits check_drives": "validate_tree",
    "Foreseen foresee": "Prediction, set_prediction, predicted",
    "Wanted Whole Moment Asked": "GuideRequest, ClassFromStart, PlanContext, ReferenceQuery",
    "valley valleys rival rivals": "local optimum, alternative optimum",
    "hurried pushed": "time-scaled, perturbed initialisation",
    "Leading Lead Leads led": "ProposalFactory, ProposalControl, ProposalTables",
    "leading": "first_dt, proposal",
    "Climb Along Follow": "DesirabilityAscent, LinearFeedback",
    "AnyGuidance any_ddp any_guides any_guide": "DDPGuidance, ddp",
    "Starts probed": "initialisation, noise_scales",
    "Way": "DesirabilityTube, FavouritePath",
    "look sight": "propagate, goal_kernel, evaluate",
    "priced priced_among Price": "clearance_cost",
    "gates": "half_spaces",
    "Push": "WallDrift",
    "told said held_back": "one_line, corrected_control, clipped",
    "trust steady": "linear-law weight, is_martingale",
    "nearby listed among": "broad_phase, moving_exits",
    "lasting missed": "log_survival, survival probability",
    "beyond": "terminal_cost",
    "room": "wall_offset, radius, clearance, speed, step size",
    "Offers Offer": "PassageSampler, Candidate",
    "saddles pages": "narrow_passages",
    "Marks Tracks Lanes Bases": "RayTable, MarkerTrajectories, BaseCache",
    "Flow Traffic Crowd": "MovingObstacleArrays, MovingObstacles",
    "astray midway bending gaining": "anisotropic, stratonovich, curved_step, state_dependent_gain",
    "settle joined bind mix": "relax, affine, clip, axpy, matvec",
    "shown": "formatting",
    "LEAST MOST NEAR APART SOON": "a name that says of what, as MIN_STEP_SHARE",
}

# Retired phrases of docstrings, comments and messages: each is wrong in every context in which it matches.
PHRASES = {
    r"bodies that move|(?<!decides )\bwhat moves\b": "moving obstacles",
    r"\bfore(told|see|sees|seen|tell|tells|telling)\b": "predicted, predict",
    r"\bmend(s|ed|ing)?\b": "fix, fixed",
    r"\bdear(er|est)?\b": "costly, higher cost",
    r"\bbeside\b": "next to; in addition to",
    r"\btapes?\b": "control sequence (open-loop)",
    r"\btaut(er|est|ness)?\b|\bpolish(es|ing)?\b": "shortened; path shortening",
    r"\bhurr(y|ied|ies)\b": "time budget; over budget",
    r"\b(the|a|one|two|other|another|each|every|which|several|many|some|no|both|these|those|its|all) ways?"
    r" (around|past|of a class|of passing|of going)\b|\bways around\b": "path; homology class",
    r"\b(a|the|this|each|one|another|every|earlier|last|of) drives?\b(?! (state|wheel|shaft|input))": "run, episode",
    r"\bstanding (obstacles?|bod(y|ies)|walls?|things?|discs?|world)\b|\bstands? still\b|\bwhat stands\b": "static",
    r"\bby velocity\b": "with constant-velocity prediction",
    r"\bas noise has it\b|\bwhat noise makes of\b": "expected cost; under noise",
    r"\bswitch(es|ed)? back\b|\btaken back\b": "decision reversal",
    r"\bchannels? of (the )?controls?\b": "matched noise: noise acts through the control inputs",
    r"\blifted by\b": "plotted over (x, y, H)",
    r"\bwalls? that comes?\b": "moving wall",
    r"\blook(s|ed)? anew\b|\basks? anew\b": "evaluate; update",
    r"\b(is|are|was|were|be|been) (told|said)\b": "reported",
    r"\b(is|are|was|were|be|been) (led|hurried)\b": "follows a proposal control; over budget",
    r"\b(is|are|was|were|be|been) asked\b(?! for)": "queried",
    r"\broom for (the|a) robot\b": "clearance; safety margin",
}
LEANS = re.compile(r"^(the same\b|likewise\b|as above\b)|\b(the same of|the same for|likewise)\b", re.I)
ASKS = re.compile(r"^(what|who|whom|whose|how|where|whether|which)\b", re.I)
FLAG = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
_NAMES = {name: instead for names, instead in NAMES.items() for name in names.split()}
_PHRASES = [(re.compile(phrase, re.I), instead) for phrase, instead in PHRASES.items()]
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


class Finding(NamedTuple):
    """A retired term, its line and the term that replaces it."""

    line: int
    term: str
    instead: str


def prose_findings(text: str) -> list[Finding]:
    """Return retired phrases of a Markdown text outside of its code, by lines."""
    plain = re.sub(r"^```.*?^```|`[^`\n]*`", lambda code: "\n" * code[0].count("\n"), text, flags=re.S | re.M)
    return sorted(set(_phrases(1, plain)))


def findings(source: str, stem: str = "", *, options: bool = False) -> list[Finding]:
    """Return retired terms of a module's source, by lines.

    Args:
        stem: the module's own name.
        options: whether its messages may name options of the command line.
    """
    tree = ast.parse(source)
    found = [Finding(line, name, _NAMES[name]) for name, line in [(stem, 1), *_defined(tree)] if name in _NAMES]
    documented = {}
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node) is not None:
            constant = node.body[0].value  # type: ignore[attr-defined]
            documented[constant] = str(ast.get_docstring(node))
            found += _form(constant.lineno, documented[constant])
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found += _phrases(node.lineno, node.value)
            if node not in documented and not options:
                found += [Finding(node.lineno, flag, "what the option sets") for flag in FLAG.findall(node.value)]
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            found += _phrases(token.start[0], token.string)
    return sorted(set(found))


def _defined(node: ast.AST, local: bool = False) -> Iterator[tuple[str, int]]:
    """Yield names that a module defines, with their lines; local variables are left out."""
    if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        yield node.name, node.lineno
        local = not isinstance(node, ast.ClassDef)
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and not local:
        yield node.id, node.lineno
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
        yield node.attr, node.lineno
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.arguments):
            yield from ((one.arg, one.lineno) for one in ast.walk(child) if isinstance(one, ast.arg))
        else:
            yield from _defined(child, local)


def _form(line: int, docstring: str) -> Iterator[Finding]:
    """Yield faults in the form of a docstring."""
    if match := ASKS.search(docstring):
        yield Finding(line, match[0], "a verb or an equation that begins the docstring")
    if match := LEANS.search(docstring.split("\n\n")[0]):
        yield Finding(line, match[0], "a docstring that stands alone")


def _phrases(line: int, text: str) -> Iterator[Finding]:
    """Yield retired phrases of a text, each with its line."""
    for phrase, instead in _PHRASES:
        for match in phrase.finditer(text):
            yield Finding(line + text.count("\n", 0, match.start()), " ".join(match[0].split()), instead)


def main(paths: list[str]) -> int:
    """Print retired terms of files and folders; return 1 where there are some."""
    count = 0
    for path in [Path(one).resolve() for one in paths] or [ROOT / one for one in CHECKED]:
        for file in sorted([*path.rglob("*.py"), *path.rglob("*.md")]) if path.is_dir() else [path]:
            name, text = file.relative_to(ROOT).as_posix(), file.read_text()
            options = name.startswith(OPTIONS)
            found = prose_findings(text) if file.suffix == ".md" else findings(text, file.stem, options=options)
            for line, term, instead in found:
                print(f"{name}:{line}: {term}: {instead}")
                count += 1
    return int(count > 0)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
