"""Recording a drive in Rerun: to a file, which misses nothing, and to viewers, which never hold it up."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext, suppress
from types import TracebackType

from pirrht.errors import OptionError
from pirrht.estimation.sampler import PathIntegral
from pirrht.exact.desirability import Desirability
from pirrht.tree.homology_tree import HomologyTree
from sim.drawing import strokes
from sim.drive.episode import Frame
from sim.drive.truth import Truth
from sim.mjcf import Loaded
from sim.recording import truth_view, viewer
from sim.recording.look import Look
from sim.recording.outlet import ToFile, ToViewer
from sim.recording.sink import Sink
from sim.recording.sinks import Sinks
from sim.recording.static import TREE_EDGES
from sim.recording.step_row import Edges, Row
from sim.recording.subject import Subject
from sim.systems import POSE

__all__ = ["Look", "Recorder", "Sinks"]

DEFAULT = Look()


class Recorder:
    """Takes the frames of a drive and records them.

    Args:
        loaded: the scene's model.
        tree: grown; None if the drive does without.
        path_integral: of the drive's controller.
        sinks: where the recording goes.
        look: what it shows.
        settings: what the drive was made with; kept as properties of the recording.
        grid: the exact solution, shown on the floor.

    Attributes:
        server: what serves browsers, if that was asked for.

    Raises:
        OptionError: the file cannot be written, no viewer listens at the URL or none can be started, or an obstacle
            to lift a tree by is not there.
    """

    def __init__(
        self,
        loaded: Loaded,
        tree: HomologyTree | None,
        path_integral: PathIntegral,
        sinks: Sinks,
        look: Look = DEFAULT,
        *,
        settings: Mapping[str, object],
        grid: Desirability | None = None,
    ) -> None:
        look.check(path_integral.space)
        sinks.check()
        states = {"states": " ".join(loaded.states)}  # after which an exported table names its columns
        named = settings if set(loaded.states) <= set(POSE) else {**settings, **states}
        known = {**named, "truth": True} if look.truth else named
        subject = Subject(loaded=loaded, tree=tree, path_integral=path_integral, look=look, settings=known, grid=grid)
        self._lifted = [obstacle for obstacle, _, _ in subject.lifted]
        self._tree, self._size = tree, 0 if tree is None else tree.size
        path_integral.warm_up()
        if grid is not None:
            truth_view.warm_up(grid)
        self._interval, self._due = 1.0 / look.hz, 0.0
        self.server = viewer.Server.start() if sinks.serve else None
        served = None if self.server is None else self.server.url
        urls = (sinks.connect, viewer.spawn() if sinks.view else None, served)
        self._live = [Sink(subject, ToViewer(subject, url)) for url in urls if url is not None]
        self._file = None if sinks.file is None else Sink(subject, ToFile(subject, sinks.file))

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
    def waiting(self) -> int:
        """Steps that are still to be written to the file."""
        return 0 if self._file is None else self._file.waiting

    @property
    def dropped(self) -> int:
        """Frames that a viewer could not take."""
        return sum(sink.dropped for sink in self._live)

    def log(self, frame: Frame, news: str | None = None, truth: Truth | None = None) -> None:
        """Record a control step, with a line for the log if there is news, and the truth if it is known.

        Raises:
            OptionError: the file can no longer be written.
        """
        drawn = frame.time >= self._due - 1e-9 or frame.outcome is not None
        if drawn:
            self._due = max(self._due + self._interval, frame.time)
        row = Row.of(frame, drawn, news, truth, self._growth() if drawn else ())
        for sink in self._live:
            sink.put(row)
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
        for sink in [*self._live, *([] if self._file is None else [self._file])]:
            sink.close()
