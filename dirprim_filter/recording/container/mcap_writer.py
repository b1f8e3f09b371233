"""Writing MCAP by the `mcap` package: each chunk goes to the system when it is closed; signals wait meanwhile."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from types import SimpleNamespace
from typing import Any, cast

from mcap.writer import Writer

from dirprim_filter.recording.container.records import NO_SCHEMA, Channel, Schema

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Signals inside the body count behind it; threads other than the main one are never interrupted anyway.

    An unhandled SIGTERM ends the process at once: what was written can be recovered.
    """
    if current_thread() is not main_thread():
        yield
        return
    handlers = {number: handler for number in SIGNALS if callable(handler := signal.getsignal(number))}
    held: list[int] = []

    def hold(number: int, _: object) -> None:
        held.append(number)

    for number in handlers:
        signal.signal(number, hold)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if held:
            signal.raise_signal(held[0])


N_IDS = 1 << 16


class McapWriter(Writer):
    """Writes one file; `finish` makes it whole. The same calls give the same bytes.

    Args:
        file: unbuffered, at its start; it takes all that it is given.
        profile: of the header.
        library: of the header: who writes.
    """

    def __init__(self, file: Any, *, profile: str = "", library: str) -> None:
        through = SimpleNamespace(write=file.write, tell=file.tell, flush=file.flush)  # else the package buffers
        super().__init__(cast("Any", through))
        self._schemas: dict[Schema, int] = {NO_SCHEMA: 0}
        self._n_channels = 0
        self.start(profile, library)

    def define(self, channel: Channel) -> int:
        """Write a channel and its schema into the open chunk. -> its id.

        Raises:
            ValueError: all ids are taken.
        """
        self._n_channels += 1
        if max(self._n_channels, len(self._schemas)) >= N_IDS:
            raise ValueError(f"expected fewer than {N_IDS} channels and schemas in one file")
        schema = channel.schema
        if schema not in self._schemas:
            self._schemas[schema] = self.register_schema(schema.name, schema.encoding, schema.data)
        return self.register_channel(
            channel.topic, channel.message_encoding, self._schemas[schema], dict(channel.metadata)
        )
