"""An MCAP file in the making: protobuf messages by topic, under a temporary name until it is whole.

Source: the MCAP format specification, https://mcap.dev/spec. The same messages give the same bytes.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib import metadata as installed
from pathlib import Path
from types import TracebackType
from typing import Self

from google.protobuf.message import Message
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from dirprim_filter.recording.errors import OutputExistsError

PRODUCER = "dirprim-filter"
METADATA_NAME = "dirprim"
"""The metadata record that says who wrote the file, and from what."""

CHUNK_BYTES = 1 << 20


def producer_version() -> str:
    """The version of this package; a source tree that nobody installed has none."""
    try:
        return installed.version(PRODUCER)
    except installed.PackageNotFoundError:
        return "not installed"


class McapLog:
    """A context manager that writes an MCAP file; it takes its name when whole.

    Until then it stands beside as `NAME.PID.partial`: after a kill that holds all but the last chunk.
    Ctrl-C inside the body closes the file so that it reads; any other exception removes it.

    Args:
        path: the file to write.
        metadata: goes into the `dirprim` metadata record, beside the producer.
        max_chunk_ns: close a chunk after this much log time, whatever its size: what a kill may lose. Short
            chunks compress less well; None leaves them at 1 MiB.
        force: overwrite an existing file.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        metadata: Mapping[str, str],
        max_chunk_ns: int | None = None,
        force: bool = False,
    ) -> None:
        self.path = Path(path)
        if self.path.exists() and not force:
            raise OutputExistsError(self.path)
        if self.path.is_dir() or not self.path.absolute().parent.is_dir():
            raise NotADirectoryError(f"{self.path}: expected a file in an existing folder; create the folder first")
        self._partial = self.path.with_name(f"{self.path.name}.{os.getpid()}.partial")
        self._metadata = metadata
        self._channel: dict[str, int] = {}
        self._schema: dict[str, int] = {}
        self._n_messages: dict[str, int] = {}
        self._max_chunk_ns = max_chunk_ns
        self._chunk_start_ns: int | None = None

    def __enter__(self) -> Self:
        self._file = self._partial.open("wb")
        self._writer = Writer(
            self._file,
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            enable_crcs=True,
            enable_data_crcs=True,
        )
        self._writer.start(library=PRODUCER)
        self._writer.add_metadata(
            METADATA_NAME, {"producer": PRODUCER, "version": producer_version(), **self._metadata}
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None or issubclass(kind, KeyboardInterrupt):
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.flush()
                os.fsync(self._file.fileno())
                self._file.close()
                self._partial.replace(self.path)
        finally:
            self._file.close()
            self._partial.unlink(missing_ok=True)

    def write(self, topic: str, message: Message, time_ns: int) -> None:
        """Append a message; log time and publish time are `time_ns`.

        Raises:
            ValueError: the time is negative, which MCAP cannot hold.
        """
        if time_ns < 0:
            raise ValueError(f"time_ns: expected at least 0 ns, as MCAP holds no earlier time; got {time_ns} ns")
        channel = self._channel.get(topic)
        if channel is None:
            channel = self._channel[topic] = self._register(topic, message)
        if self._chunk_start_ns is None:
            self._chunk_start_ns = time_ns
        elif self._max_chunk_ns is not None and time_ns - self._chunk_start_ns >= self._max_chunk_ns:
            self._writer.flush()  # type: ignore[no-untyped-call]
            self._chunk_start_ns = time_ns
        sequence = self._n_messages[topic]
        self._n_messages[topic] += 1
        self._writer.add_message(channel, time_ns, message.SerializeToString(), time_ns, sequence)

    def _register(self, topic: str, message: Message) -> int:
        name = message.DESCRIPTOR.full_name
        if name not in self._schema:
            definition = build_file_descriptor_set(type(message)).SerializeToString()
            self._schema[name] = self._writer.register_schema(name, "protobuf", definition)
        self._n_messages[topic] = 0
        return self._writer.register_channel(topic, "protobuf", self._schema[name])
