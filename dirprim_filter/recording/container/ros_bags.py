"""Recordings of ROS: folders of MCAP files, split or not; and bags in SQLite and of ROS 1, which rosbags reads.

Source: rosbag2's `metadata.yaml`, which lists the files of a folder in their order.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import lz4.frame

from dirprim_filter.recording.container.budget import decompressed, most_bytes
from dirprim_filter.recording.container.errors import RecordingError
from dirprim_filter.recording.container.mcap_writer import McapWriter
from dirprim_filter.recording.container.records import Channel, Schema
from dirprim_filter.recording.container.temporary_copy import Copy

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

ROS_1 = ".bag"
"""What the name of a bag of ROS 1 ends in."""
METADATA = "metadata.yaml"
MAX_METADATA_BYTES = 1 << 26
ILL_TYPED = (TypeError, ValueError, AttributeError, LookupError, struct.error, OverflowError)
"""What comes of cells of SQLite, which may be of any type, and of broken records of ROS 1."""


def files_of(folder: Path) -> list[Path]:
    """The MCAP files of a folder in their order; none where its messages are in SQLite.

    Raises:
        RecordingError: it has no such `metadata.yaml`, or a file that this lists is missing.
        OSError: it cannot be read.
    """
    from ruamel.yaml import YAML  # noqa: PLC0415  (rosbags brings it)
    from ruamel.yaml.error import YAMLError  # noqa: PLC0415

    path = folder / METADATA
    if not path.exists():
        got = "one without; give its files one by one, or write it by `ros2 bag reindex`"
        if (folder / "_delta_log").is_dir():
            got = "a store; `dirprim store info` lists its logs, `dirprim learn` learns from it"
        raise RecordingError(f"{folder}: expected a file, or a folder of rosbag2 with {METADATA}, got {got}")
    with path.open(encoding="utf-8", errors="replace") as file:
        text = file.read(MAX_METADATA_BYTES)
    try:
        said = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
        names, storage = [PurePosixPath(name).name for name in said["relative_file_paths"]], said["storage_identifier"]
    except (YAMLError, KeyError, TypeError, ValueError, RecursionError) as error:
        why = " ".join(f"{type(error).__name__} {error}".split())[:100]
        raise RecordingError(
            f"{path}: expected rosbag2_bagfile_information, got {why}; write it by `ros2 bag reindex`"
        ) from error
    files = [folder / name for name in names]
    missing = [file.name for file in files if not file.is_file()]
    if missing or not files:
        got = f"no {missing[0]}" if missing else "an empty list"
        raise RecordingError(
            f"{folder}: expected all files that {METADATA} lists, got {got}; write the list by `ros2 bag reindex`"
        )
    return [] if storage == "sqlite3" else files


def copied(bag: Path) -> Copy:
    """The messages of a folder, or of a single file, as an MCAP log.

    Raises:
        RecordingError: rosbags cannot read it, or it becomes more than its size allows.
    """
    import apsw  # noqa: PLC0415  (loaded for such bags alone)
    from rosbags import rosbag1, rosbag2  # noqa: PLC0415

    is_old = bag.suffix == ROS_1
    copy = Copy(str(bag))
    writer = McapWriter(copy, profile="ros2", library="rosbags")
    left = limit = most_bytes(sum(part.stat().st_size for part in (bag.iterdir() if bag.is_dir() else [bag])))

    def bound(connection: apsw.Connection) -> None:
        connection.limit(apsw.SQLITE_LIMIT_LENGTH, min(limit, 2**31 - 1))

    apsw.connection_hooks.append(bound)
    try:
        with (rosbag1 if is_old else rosbag2).Reader(bag) as reader:
            if isinstance(reader, rosbag1.Reader):
                reader.chunks = {at: _bounded(chunk, limit) for at, chunk in reader.chunks.items()}
            channels = {one.id: writer.define(_channel(one)) for one in reader.connections}
            for connection, time_ns, data in reader.messages():
                contents = memoryview(data).tobytes()  # of a whole number `bytes` would make as many zeros
                left -= len(contents)
                if left < 0:
                    raise ValueError(f"messages of more than {limit} bytes, many times the size of the file")
                writer.add_message(channels[connection.id], max(time_ns, 0), contents, max(time_ns, 0))
    except (rosbag1.ReaderError, rosbag2.ReaderError, apsw.Error, *ILL_TYPED) as error:
        way = "`sqlite3 OLD.db3 .recover | sqlite3 NEW.db3` saves what is left"
        way = f"of a broken one {'`rosbag reindex` makes its index anew' if is_old else way}"
        raise RecordingError(f"{bag}: expected a bag that rosbags can read, got {error}; {way}") from error
    finally:
        apsw.connection_hooks.remove(bound)
    writer.finish()
    return copy


def _bounded(chunk: Any, limit: int) -> Any:
    """A chunk of ROS 1 that becomes no more than that: before a message of it is counted it is in memory as a whole."""
    streams: dict[Callable[[bytes], bytes], Any] = {
        bz2.decompress: bz2.BZ2Decompressor, lz4.frame.decompress: lz4.frame.LZ4FrameDecompressor
    }  # fmt: skip

    def decompress(data: bytes) -> bytes:
        stream = streams[chunk.decompressor]()
        try:
            contents = decompressed(stream, data, limit)
        except (OSError, RuntimeError, EOFError) as error:
            raise ValueError(f"a chunk that does not decompress: {error}") from error
        if contents is None or not stream.eof:
            raise ValueError(f"a chunk that is cut, or of more than {limit} bytes, many times the size of the file")
        return contents

    return chunk._replace(decompressor=decompress) if chunk.decompressor in streams else chunk


def _channel(connection: Connection) -> Channel:
    from rosbags.interfaces import ConnectionExtRosbag1, MessageDefinitionFormat  # noqa: PLC0415
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

    definition, kind = connection.msgdef.data, connection.msgdef.format
    if kind is MessageDefinitionFormat.NONE:  # older bags have none; those of ROS itself are known
        known = get_typestore(Stores.LATEST)
        is_known = connection.msgtype in known.fielddefs
        definition = known.generate_msgdef(connection.msgtype, ros_version=2)[0] if is_known else ""
    encoding, of_messages = "ros2idl" if kind is MessageDefinitionFormat.IDL else "ros2msg", "cdr"
    if isinstance(connection.ext, ConnectionExtRosbag1):
        encoding, of_messages = "ros1msg", "ros1"
    schema = Schema(name=connection.msgtype, encoding=encoding, data=definition.encode())
    return Channel(topic=connection.topic, message_encoding=of_messages, schema=schema, metadata=())
