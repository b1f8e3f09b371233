"""An MCAP file in the making: protobuf messages by topic, under a temporary name until it is whole.

Source: the MCAP format specification, https://mcap.dev/spec. The same messages give the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack, suppress
from functools import cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from dirprim_filter.partial_file import PartialFile
from dirprim_filter.recording.container.mcap_writer import McapWriter, uninterrupted
from dirprim_filter.recording.container.records import Channel, Schema

PRODUCER = "dirprim-filter"
METADATA_NAME = "dirprim"
"""The metadata record that says who wrote the file, and from what."""
LATEST_NS = ((1 << 32) - 1) * 1_000_000_000
"""February 2106: the messages of Foxglove hold no later time."""


class LogWriter:
    """A context manager that writes an MCAP file; it takes its name when whole.

    Until then it stands beside as `NAME.PID.partial`: after a kill that holds all but the last chunk, and
    `dirprim recover` makes a whole log of it.
    An exception removes it, unless it is to be kept.

    Args:
        path: the file to write.
        metadata: goes into the `dirprim` metadata record, beside the producer.
        max_chunk_ns: a chunk and the instant after it, which may still be under way when a tracker is killed, span at
            most this much log time, whatever their size. Short chunks compress less well; None leaves them at 1 MiB.
        force: overwrite an existing file.
        keep_when_interrupted: Ctrl-C ends the log as the end of the body does: of a log that grows with time, what is
            there is whole; of one that holds a given thing, it is a part that looks like the whole. Another exception
            then leaves it under its temporary name.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
    """

    def __init__(
        self, path: str | Path, *, metadata: Mapping[str, str], max_chunk_ns: int | None = None, force: bool = False,
        keep_when_interrupted: bool = False,
    ) -> None:  # fmt: skip
        self.path = Path(path)
        self._partial = PartialFile(path, force=force, keep=keep_when_interrupted)
        self._keep_when_interrupted = keep_when_interrupted
        self._metadata = metadata
        self._channel: dict[str, int] = {}
        self._n_messages: dict[int, int] = {}
        self._max_chunk_ns = max_chunk_ns
        self._chunk_start_ns: int | None = None
        self._newest_ns = 0

    def __enter__(self) -> Self:
        version = "not installed"
        with suppress(PackageNotFoundError):  # of a source tree
            version = installed_version(PRODUCER)
        with ExitStack() as opened:
            self._writer = McapWriter(opened.enter_context(self._partial), library=PRODUCER)
            said = {"producer": PRODUCER, "version": version, **self._metadata}
            self._writer.add_metadata(METADATA_NAME, {_utf8(name): _utf8(text) for name, text in said.items()})
            self._opened = opened.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with uninterrupted():  # an interrupt just before leaves the `.partial`, as a kill does
            if kind is None or (self._keep_when_interrupted and issubclass(kind, KeyboardInterrupt)):
                with self._opened:
                    self._writer.finish()
            else:
                self._partial.keep = self._keep_when_interrupted and bool(self._n_messages)
                if self._partial.keep:
                    with suppress(OSError):  # such as of the full disk that is the reason
                        self._writer.finish()
                self._opened.__exit__(kind, error, trace)

    def write(self, topic: str, message: Any, time_ns: int) -> None:
        """Append a message of protobuf or of `foxglove.messages`; log time and publish time are `time_ns`.

        Raises:
            ValueError: a time that MCAP or the messages of Foxglove cannot hold.
        """
        data = message.SerializeToString() if isinstance(message, Message) else message.encode()
        kind: Any = type(message)
        self.write_encoded(topic, schema_of(kind), data, time_ns)

    def write_encoded(self, topic: str, schema: Schema, data: bytes, time_ns: int) -> None:
        """Append a message of this schema that is encoded already.

        Raises:
            ValueError: as `write`.
        """
        if not 0 <= time_ns <= LATEST_NS:
            raise ValueError(
                f"{self.path}: expected times from 0 ns on, as MCAP holds no earlier ones, to {LATEST_NS} ns, of the "
                f"year 2106, got {time_ns} ns; shift all times of the input by as many seconds"
            )
        with uninterrupted():
            self._append(topic, schema, data, time_ns)

    def end_chunk(self) -> None:
        """Have the next message begin a chunk, so that what came before can be read without it."""
        with uninterrupted():
            self._writer.flush()

    def _append(self, topic: str, schema: Schema, data: bytes, time_ns: int) -> None:
        channel = self._channel.get(topic)
        if channel is None:
            encoding = "cdr" if schema.encoding == "ros2msg" else schema.encoding
            channel = self._writer.define(Channel(topic=topic, message_encoding=encoding, schema=schema, metadata=()))
            self._channel[topic], self._n_messages[channel] = channel, 0
        if self._max_chunk_ns is not None:
            if self._chunk_start_ns is None:
                self._chunk_start_ns = time_ns
            elif time_ns > self._newest_ns and (  # what comes late, as of a smoother, joins the chunk at hand
                time_ns - self._chunk_start_ns + (time_ns - self._newest_ns) >= self._max_chunk_ns
            ):
                self._writer.flush()
                self._chunk_start_ns = time_ns
            self._newest_ns = max(self._newest_ns, time_ns)
        sequence = self._n_messages[channel]
        self._n_messages[channel] = sequence + 1
        self._writer.add_message(channel, time_ns, data, time_ns, sequence)


def _utf8(text: str) -> str:
    """With escapes for what UTF-8 cannot hold, such as names of files in other encodings."""
    return text.encode(errors="backslashreplace").decode()


@cache
def schema_of(kind: Any) -> Schema:
    """The schema of a class of messages, of protobuf or of Foxglove's SDK."""
    if not issubclass(kind, Message):
        said = kind.get_schema()
        return Schema(name=said.name, encoding=said.encoding, data=said.data)
    definition = build_file_descriptor_set(kind).SerializeToString()
    return Schema(name=kind.DESCRIPTOR.full_name, encoding="protobuf", data=definition)
