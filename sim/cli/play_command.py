"""The command `pirrht play`: its window, its live recordings, and what it says."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from typing import Any

from tqdm import tqdm

from pirrht.errors import NoReference, OptionError, PirrhtError
from pirrht.freespace import FreeSpace
from pirrht.outcome import Outcome
from sim.cli import tables
from sim.drive.episode import Frame
from sim.files import check_writable, write_json
from sim.play import events, window
from sim.play.drive import Play
from sim.play.driver import Built
from sim.result import run_json, settings_json
from sim.scenario import Scenario

LOOK = 0.05  # how often one looks whether something has been moved once a drive has ended [s]


def checked(arguments: argparse.Namespace, scenario: Callable[[], Scenario]) -> Scenario:
    """The scenario, once everything else that could be wrong has been looked at.

    Raises:
        OptionError: there is no display, or options that do not go with each other.
    """
    if arguments.json is not None:
        check_writable(arguments.json, "--json")
    arguments.steps_of_script = events.read(arguments.script) if arguments.script is not None else ()
    if not arguments.headless:
        _check_display()
    _sinks(arguments)
    found = scenario()
    if found.settings.method == "optimal":
        raise OptionError("--method optimal would be solved for anew whenever something moves; choose another")
    if found.settings.plant != "mujoco":
        raise OptionError("--plant sde has nothing that could be pushed or moved; leave it out")
    if found.settings.budget is not None or found.settings.target_error is not None:
        raise OptionError("--target-error does not go with driving in real time; leave it out")
    return found if arguments.headless else found.with_settings(real_time=True)


def play(arguments: argparse.Namespace, scenario: Scenario, built: Built) -> int:
    """Drive, until the window is closed or, without one, the drive has ended; exit status 0 goal, 1 another end."""
    game = Play(scenario, built, script=arguments.steps_of_script, real_time=not arguments.headless, tell=_say)
    with ExitStack() as stack:
        stack.callback(game.close)
        seen = None if arguments.headless else window.Window(game.plant).start()
        if seen is not None:
            stack.callback(seen.close)
            _say(f"drag with Ctrl and the right button what has been double-clicked; {window.KEYS}")
        live = stack.enter_context(Live(arguments, game))
        start, last = None, _drive(game, None, seen, live)
        while seen is not None and seen.open:
            start = _again(game, seen, None if last is None else last.outcome)
            if start is not None:
                last = _drive(game, start, seen, live)
    if last is None:
        return 1
    drive = last.metrics.result()
    tables.summary(drive, None)
    if arguments.json:
        done = [{"kind": type(event).__name__.lower(), **asdict(event)} for event in game.plant.done]
        write_json(arguments.json, {**run_json(scenario, [], drive.json()), "events": done})
    return 0 if last.outcome is Outcome.GOAL else 1


def _drive(game: Play, start: Any, seen: window.Window | None, live: Live) -> Frame | None:
    """Run once, and return the last frame; None if there is none."""
    frame, frames = None, game.drive(start)
    try:
        for frame in frames:
            if frame.news:
                _say(frame.news)
            live.log(frame, frame.news)
            if seen is not None and not seen.open:
                break
    finally:
        frames.close()
    return frame


def _again(game: Play, seen: window.Window, outcome: Outcome | None) -> Any:
    """Wait for the start (n,) of the next run; None once the window is closed.

    A goal that is moved is driven to from where the robot is, unless it has collided: then, and by the key Home, the
    robot starts over.
    """
    _say("move the goal to drive on, or strike Home to start over; close the window to end")
    seen.home = False
    while seen.open:
        time.sleep(LOOK)
        moved = any(isinstance(one, events.Move) and one.what == events.GOAL for one in tuple(game.plant.asked))
        if not (moved or seen.home):
            continue
        try:
            return game.again(home=seen.home or outcome is Outcome.COLLISION)
        except (PirrhtError, NoReference) as error:
            _say(str(error))
            seen.home = False
    return None


class Live:
    """Rerun viewers that follow: every world that takes over begins a recording of its own."""

    def __init__(self, arguments: argparse.Namespace, game: Play) -> None:
        self._game, self._server = game, None
        self._space: FreeSpace | None = None
        self._recorder: Any = None
        self._urls: list[str] = []
        if not _sinks(arguments):
            return
        from sim.recording import viewer

        if arguments.connect is not None:
            self._urls.append(arguments.connect)
        if arguments.view:
            self._urls.append(viewer.spawn())
        if arguments.serve:
            self._server = viewer.Server.start()
            self._urls.append(self._server.url)
            _say(f"watch it in a browser of this machine: {self._server.page}")

    def __enter__(self) -> Live:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Write what is left."""
        self._end()

    def log(self, frame: Frame, news: str | None) -> None:
        """Show a control step."""
        if not self._urls:
            return
        if frame.plan.space is not None and frame.plan.space is not self._space:
            self._begin(frame.plan.space)
        for recorder in self._recorder:
            recorder.log(frame, news)

    def _begin(self, space: FreeSpace) -> None:
        from sim.recording.options import Sinks
        from sim.recording.recorder import Recorder

        self._end()
        built, self._space = self._game.live.built, space
        scenario = built.world.scenario
        self._recorder = [
            Recorder(
                scenario.loaded,
                built.tree,
                built.driver.path_integral,
                Sinks(connect=url),
                settings=settings_json(scenario),
            )
            for url in self._urls
        ]

    def _end(self) -> None:
        recorders, self._recorder = self._recorder or [], None
        for recorder in recorders:
            recorder.close()


def _sinks(arguments: argparse.Namespace) -> Any:
    from sim.recording.options import Sinks

    sinks = Sinks(connect=arguments.connect, view=arguments.view, serve=arguments.serve)
    sinks.check()
    return sinks


def _check_display() -> None:
    from sim.recording import viewer

    try:
        viewer.check_display()
    except OptionError:
        raise OptionError(
            "play opens a window, and there is no display for it; use --headless, with --script FILE for what is done "
            "and --serve to watch in a browser"
        ) from None


def _say(line: str) -> None:
    tqdm.write(line)
