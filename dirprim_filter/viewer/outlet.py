"""Where frames that are shown go: to a file, to a viewer that is watched, or both."""

from __future__ import annotations

import logging
from pathlib import Path

import rerun as rr

from dirprim_filter.viewer.program import WebServer

logger = logging.getLogger(__name__)


class Outlet:
    """Where a sink's frames go, and how it ends.

    Args:
        stream: to a file, a viewer or both.
        file: an .rrd under its temporary name, and its own.
        live: a viewer may be open.
        server: of the web viewer, which ends with the stream.
    """

    def __init__(
        self,
        stream: rr.RecordingStream,
        *,
        file: tuple[Path, Path] | None,
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
        if self._file is None:
            return
        part, save = self._file
        self._file = None
        if whole:
            part.replace(save)
        else:
            logger.warning("%s: holds what was written before the error", part)
