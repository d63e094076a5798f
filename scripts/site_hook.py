"""Add the changelog to the site, which lies at the root of the repository, and typeset formulas as MathML.

Pages write formulas in LaTeX between pairs of dollar signs. Docstrings, which terminals show, write them plainly.
"""

import re
from html import escape
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
FORMULAS = {  # of docstrings, and in LaTeX
    "E[phi(x(t_f)) + integral of q + u'Ru/2]": r"E[\phi(x(t_f)) + \int q + \tfrac{1}{2} u^\top R u \, dt]",
    "lambda G R^-1 G' = B B'": r"\lambda G R^{-1} G^\top = B B^\top",
    "lambda R^-1 = s s'": r"\lambda R^{-1} = s s^\top",
    "lambda R^-1 G' grad log psi": r"\lambda R^{-1} G^\top \nabla \log \psi",
    "lambda R^-1 G'": r"\lambda R^{-1} G^\top",
    "dx = u dt + b dw": r"dx = u \, dt + b \, dw",
    "dtheta = u/rho dt + b dw": r"d\theta = \frac{u}{\rho} \, dt + b \, dw",
    "v = -lambda log psi": r"v = -\lambda \log \psi",
    "-phi/lambda": r"-\phi / \lambda",
    "(c_ref + 40 lambda) / q_min": r"(c_\mathrm{ref} + 40 \lambda) / q_\mathrm{min}",
    "log psi": r"\log \psi",
    "lambda": r"\lambda",
    "psi": r"\psi",
    "phi": r"\phi",
}
SPELLED = (r"\s+".join(re.escape(word) for word in escape(formula, quote=False).split()) for formula in FORMULAS)
WORDS = re.compile(rf"(?<![\w.])(?:{'|'.join(SPELLED)})(?![\w(:])")
APART = re.compile(r"(<(code|pre|h\d|span)\b.*?</\2>|<[^>]*>)", re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Add the changelog."""
    files.append(File.generated(config, "changelog.md", content=(ROOT / "CHANGELOG.md").read_text()))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Typeset what stands between pairs of dollar signs."""
    return re.sub(r"\$\$(.+?)\$\$", lambda m: f"<div>{convert(m[1], display='block')}</div>", markdown, flags=re.DOTALL)


def on_page_content(html: str, page: Any, **_: Any) -> str:
    """Typeset the formulas of docstrings."""
    return typeset(html) if page.file.src_uri == "api.md" else html


def typeset(html: str) -> str:
    """Return a page whose running text has its formulas as MathML; other code and headings stay as they are."""
    found, last = [], 0
    for tag in APART.finditer(html):
        inner = tag[0].removeprefix("<code>").removesuffix("</code>")
        whole = WORDS.fullmatch(inner) if " " in inner else None
        found += [WORDS.sub(_formula, html[last : tag.start()]), _formula(whole) if whole else tag[0]]
        last = tag.end()
    return "".join([*found, WORDS.sub(_formula, html[last:])])


def _formula(match: re.Match[str]) -> str:
    plain = re.sub(r"\s+", " ", match[0]).replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
    return convert(FORMULAS[plain])
