"""The argument of a plan as a page of Markdown: one sentence, then the classes one by one."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from pirrht.control.plan import Plan
from pirrht.estimation.estimate import FEW
from sim.drawing.colors import title
from sim.recording.reasons import Reason

ROWS, SAID = 8, 3  # classes in the table and in the sentence at most
FEWEST = 0.005  # weight from which a class is spoken of, the cheapest and the heaviest aside


def page(plan: Plan, reasons: Sequence[Reason], time: float) -> str:
    """What a plan made at a time [s] rests on."""
    estimate = plan.estimate
    if estimate is None:
        why = "the exact solution is followed" if plan.exact is not None else "no samples"
        if plan.fallback is not None:
            why = f"blocked, {plan.fallback}: {'braking' if plan.stops else 'the longest free way is taken'}"
        value = "" if plan.exact is None else f" Exact value {plan.exact:.2f}."
        return f"**At {time:.2f} s: {why}.**{value}"
    if not reasons:
        value = f"value {estimate.value:.2f} ± {estimate.value_error:.2f}"
        return f"**At {time:.2f} s**: {value}; this method has no classes."
    weak = f" Only {estimate.ess:.1f} effective samples: a guess." if estimate.ess < FEW else ""
    head = f"**{sentence(reasons, plan.favourite)}**{weak}"
    return f"{head}\n\n{_table(reasons)}\n\n{_foot(plan, time)}"


def sentence(reasons: Sequence[Reason], favourite: str | None) -> str:
    """The classes that matter, from the cheapest on: what each costs, who dies there, and which one is driven."""
    cheapest = min(reasons, key=lambda r: r.cost)
    spoken = [r for r in reasons if r is cheapest or r.name == favourite]
    rest = sorted((r for r in reasons if r not in spoken and r.weight >= FEWEST), key=lambda r: -r.weight)
    spoken = sorted([*spoken, *rest[: SAID - len(spoken)]], key=lambda r: r.cost)
    parts = []
    for reason in spoken:
        dearer = reason.cost - cheapest.cost
        price = "shortest" if reason is cheapest else "as short" if dearer < 0.005 else f"{dearer:.2g} dearer"
        joint = ", but " if reason is cheapest and reason.dying >= 0.2 else ", "
        parts.append(f"{reason.way}: {price}{joint}{fate(reason)}")
    text = "; ".join(parts)
    driven = next((r for r in reasons if r.name == favourite), None)
    chosen = "" if driven is None else f" Most weight: class {title(driven.name)}, {share(driven.weight)}."
    return f"{text[0].upper()}{text[1:]}.{chosen}"


def fate(reason: Reason) -> str:
    """What becomes of a class' samples."""
    dying, late = round(100 * reason.dying), round(100 * reason.late)
    if not dying and not late:
        return "all arrive"
    parts = []
    if dying:
        what = _where(reason) if reason.where else "a wall"
        parts.append(f"{'all' if dying == 100 else f'{dying} of 100'} samples hit {what}")
    if late:
        parts.append(f"{late} of 100 ran out of time")
    return " and ".join(parts)


def share(weight: float) -> str:
    """A weight in percent, rounded to nothing else than it is: neither to none nor to all."""
    if 0.995 <= weight < 1.0 - 1e-9:
        return "over 99 %"
    return "under 1 %" if 0.0 < weight < 0.005 else f"{100 * weight:.0f} %"


def _where(reason: Reason) -> str:
    if len(reason.where) == 1 or reason.where[0][1] > 0.9:
        return reason.where[0][0]
    return " or ".join(name for name, _ in reason.where)


def _table(reasons: Sequence[Reason]) -> str:
    rows = sorted(reasons, key=lambda r: (-round(r.weight, 3), r.cost))
    known = any(r.exact is not None for r in rows)
    exact = (" exact |", "--:|") if known else ("", "")
    lines = [  # what a narrow view cuts off at the right is also in its plots
        f"| class | weight |{exact[0]} path | cost | collide | with | value |",
        f"|---|--:|{exact[1]}---|--:|--:|---|--:|",
    ]
    for r in rows[:ROWS]:
        value = _valued(r)
        dying = f"{100 * r.dying:.0f} %" + (f", {100 * r.late:.0f} % late" if r.late >= 0.005 else "")
        told = [share(r.exact or 0.0)] if known else []
        cells = (
            title(r.name),
            share(r.weight),
            *told,
            r.way,
            f"{r.cost:.2f}",
            dying,
            _where(r) if r.where else "",
            value,
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _valued(reason: Reason) -> str:
    if not isfinite(reason.value):
        return "none arrives"
    return f"{reason.value:.2f} ± {reason.error:.2f}" if isfinite(reason.error) else f"{reason.value:.2f} by one sample"


def _foot(plan: Plan, time: float) -> str:
    assert plan.estimate is not None
    e = plan.estimate
    return (
        f"Plan and samples of {time:.2f} s. Value of all paths {e.value:.2f} ± {e.value_error:.2f}, "
        f"{e.ess:.0f} effective samples."
    )
