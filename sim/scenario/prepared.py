"""From a scene and what was said of it to a scenario."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from sim.mjcf import load
from sim.options.table import BY_SETTING
from sim.scenario.room import REACTION, default_margin
from sim.scenario.scenario import Scenario
from sim.scenario.trees import AMONG
from sim.settings import settle
from sim.system_import import chosen
from sim.systems import System, named, refuse


def prepare(
    scene: str | Path,
    *,
    robot: str | Path | None = None,
    system: str | System | None = None,
    radius: float | None = None,
    margin: float | None = None,
    start: Sequence[float] | None = None,
    goal: Sequence[float] | None = None,
    workspace: Sequence[float] | None = None,
    freeze: bool | None = None,
    without: Sequence[str] | None = None,
    preset: str | None = None,
    given: Mapping[str, Any] | None = None,
    known: Callable[[System, Problem], object] | None = None,
    loose: bool = False,
    driven: bool = True,
) -> Scenario:
    """Load a scene and settle everything a run needs.

    Args:
        system: what moves, in place of what the robot's file names: MODULE:NAME, or one that is registered.
        workspace: x0, x1, y0, y1 [m], in place of the scene's.
        freeze, without: what becomes of the scene's own bodies that move (`sim.mjcf.load`).
        given: settings by name, None where not said.
        known: told of system and problem as soon as they are known, before anything is compiled for them.
        loose: whether what stands can be moved (`sim.mjcf.load`).
        driven: whether a robot that its plant cannot drive is refused.

    Raises:
        SceneError, OptionError, NotLinearlySolvable: with one line for a person.
    """
    moves = None if system is None else chosen(system)
    read = partial(
        load, scene, robot=robot, radius=radius, start=start, goal=goal, workspace=workspace, system=moves,
        freeze=bool(freeze), without=without, loose=loose,
    )  # fmt: skip
    loaded = read(margin=margin)
    kind = named(loaded.dynamics_name)
    said = given or {}
    strange = [name for name in said if name not in BY_SETTING]
    for name in strange:
        if name in signature(prepare).parameters:
            raise OptionError(f"given: {name!r} is no setting but an argument: prepare(..., {name}=...)")
        like = get_close_matches(name, BY_SETTING, n=1) or sorted(BY_SETTING)
        raise OptionError(
            f"given: {name!r} is no setting; {'did you mean' if len(like) == 1 else 'those are'} {', '.join(like)}"
        )
    overlay = kind.preset(preset)
    refuse(kind, said)
    base = replace(kind.settings, limit=AMONG) if loaded.scene.movers else kind.settings
    settings = settle(base, kind.heard(loaded.scene.defaults, loaded.meant), overlay, said)
    problem = kind.problem(loaded.scene, settings)
    if known is not None:
        known(kind, problem)
    space = FreeSpace.of(loaded.scene)
    room = loaded.margin
    if margin is None and "margin" not in loaded.scene.defaults:
        room = default_margin(problem, space, settings.period if settings.between == "hold" else REACTION)
        if room > 0.0:
            loaded = read(margin=room)
            problem, space = kind.problem(loaded.scene, settings), FreeSpace.of(loaded.scene)
    widens = said.get("limit") is None and "limit" not in overlay
    scenario = Scenario(
        loaded=loaded, system=kind, settings=settings, problem=problem, space=space, margin=room, widens=widens
    )
    if driven:
        scenario.plant()
    return scenario
