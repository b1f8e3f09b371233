"""The time line of all that is shown: the log's own, exact to the nanosecond."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

TIMELINE = "message_log_time"
"""Named as rerun's MCAP importer names it, so that a raw log can be opened beside it."""


def time_column(time_ns: Sequence[int]) -> rr.TimeColumn:
    """Instants of the log, exact to the nanosecond."""
    return rr.TimeColumn(TIMELINE, timestamp=np.array(time_ns, dtype=np.int64).astype("datetime64[ns]"))
