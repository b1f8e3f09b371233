"""Where what is shown goes: an .rrd file, a viewer started for it, a running viewer.

Each place has a stream of its own. One that fails, as a viewer that was closed or a disk that is full, is reported and
left; the others go on, and so does who shows something.
"""

from __future__ import annotations

import atexit
import logging
import re
import time
import uuid
from bisect import bisect_left
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from threading import Thread

import numpy as np
import rerun as rr

from dirprim_filter.partial_file import OutputExistsError, PartialFile
from dirprim_filter.viewer.process import ELAPSED, require_listener, spawn_viewer

logger = logging.getLogger(__name__)

FRAME = "frame"
"""A time line of numbers; `ELAPSED` counts from the first frame;"""
TIMELINE = "message_log_time"
"""and the log's own time, exact to the nanosecond, as rerun's MCAP importer calls it: a raw log opens beside it."""
FROZEN_S = 5.0
"""A viewer that takes nothing for so long is given up."""


class Stream:
    """What is shown, on its way to one or more places.

    Args:
        application_id: recordings with the same one share the layout of a viewer that is open, the place it looks at
            included: so it names the place. Characters other than ASCII letters, digits, _ and - become spaces.
        title: of the recording in a viewer that shows several; left out: the name of the file, or as the first.
        save: an .rrd file. It grows under a temporary name, see `PartialFile`.
        spawn: start a viewer on this machine and leave it open.
        connect: the address of a running viewer, such as `process.VIEWER_URL`.
        force: overwrite `save`.

    Attributes:
        live: a viewer may be open.
        address: of the viewer; None without one.
        failures: what went wrong, a line for each place that was left.
        frames_ns: the times of all frames so far, ascending: the first is where the elapsed time begins.

    Raises:
        ValueError: nowhere to stream to.
        OutputExistsError: `save` exists and `force` is not given.
        ConnectionError: no viewer answers at `connect`, or none could be started.
        OSError: `save` cannot be written.
    """

    def __init__(
        self, application_id: str = "dirprim", *, title: str = "", save: Path | None = None, spawn: bool = False,
        connect: str | None = None, force: bool = False,
    ) -> None:  # fmt: skip
        if save is None and not spawn and connect is None:
            raise ValueError(
                "expected at least one place to stream to, got none; "
                "--spawn shows it on a screen, --save FILE.rrd keeps it for `dirprim view`"
            )
        self.live = spawn or connect is not None
        self.failures: list[str] = []
        self.address = connect
        self.frames_ns: list[int] = []
        self._places: dict[str, rr.RecordingStream] = {}
        self._file: PartialFile | None = None
        self._asked_s = time.monotonic()
        application = re.sub(r"[^A-Za-z0-9_-]+", " ", application_id).strip()
        # The same for a file in every run; but a viewer that is still open must not mix two runs into one.
        of_file = save is not None and not self.live
        identity = uuid.uuid5(uuid.NAMESPACE_URL, save.resolve().as_uri()) if save and of_file else uuid.uuid4()

        def add(name: str, sink: rr.GrpcSink | rr.FileSink) -> None:
            stream = rr.RecordingStream(application, recording_id=identity)
            stream.send_recording_name(title or (save.stem if save else application))
            stream.set_log_time_enabled(False)
            stream.set_sinks(sink)
            self._places[name] = stream

        if save is not None:
            file = PartialFile(save, force=force)
        if spawn:
            self.address = spawn_viewer()
            add("the viewer", rr.GrpcSink(self.address))
        if connect is not None:
            require_listener(connect)
            add(connect, rr.GrpcSink(connect))
        if save is not None:
            if not file.is_stream:  # to which the SDK alone may write
                _begin(file)
                self._file = file
            add(str(save), rr.FileSink(save if file.is_stream else file.partial))

    def send_columns(self, path: str, times_ns: Sequence[int], columns: rr.ComponentColumnList) -> None:
        """Columns of an entity at instants of the log; between two frames they count to the later one."""
        times = np.array(times_ns, np.int64)
        start_ns = self.frames_ns[0] if self.frames_ns else 0
        indexes = [
            rr.TimeColumn(ELAPSED, duration=(times - start_ns).astype("timedelta64[ns]")),
            rr.TimeColumn(FRAME, sequence=[bisect_left(self.frames_ns, time_ns) for time_ns in times.tolist()]),
            rr.TimeColumn(TIMELINE, timestamp=times.astype("datetime64[ns]")),
        ]
        self.to_each(lambda place: place.send_columns(path, indexes, columns))

    def log(self, path: str, *what: rr.AsComponents) -> None:
        """What holds for the whole log."""
        self.to_each(lambda place: place.log(path, *what, static=True))

    def to_each(self, send: Callable[[rr.RecordingStream], object]) -> None:
        """Send something else."""
        for place in self._places.values():
            send(place)

    def look_after(self) -> None:
        """Ask every second whether live viewers still take what is sent: unasked, all would gather in memory."""
        if self.live and time.monotonic() > self._asked_s + 1.0:
            self.flush()
            self._asked_s = time.monotonic()

    def flush(self) -> None:
        """Wait until all is sent; a place that does not take it is left."""
        for name, place in list(self._places.items()):
            try:
                place.flush(timeout_sec=FROZEN_S)
            except RuntimeError as error:  # the SDK's only kind
                _disconnect(place)
                self._fail(name, str(error))

    def close(self, *, whole: bool) -> None:
        """Send what is left and end; a file gets its name if it is whole, else keeps its temporary one."""
        self.flush()
        self.to_each(_disconnect)
        file, self._file = self._file, None
        if file is None:
            return
        name = str(file.path)
        if name in self._places:
            with file.partial.open("rb") as written:
                written.seek(max(file.partial.stat().st_size - 256, 0))  # where the footer is
                if b"RRF2FOOT" not in written.read():
                    self._fail(name, "was not written to its end")
        try:
            file.close(whole=whole and name in self._places)
        except OutputExistsError as error:
            self._report(str(error))
        self._places = {}

    def _fail(self, name: str, why: str) -> None:
        del self._places[name]
        self._report(f"{name}: is left, as it takes no more ({why}); the rest goes on")

    def _report(self, line: str) -> None:
        self.failures.append(line)
        logger.error(line)


def _begin(file: PartialFile) -> None:
    """Open it, if there is room for the beginning: the SDK would wait for ever for a file that takes nothing."""
    with ExitStack() as opened:
        room = opened.enter_context(file)
        room.write(bytes(1 << 16))  # more than what the SDK writes as it opens a file
        room.truncate(0)
        file.keep = True
        opened.pop_all()


def _disconnect(stream: rr.RecordingStream) -> None:
    """End a stream; one that waits for a viewer that has frozen is left to its wait, which no signal would end."""
    ending = Thread(target=stream.disconnect, daemon=True)
    ending.start()
    ending.join(FROZEN_S)
    if ending.is_alive():
        atexit.unregister(rr.rerun_shutdown)  # it would wait too
