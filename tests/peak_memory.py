"""How much memory a piece of work takes at its height, as Linux counts it for this process."""

import re
from pathlib import Path

STATUS, FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def with_growth(work):
    """What some work returns, and by how many bytes the process grew at its height."""
    FORGET.write_text("5")  # what was the most so far
    before = _bytes("VmRSS")
    result = work()
    return result, _bytes("VmHWM") - before


def _bytes(name):
    (kilobytes,) = re.findall(rf"{name}:\s+(\d+) kB", STATUS.read_text())
    return int(kilobytes) << 10
