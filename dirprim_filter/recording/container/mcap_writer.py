"""Writing MCAP by the `mcap` package: each chunk goes to the operating system when it is closed."""

from __future__ import annotations

from typing import Any, Protocol, cast

from mcap.writer import Writer

from dirprim_filter.recording.container.records import NO_SCHEMA, Channel, Schema

N_IDS = 1 << 16


class Stream(Protocol):
    """A file that may take less than it is given."""

    def write(self, data: memoryview, /) -> int: ...  # noqa: D102
    def tell(self) -> int: ...  # noqa: D102
    def flush(self) -> None: ...  # noqa: D102


class McapWriter(Writer):
    """Writes one file; `finish` makes it whole. The same calls give the same bytes.

    Args:
        file: unbuffered, at its start.
        profile: of the header.
        library: of the header: who writes.
    """

    def __init__(self, file: Stream, *, profile: str = "", library: str) -> None:
        super().__init__(cast("Any", _Through(file)))
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


class _Through:
    """A file that takes all of what it is given; what was written outlives the process."""

    def __init__(self, file: Stream) -> None:
        self._file = file
        self.tell, self.flush = file.tell, file.flush

    def write(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]
