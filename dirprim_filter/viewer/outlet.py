"""Where frames that are shown go: to a file, to a viewer that is watched, or both."""

from __future__ import annotations

import rerun as rr

from dirprim_filter.partial_file import PartialFile
from dirprim_filter.viewer.program import WebServer


class Outlet:
    """Where a sink's frames go, and how it ends.

    Args:
        stream: to a file, a viewer or both.
        file: an .rrd under its temporary name, open.
        live: a viewer may be open.
        server: of the web viewer, which ends with the stream.
    """

    def __init__(
        self,
        stream: rr.RecordingStream,
        *,
        file: PartialFile | None,
        live: bool,
        server: WebServer | None = None,
    ) -> None:
        self.stream = stream
        self.live = live
        self.server = server
        self._file = file

    def close(self, *, whole: bool) -> None:
        """A file gets its name if it is whole, else keeps its temporary one."""
        self.stream.flush()
        self.stream.disconnect()
        if self.server is not None:
            self.server.stop()
        if (file := self._file) is not None:
            self._file = None
            file.close(whole=whole)
