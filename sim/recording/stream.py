"""A Rerun recording stream that puts the same data into the same chunks in the same order, run after run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from sim.drive.clock import URGENT


class Stream:
    """One recording on its way to one file or viewer, with the timelines `step` and `sim_time`.

    `orderly` keeps chunks in the order in which they were logged, which files need to be compared. A viewer lays out
    all recordings of an `application` alike.
    """

    def __init__(self, application: str, recording_id: str, *, orderly: bool) -> None:
        self._orderly = orderly
        # Ctrl-C strikes the main thread, and half a stream cannot be let go of without a complaint of Rerun's.
        with ThreadPoolExecutor(1) as aside:
            self._stream = aside.submit(_native, application, recording_id).result()
        self._stream.set_log_time_enabled(False)

    def save(self, file: Path, blueprint: rrb.Blueprint) -> None:
        """Write to a file from now on; what it held before is lost."""
        self._stream.save(file, default_blueprint=blueprint)

    def connect(self, url: str, blueprint: rrb.Blueprint) -> None:
        """Send to a viewer from now on."""
        self._stream.connect_grpc(url, default_blueprint=blueprint)

    def properties(self, values: dict[str, Any], *, name: str) -> None:
        """Name the recording and attach properties to it, as the group "run"."""
        self._stream.send_recording_name(name)
        self._cut()
        self._stream.send_property("run", rr.AnyValues(**values))
        self._cut()

    def static(self, path: str, archetype: rr.AsComponents | Sequence[rr.AsComponents]) -> None:
        """Log something, or several things together, that hold at all times."""
        together = archetype if isinstance(archetype, Sequence) else [archetype]
        self._stream.log(path, *together, static=True)
        self._cut()

    def log(self, path: str, step: int, time: float, archetype: rr.AsComponents) -> None:
        """Log something at a step and simulated time [s]."""
        URGENT.give_way()
        self._stream.set_time("step", sequence=step)
        self._stream.set_time("sim_time", duration=time)
        self._stream.log(path, archetype)
        self._cut()

    def columns(self, path: str, steps: Sequence[int], times: Sequence[float], columns: Iterable[Any]) -> None:
        """Log a row for each of many steps."""
        URGENT.give_way()
        index = [rr.TimeColumn("step", sequence=steps), rr.TimeColumn("sim_time", duration=times)]
        self._stream.send_columns(path, indexes=index, columns=columns)

    def flush(self, timeout: float) -> bool:
        """Hand on everything logged so far; whether that worked within the time [s]."""
        try:
            self._stream.flush(timeout_sec=timeout)
        except (RuntimeError, ValueError):
            return False
        return True

    def close(self) -> None:
        """Write what is left, and the file's footer."""
        self._stream.disconnect()

    def _cut(self) -> None:
        # Chunks that wait together leave in any order; a flush in between, not waited for, keeps theirs.
        if self._orderly:
            self._stream.flush(timeout_sec=0)


def _native(application: str, recording_id: str) -> rr.RecordingStream:
    return rr.RecordingStream(
        application,
        recording_id=recording_id,
        send_properties=False,  # they would hold the wall time
        batcher_config=rr.ChunkBatcherConfig.NEVER(),  # chunks end where we say, not where a clock does
    )


def forget_lost_viewers() -> None:
    """Let the process end without Rerun's last attempt to reach a viewer, which may take forever."""
    rr.unregister_shutdown()
