"""Compiled walks over the records of an MCAP file: from one length field to the next.

Source: the MCAP specification, version 0 (https://mcap.dev/spec): little endian; a record is an opcode, a length
of 64 bits, and that many bytes. No kernel reads beyond the buffer, whatever the lengths say.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray
from tessellation._compiling import compiled, pasted, uncounted

FOUR, EIGHT = np.int64(4), np.int64(8)  # of `load`, which would be compiled once more for each literal
MESSAGE = 5
HEAD = 9
MESSAGE_HEAD = 31
MIN_MESSAGE = 22


@pasted
def _four(data: AnyArray, k: Any) -> Any:
    return (
        np.uint64(data[k])
        | (np.uint64(data[k + np.uint64(1)]) << np.uint64(8))
        | (np.uint64(data[k + np.uint64(2)]) << np.uint64(16))
        | (np.uint64(data[k + np.uint64(3)]) << np.uint64(24))
    )


@uncounted
def load(data: AnyArray, at: int, size: int, little: bool) -> Any:
    """`size` bytes as an unsigned number."""
    value = np.uint64(0)
    if little and size == 8:  # written out, the compiler makes one load of it
        k = np.uint64(at)  # an index that cannot be negative
        low = _four(data, k)
        return low | (_four(data, k + np.uint64(4)) << np.uint64(32))
    if little and size == 4:
        return _four(data, np.uint64(at))
    if little:
        for i in range(size - 1, -1, -1):
            value = (value << np.uint64(8)) | np.uint64(data[at + i])
    else:
        for i in range(size):
            value = (value << np.uint64(8)) | np.uint64(data[at + i])
    return value


@compiled
def _end(buffer: AnyArray, at: Any, size: int) -> Any:
    """The byte after the record at `at`; -1 where it does not fit."""
    if at + HEAD > size:
        return -1
    length = load(buffer, at + 1, EIGHT, True)
    if length > np.uint64(size - at - HEAD) or (buffer[at] == MESSAGE and length < np.uint64(MIN_MESSAGE)):
        return -1
    return at + HEAD + np.int64(length)


@compiled
def read_records(buffer: AnyArray) -> tuple[Any, ...]:
    """The records from the start on, as far as they fit, as columns.

    Returns:
        of the messages: channel, sequence, log time, publish time, first byte of the data, byte after them;
        of the others: first byte of the record; then the byte where the walk ends: the size where all records fit.
    """
    size = len(buffer)
    most = size // MESSAGE_HEAD  # room that is not written to takes no memory
    channel = np.empty(most, np.uint16)
    sequence = np.empty(most, np.uint32)
    log_time = np.empty(most, np.uint64)
    publish_time = np.empty(most, np.uint64)
    start = np.empty(most, np.int64)
    stop = np.empty(most, np.int64)
    other = np.empty(size // HEAD, np.int64)
    at: Any = np.int64(0)  # a literal would compile `_end` once more
    i = j = 0
    while at < size:
        end = _end(buffer, at, size)
        if end < 0:
            break
        if buffer[at] == MESSAGE:
            channel[i] = np.uint16(buffer[at + 9]) | (np.uint16(buffer[at + 10]) << np.uint16(8))
            sequence[i] = load(buffer, at + 11, FOUR, True)
            log_time[i] = load(buffer, at + 15, EIGHT, True)
            publish_time[i] = load(buffer, at + 23, EIGHT, True)
            start[i] = at + MESSAGE_HEAD
            stop[i] = end
            i += 1
        else:
            other[j] = at
            j += 1
        at = end
    return (
        channel[:i].copy(), sequence[:i].copy(), log_time[:i].copy(), publish_time[:i].copy(), start[:i].copy(),
        stop[:i].copy(), other[:j].copy(), at,
    )  # fmt: skip


@compiled
def message_run(buffer: AnyArray, at: Any, max_bytes: int) -> tuple[int, Any, Any]:
    """The messages that stand one after the other from `at` on: the byte after them, first and last log time."""
    first, size = at, len(buffer)
    earliest, latest = np.uint64(0xFFFFFFFFFFFFFFFF), np.uint64(0)
    while at < size and at - first < max_bytes and buffer[at] == MESSAGE:
        end = _end(buffer, at, size)
        if end < 0:
            break
        time = load(buffer, at + 15, EIGHT, True)
        earliest = min(earliest, time)
        latest = max(latest, time)
        at = end
    return at, earliest, latest


@compiled
def gather(contents: AnyArray, start: AnyArray, stop: AnyArray, at: AnyArray, out: AnyArray) -> None:
    """Copy the bytes from each start to its stop to where they belong in `out`."""
    for i in range(len(start)):
        data = contents[start[i] : stop[i]]
        place = out[at[i] : at[i] + len(data)]  # an index that may be negative would keep the loop from being one copy
        for j in range(len(data)):
            place[j] = data[j]
