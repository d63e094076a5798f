"""Recording a drive in Rerun: to a file, which misses nothing, and to viewers, which never hold it up.

Each target has a queue, a thread and a stream of its own; the control thread only puts frames into queues.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from types import TracebackType

from pirrht.errors import OptionError
from pirrht.estimation.sampler import PathIntegral
from pirrht.freespace import FreeSpace
from pirrht.tree.homology_tree import HomologyTree
from sim.drawing import strokes
from sim.drive.episode import Frame
from sim.drive.truth import Truth
from sim.mjcf import Loaded
from sim.recording import viewer
from sim.recording.layout import layout
from sim.recording.static import TREE_EDGES, Subject, telling
from sim.recording.step_row import Edges, Row
from sim.recording.stream import Stream, forget_lost_viewers
from sim.recording.writer import Writer

SAMPLES = ("all", "some", "none")
ROOM = 256  # rows a queue holds
NAP = 0.02  # pause of a thread that has nothing to do [s]
GRACE = 2.0  # what a viewer gets to take the last rows [s]
PATIENCE = 10.0  # after which a file that takes nothing is given up, and a viewer is asked again [s]

Connect = Callable[[Stream], None]


class Recorder:
    """Takes the frames of a drive and records them.

    Args:
        file: where to write an .rrd; an existing one is replaced when the first frame comes.
        connect: URL of a running viewer.
        view: start a viewer.
        serve: serve browsers of this machine; `server` tells where.
        hz: how often references and samples are drawn, per simulated second.
        samples: which sampled paths are drawn: "all", "some" or "none".
        truth: whether every frame comes with the exact value and the optimal control.
        lift: obstacles, from 1, whose H is the height of a tree; by default those that tell the shortest classes apart.
        settings: what the drive was made with; kept as properties of the recording.

    Raises:
        OptionError: the file cannot be written, no viewer listens at the URL or none can be started.
    """

    def __init__(
        self,
        loaded: Loaded,
        space: FreeSpace,
        tree: HomologyTree | None,
        path_integral: PathIntegral,
        *,
        file: Path | None = None,
        connect: str | None = None,
        view: bool = False,
        serve: bool = False,
        hz: float = 5.0,
        samples: str = "some",
        truth: bool = False,
        lift: Sequence[int] | None = None,
        settings: dict[str, object],
    ) -> None:
        if not (math.isfinite(hz) and hz > 0):
            raise OptionError(f"--record-hz is {hz:g}; it must be a positive number of pictures per second")
        if samples not in SAMPLES:
            raise OptionError(f"--record-samples is {samples!r}; it must be one of {', '.join(SAMPLES)}")
        if file is not None:
            _check_writable(file)
        if connect is not None:
            viewer.probe(connect)
        self.server = viewer.Server.start() if serve else None
        found = (connect, viewer.spawn() if view else None, None if self.server is None else self.server.url)
        urls = [url for url in found if url is not None]
        if truth:
            settings = {**settings, "truth": True}
        subject = Subject(
            loaded=loaded,
            space=space,
            tree=tree,
            path_integral=path_integral,
            samples=samples,
            settings=settings,
            truth=truth,
            lift=_lifts(space, tree, path_integral, lift),
        )
        self._lifted = [obstacle for obstacle, _, _ in subject.lifted]
        self._tree, self._size = tree, 0 if tree is None else tree.size
        path_integral.warm_up()
        self._interval, self._due = 1.0 / hz, 0.0
        self._file = None if file is None else _Target(subject, _to_file(subject, file))
        self._live = [_Target(subject, _to_viewer(subject, url), url=url) for url in urls]

    def __enter__(self) -> Recorder:
        """The recorder itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close, however the drive ended; what ended it is reported first."""
        with suppress(OptionError) if error is not None else nullcontext():
            self.close()

    @property
    def live(self) -> bool:
        """Whether a viewer is shown the drive."""
        return bool(self._live)

    @property
    def dropped(self) -> int:
        """Frames that a viewer could not take."""
        return sum(target.dropped for target in self._live)

    def log(self, frame: Frame, news: str | None = None, truth: Truth | None = None) -> None:
        """Record a control step, with a line for the log if there is news, and the truth if it is known.

        Raises:
            OptionError: the file can no longer be written.
        """
        drawn = frame.time >= self._due - 1e-9 or frame.outcome is not None
        if drawn:
            self._due = max(self._due + self._interval, frame.time)
        row = Row.of(frame, drawn, news, truth, self._growth() if drawn else ())
        for target in self._live:
            target.put(row)
        if self._file is not None:
            self._file.put(row)

    def _growth(self) -> tuple[Edges, ...]:
        """Edges of the vertices that the tree has gained since the last picture, per obstacle that it is lifted by."""
        if self._tree is None or self._tree.size == self._size or not self._lifted:
            return ()
        since, self._size = self._size, self._tree.size
        return tuple(strokes.tree_edges(self._tree, k, TREE_EDGES, since=since) for k in self._lifted)

    def close(self) -> None:
        """Write what is left and close everything.

        Raises:
            OptionError: the file could not be written.
        """
        for target in [*self._live, *([] if self._file is None else [self._file])]:
            target.close()


class _Target:
    """A queue, and the thread that empties it into a stream.

    Without a viewer's address it is a file: it takes everything, and a full queue makes the sender wait.
    """

    def __init__(self, subject: Subject, connect: Connect, *, url: str | None = None) -> None:
        self.dropped = 0
        self._connect, self._url = connect, url
        self._writer = Writer(Stream(subject.application, subject.id, orderly=url is None), subject)
        self._writer.begin()  # kept in memory until the first frame comes: a file is not touched before
        self._rows: deque[Row] = deque()  # appending takes no lock that the control thread could wait for
        self._closing, self._done = threading.Event(), threading.Event()
        self._failure: Exception | None = None
        self._under_way = 0  # rows taken from the queue and not known to have arrived
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    def put(self, row: Row) -> None:
        """Hand over a row; a file takes it sooner or later, a viewer only if there is room."""
        while self._url is None and len(self._rows) >= ROOM and self._failure is None:
            time.sleep(0.001)
        self._check()
        if self._failure is None and len(self._rows) < ROOM:
            self._rows.append(row)
        else:
            self.dropped += 1

    def close(self) -> None:
        """Let the thread finish; a viewer gets little time for it."""
        self._closing.set()
        self._done.wait(None if self._url is None else GRACE)
        if self._url is not None:
            self.dropped += len(self._rows) + (0 if self._finished else self._under_way)
            if not self._finished:
                forget_lost_viewers()
        self._check()

    @property
    def _finished(self) -> bool:
        return self._done.is_set() and self._failure is None

    def _check(self) -> None:
        if self._failure is not None and self._url is None:
            raise OptionError(f"the recording broke off: {self._failure}") from self._failure

    def _work(self) -> None:
        connected = False
        try:
            while self._rows or not self._closing.is_set():
                if connected and self._url is None and self._writer.secure():
                    self._deliver(self._writer.stream)
                if not self._rows:
                    time.sleep(NAP)
                    continue
                if not connected:
                    self._connect(self._writer.stream)
                    connected = True
                self._under_way += 1
                if self._writer.add(self._rows.popleft()):
                    self._deliver(self._writer.stream)
                    self._under_way = 0
            if connected:
                self._writer.end()
        except Exception as error:  # the control thread reports it, or goes on without the viewer
            self._failure = error
        self._done.set()
        if self._failure is not None and self._url is not None:
            # Letting go of a stream waits for its viewer, who is gone: hold it until the process ends.
            threading.Event().wait()

    def _deliver(self, stream: Stream) -> None:
        """See a batch off before the next one is drawn: what a viewer cannot take must not pile up."""
        while not stream.flush(PATIENCE):
            if self._url is None:
                raise OSError(f"nothing could be written for {PATIENCE:g} s")
            viewer.probe(self._url)
            if self._closing.is_set():
                raise TimeoutError("the viewer did not keep up to the end")


def _to_file(subject: Subject, file: Path) -> Connect:
    return lambda stream: stream.save(file, layout(subject, live=False))


def _to_viewer(subject: Subject, url: str) -> Connect:
    return lambda stream: stream.connect(url, layout(subject, live=True))


def _lifts(
    space: FreeSpace, tree: HomologyTree | None, path_integral: PathIntegral, lift: Sequence[int] | None
) -> tuple[int, ...]:
    """Obstacles, from 0, whose H lifts the tree."""
    if lift is None:
        problem = path_integral.problem
        return () if tree is None else telling(tree, problem.dynamics.state_of(problem.scene.start))
    M = len(space.obstacles)
    if not all(1 <= k <= M for k in lift):
        raise OptionError(
            f"--record-lift {','.join(map(str, lift))}: {space.scene.name} has the obstacles 1 to {M}; name one or two"
        )
    return tuple(dict.fromkeys(k - 1 for k in lift))


def _check_writable(file: Path) -> None:
    """Make sure that the file can be written, without touching what it holds."""
    remedy = "choose another --record FILE.rrd"
    if not file.parent.is_dir():
        raise OptionError(f"{file}: the folder {file.parent} does not exist; create it, or {remedy}")
    new = not file.exists()
    try:
        file.open("ab").close()
    except OSError as error:
        raise OptionError(f"{file}: cannot be written ({error.strerror}); {remedy}") from None
    if new:
        file.unlink()
