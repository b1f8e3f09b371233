"""Compiled thinning of rows: whether one is kept depends on the one kept before."""

from dirprim_filter.arrays import BoolArray, IntArray
from tessellation._compiling import compiled


@compiled
def thin(order: IntArray, vehicle: IntArray, time_ns: IntArray, interval_ns: int, keep: BoolArray) -> None:
    """Fill (n,) which rows of an order by vehicle and time to keep: a vehicle's are about `interval_ns` apart or more.

    Clocks jitter: a row up to a tenth too early is kept where the vehicle's next one is further from its time.
    """
    last, due_ns = -1, 0
    for a in range(order.size):
        i = order[a]
        is_kept = last < 0 or vehicle[i] != vehicle[last] or time_ns[i] >= due_ns
        if not is_kept and due_ns - time_ns[i] <= interval_ns // 10 and a + 1 < order.size:
            following = order[a + 1]
            is_kept = vehicle[following] == vehicle[i] and time_ns[following] - due_ns > due_ns - time_ns[i]
        keep[a] = is_kept
        if is_kept:
            last, due_ns = i, time_ns[i] + interval_ns
