"""How much memory what a file holds may take: it follows from the file's size, whatever the file claims."""

SMALL_BYTES, MOST_TIMES = 1 << 26, 100
"""So much is small. Texts of numbers are compressed 10 to 30 times, messages that hardly change some hundred times,
but by chunks of some MiB; what becomes more is a mistake, or an attack."""


def most_bytes(stored: int) -> int:
    """What so many bytes of a file may become in memory, where they are compressed or repeated."""
    return max(SMALL_BYTES, MOST_TIMES * stored)


ROW_BYTES = 256
"""What a row takes on its way to a track."""


def most_rows(stored: int) -> int:
    """How many rows so many bytes of a log may hold."""
    return most_bytes(stored) // ROW_BYTES
