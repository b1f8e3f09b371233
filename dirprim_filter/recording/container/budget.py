"""How much memory what a file holds may take: it follows from the file's size, whatever the file claims."""

from typing import Any

SMALL_BYTES, MOST_TIMES = 1 << 26, 100
"""So much is small. Texts of numbers are compressed 10 to 30 times, messages that hardly change some hundred times,
but by chunks of some MiB; what becomes more is a mistake, or an attack."""


def most_bytes(stored: int) -> int:
    """What so many bytes of a file may become in memory, where they are compressed or repeated."""
    return max(SMALL_BYTES, MOST_TIMES * stored)


STEP = 1 << 24


def decompressed(stream: Any, data: bytes, limit: int) -> bytes | None:
    """All that a decompressor of lz4 or bz2 makes of the data; None where that is more than `limit`.

    In steps: of as much as lz4 may return at once, it takes the memory twice.
    """
    parts, size = [stream.decompress(data, max_length=STEP)], 0
    while (size := size + len(parts[-1])) <= limit and len(parts[-1]) == STEP and not stream.eof:
        parts.append(stream.decompress(b"", max_length=STEP))
    return b"".join(parts) if size <= limit else None


FEW_ROWS, MOST_ROWS_PER_BYTE = 1 << 20, 8
"""A row takes some 256 bytes on its way to a track. Of vehicles in even motion without noise four take a byte."""


def most_rows(stored: int) -> int:
    """How many rows so many bytes of a log may hold."""
    return max(FEW_ROWS, MOST_ROWS_PER_BYTE * stored)
