"""A whole log out of a damaged one: every message that can be read, written anew with indexes and a Summary section.

Metadata, private records and attachments whose checksum holds stay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from dirprim_filter.partial_file import PartialFile
from dirprim_filter.recording.container.errors import Damage
from dirprim_filter.recording.container.log import Log, Scan
from dirprim_filter.recording.container.mcap_writer import McapWriter


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """What became of a log.

    Attributes:
        saved: messages that the new log holds.
        attachments: that the new log holds.
        metadata: metadata records that the new log holds.
        damage: what is broken in the old one.
    """

    saved: int
    attachments: int
    metadata: int
    damage: tuple[Damage, ...]

    @property
    def is_lossless(self) -> bool:
        """Nothing but what is written anew was damaged."""
        return all(damage.messages == 0 and damage.kind != "attachment" for damage in self.damage)

    @property
    def lost(self) -> int:
        """Messages known to be lost; there may be more where the damage hides their number."""
        return sum(damage.messages or 0 for damage in self.damage)


def recover(
    path: str | PathLike[str], output: str | Path, *, force: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Recovery:  # fmt: skip
    """Write all that can be read of a log as a whole one.

    Args:
        path: the log; a `.partial` file that a killed process left, for example, or a split recording's folder.
        output: the log to write.
        force: overwrite an existing file.
        progress: called with how many of how many chunks are done.

    Raises:
        NotMcapError: the file is no MCAP log.
        OutputExistsError: the output exists, and `force` is not set.
        OSError: a file cannot be read or written.
    """
    with Log(path) as opened, PartialFile(output, force=force) as file:
        log, first = Scan(opened), opened.files[0].outline
        writer = McapWriter(file, profile=first.profile, library=first.library)
        for name, entries in log.metadata:
            writer.add_metadata(name, entries)
        ids = {channel: writer.define(channel) for channel in log.channels()}
        saved = 0
        for done, columns in enumerate(log.parts(), start=1):
            for log_ns, publish_ns, sequence, channel, data in columns.messages():
                if channel not in ids:
                    ids[channel] = writer.define(channel)
                writer.add_message(ids[channel], log_ns, data, publish_ns, sequence)
            writer.flush()
            saved += len(columns)
            if progress is not None:
                progress(done, len(opened.chunks))
        n_attachments = 0
        for n_attachments, of in enumerate(log.attachments(), start=1):  # noqa: B007
            writer.add_attachment(of.create_time, of.log_time, of.name, of.media_type, of.data)
        for one in opened.files:
            for start, end in one.outline.private:
                writer.flush()
                file.write(one.bytes_of.read(start, end))
        writer.finish()
        return Recovery(saved=saved, attachments=n_attachments, metadata=len(log.metadata), damage=tuple(log.damage))
