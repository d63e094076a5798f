"""Commands `pirrht run`, one run that is recorded, and `pirrht play`, runs in which somebody interferes."""

import argparse
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict
from functools import partial
from typing import Any

from tqdm import tqdm

from pirrht.control.settings import TREELESS
from pirrht.errors import OptionError, PirrhtError
from pirrht.outcome import Outcome
from pirrht.planner.references import Reference
from pirrht.topology.signature import OTHER
from sim.cli import tables
from sim.cli.plan_command import Progress, notice, planned, report_prediction, scenario_of
from sim.drawing.colors import title
from sim.drive.metrics import Frame
from sim.files import path_text, write_json
from sim.rehearsal import rehearse
from sim.result import run_json, settings_json
from sim.scenario.first_seen import first_seen
from sim.settings import SETTINGS, Settings
from sim.text import say

HEADLESS = "use --headless, with --script FILE for what is done and --serve to watch in a browser"
WATCH = "watch it in a browser of this machine: {}"
DRIVEN = {"noise", "speed", "rho", "seed", "period", "sense", "lidar", "cell", "max_time"}  # settings of --ros
POLL = 0.05  # between two queries whether something has been moved once a run has ended [s]
Observer = Callable[[Frame], object]


def run(arguments: argparse.Namespace) -> int:
    """Plan, run, record and sum up."""
    from sim.recording.viewer import Look

    sinks = _sinks(arguments)
    wiring = _wiring(arguments)
    scenario = scenario_of(arguments)
    drawn = {name: getattr(arguments, f"record_{name}") for name in ("hz", "samples", "lift")}
    (look := Look(truth=arguments.truth, **drawn)).check(scenario.space)
    film = _film(arguments, scenario)
    recorder = None
    seen, _ = first_seen(scenario)
    driver, references, truth = _prepared(scenario, seen, wiring, exact=arguments.truth)
    own = {"method": "ros"} if arguments.ros else {}
    observers: list[Observer] = [] if film is None else [lambda frame: film.add(frame, driver.path_integral)]
    with ExitStack() as stack:
        if sinks:
            recorder = stack.enter_context(_recorder(scenario, driver, sinks, own, look=look, grid=truth))
            observers.append(recorder.log)
            if recorder.server is not None:
                print(WATCH.format(recorder.server.page), flush=True)
        bar = stack.enter_context(Progress("run", scenario.settings.max_time, "s"))
        observers.append(partial(_show, bar, scenario.settings))
        plant = _plant(scenario, driver, stack, remote=arguments.ros)
        last = _driven(scenario.drive(plant, driver, grid=truth), observers)
    assert last is not None
    result = last.metrics.json() | own
    collision = scenario.collisions(last.metrics.first_plan)
    tables.summary(last.metrics, scenario)
    if truth is not None:
        report_prediction(scenario, "the exact value is that")
    if recorder is not None and recorder.live:
        result["dropped_frames"] = recorder.dropped
        print(f"{recorder.dropped} of {result['steps']} steps did not reach a viewer")
    if arguments.record:
        print(f"recording: {path_text(arguments.record)}  (open it with: rerun {path_text(arguments.record)})")
    if arguments.json:
        write_json(arguments.json, run_json(seen, references, result, collision))
    if film is not None:
        _save_film(film, arguments)
    if recorder is not None and recorder.server is not None and sys.stdout.isatty():
        print("served until Ctrl-C", flush=True)
        recorder.server.stay()
    return 0 if last.outcome is Outcome.GOAL else 1


def _wiring(arguments: argparse.Namespace) -> Callable[[Any], Any] | None:
    """Check options of a run over the wire, and set aside the lidar's; return what joins a graph with a scenario.

    None: the run is none.
    """
    if not arguments.ros:
        return None
    from sim.ros.graph import OPTIONS, Graph
    from sim.ros.robot import Remote, Wiring
    from sim.sensing.lidar import Lidar

    unused = [one.flag for one in SETTINGS if one.dest not in DRIVEN and getattr(arguments, one.dest, None)]
    if unused or arguments.truth:
        flag = (*unused, "--truth")[0]
        raise OptionError(f"with --ros others drive, and {flag} has no effect; leave it out")
    lidar = Lidar.of(arguments.lidar or "")
    frames = {f"{one}_frame": getattr(arguments, f"{one}_frame") for one in ("map", "odom", "base")}
    cell = arguments.cell or Settings().cell
    wiring = Wiring(
        hz=arguments.odom_hz, timeout=arguments.command_timeout, wait=arguments.wait, stamped=arguments.stamped,
        cell=None if arguments.sense == "lidar" else cell, **frames,
    )  # fmt: skip
    graph = Graph.of(**{name: getattr(arguments, name) for name in OPTIONS})
    arguments.lidar = arguments.sense = arguments.cell = None  # a run's own are those of plans
    return lambda scenario: Remote(scenario, graph, lidar=lidar, wiring=wiring, say=tqdm.write)


def _plant(scenario: Any, driver: Any, stack: ExitStack, *, remote: bool) -> Any:
    """Return what a policy drives; over the wire its own, of which others hear to the end."""
    if remote:
        stack.callback(driver.end)
    return driver.plant if remote else scenario.plant()


def _prepared(
    scenario: Any, seen: Any, wiring: Callable[[Any], Any] | None = None, *, exact: bool
) -> tuple[Any, list[Reference], Any]:
    """Return the policy of a run, references, and the exact solution if that is wanted; kernels are compiled.

    References are those among what is `seen` at the start, a scenario, too; there are none over the wire.
    """
    if wiring is not None:
        return wiring(scenario), [], None
    with Progress("exact value") as bar:
        truth = scenario.truth(bar.to) if exact else None
    tree, references = (None, []) if scenario.settings.method in TREELESS else planned(seen, waits=True)
    if references:
        print(tables.class_table(references, seen.homology, seen.names, seen.space))
        report_prediction(scenario, "classes above are those")
    if tree is not None and seen is not scenario:
        tree = scenario.grown_tree()
    say(tables.odds(scenario))
    with Progress("exact value") as bar:
        driver = scenario.driver(tree, truth if truth is not None and truth.dt is None else None, bar.to)
    rehearse(scenario, driving=True)
    notice().finish()
    return driver, references, truth


def _film(arguments: argparse.Namespace, scenario: Any) -> Any:
    """Return the film of a run, if one or its last picture is wanted."""
    if arguments.video is None and arguments.png is None:
        return None
    from sim.film import Film

    return Film(scenario.loaded, video=arguments.video, still=arguments.png, known=scenario.settings.sense == "lidar")


def _save_film(film: Any, arguments: argparse.Namespace) -> None:
    """Render a film, and report its files."""
    with Progress("film", film.length, " pictures") as bar:
        film.save(bar.update)
    for what, file in (("film", arguments.video), ("picture", arguments.png)):
        say("" if file is None else f"{what}: {path_text(file)}")


def _show(bar: Progress, settings: Settings, frame: Frame) -> None:
    """Show how far a run is, its news, and the risk at the start; how it ended is in the summary."""
    if frame.step == 0 and frame.collision is not None:
        bar.write(tables.chance_at_start(frame.collision, settings))
    if frame.news and frame.outcome is None:
        bar.write(frame.news)
    bar.to(round(frame.end_time, 6))
    bar.set_postfix_str(f"class {title(frame.metrics.favourite or OTHER)}, cost {frame.cost:.2f}", refresh=False)


def _driven(frames: Generator[Frame], observers: Sequence[Observer], ends: Callable[[], bool] = bool) -> Frame | None:
    """Show frames to observers until the run or somebody `ends` it; return the last frame, None if there is none."""
    frame = None
    with closing(frames):
        for frame in frames:
            for observe in observers:
                observe(frame)
            if ends():
                break
    return frame


def _sinks(arguments: argparse.Namespace) -> Any:
    """Check and return where a recording goes, before any work is done."""
    from sim.recording.viewer import Sinks

    file = getattr(arguments, "record", None)
    sinks = Sinks(file=file, connect=arguments.connect, view=arguments.view, serve=arguments.serve)
    sinks.check()
    return sinks


def _recorder(scenario: Any, driver: Any, sinks: Any, own: dict[str, Any] | None = None, **more: Any) -> Any:
    from sim.recording.recorder import Recorder

    settings = settings_json(scenario) | (own or {})
    return Recorder(scenario.loaded, driver.tree, driver.path_integral, sinks, settings=settings, **more)


def play(arguments: argparse.Namespace) -> int:
    """Run until the window is closed or, without one, the run has ended; exit status 0 goal, 1 another end."""
    from sim.play import events, window
    from sim.play.drive import Play, first
    from sim.recording import viewer

    script = events.read(arguments.script) if arguments.script is not None else ()
    if not arguments.headless:
        viewer.check_display("play opens a window, which", HEADLESS)
    _sinks(arguments)
    scenario = scenario_of(arguments, loose=True)
    settings = scenario.settings
    for wrong, message in (
        (settings.method == "optimal", "--method optimal would have to be solved again whenever something moves"),
        (settings.plant != "mujoco", "--plant sde has nothing that could be pushed or moved"),
        (settings.target_error is not None, "--target-error does not work in real time"),
    ):
        if wrong:
            raise OptionError(f"{message}; leave it out")
    if not arguments.headless:
        scenario = scenario.with_settings(real_time=True)
    with Progress("plan", settings.vertices, " vertices") as bar:
        built = first(scenario, bar.to)
    rehearse(scenario, driving=True)
    notice().finish()
    game = Play(scenario, built, script=script, real_time=not arguments.headless, tell=tqdm.write)
    with ExitStack() as stack:
        stack.callback(game.close)
        screen = start = None
        if not arguments.headless:
            screen = stack.enter_context(closing(window.Window(game.plant)))
            screen.thread.start()
            tqdm.write(f"double-click something, then drag it with Ctrl and the right button; {window.KEYS}")
        live = stack.enter_context(closing(Live(arguments, game)))
        while True:
            last = _driven(game.drive(start), [live.log], bool if screen is None else lambda: not screen.open)
            if screen is None or (start := _next_start(game, screen, last)) is None:
                break
    if last is None:
        return 1
    tables.summary(last.metrics, scenario)
    if arguments.json:
        done = [{"kind": type(event).__name__.lower(), **asdict(event)} for event in game.plant.done]
        write_json(arguments.json, {**run_json(scenario, [], last.metrics.json()), "events": done})
    return 0 if last.outcome is Outcome.GOAL else 1


def _next_start(game: Any, screen: Any, last: Frame | None) -> Any:
    """Wait for the start (n,) of the run after the last; None once the window is closed.

    If the goal is moved, the robot drives on from where it is; after a collision, and by the key Home, it starts over.
    """
    from sim.play import events

    screen.home = False
    if screen.open:
        tqdm.write("move the goal to drive on, or press Home to start over; close the window to end")
    while screen.open:
        time.sleep(POLL)
        if screen.home or any(isinstance(e, events.Move) and e.what == events.GOAL for e in tuple(game.plant.asked)):
            try:
                return game.again(home=screen.home or (last is not None and last.outcome is Outcome.COLLISION))
            except PirrhtError as error:
                tqdm.write(str(error))
                screen.home = False
    return None


class Live:
    """Rerun viewers that follow: every world that takes over begins a recording of its own."""

    def __init__(self, arguments: argparse.Namespace, game: Any) -> None:
        from sim.recording import viewer

        self._game, self._recorders = game, list[Any]()
        self._space: Any = None
        self._run: Any = None
        self._urls = [arguments.connect, viewer.spawn() if arguments.view else None]
        if arguments.serve:
            self._server = viewer.Server()
            self._urls.append(self._server.url)
            tqdm.write(WATCH.format(self._server.page))

    def close(self) -> None:
        """Write all that is not written yet."""
        for recorder in self._recorders:
            recorder.close()

    def log(self, frame: Frame) -> None:
        """Show a control step, and its news on the terminal."""
        if frame.news:
            tqdm.write(frame.news)
        space, world = frame.plan.space, self._game.live.built
        other = space is not self._space and frame.run is not self._run  # a map that grows is of one run
        if any(self._urls) and space is not None and other:
            from sim.recording.viewer import Sinks

            self.close()
            self._space, self._run = space, frame.run
            self._recorders = [_recorder(world.scenario, world.driver, Sinks(connect=url)) for url in self._urls if url]
        for recorder in self._recorders:
            recorder.log(frame)
