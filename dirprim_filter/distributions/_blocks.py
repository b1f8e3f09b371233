"""Blocks of rows, spread over the machine's cores; compiled kernels let go of the interpreter while they run."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dirprim_filter.distributions._random import UIntArray

ROWS = 8192
"""Rows of a block: a stream of random numbers each, so that draws do not depend on how many threads there are."""
_ROWS_WORTH_A_THREAD = 4 * ROWS


def over_blocks(work: Callable[[int, int], None], n_rows: int) -> None:
    """Call `work(first, last)` on ranges of rows that cover `n_rows` and begin at whole blocks.

    What `work` raises is raised.
    """
    n_threads = min(os.cpu_count() or 1, n_rows // _ROWS_WORTH_A_THREAD)
    if n_threads <= 1:
        work(0, n_rows)
        return
    share = -(-n_rows // (4 * n_threads * ROWS)) * ROWS  # four ranges for each thread, for one may be slowed by others
    starts = range(0, n_rows, share)
    with ThreadPoolExecutor(n_threads, thread_name_prefix="dirprim") as threads:
        list(threads.map(lambda first: work(first, min(first + share, n_rows)), starts))


def block_keys(n_rows: int, rng: np.random.Generator) -> UIntArray:
    """A 64-bit key for the stream of each block. -> (n_blocks,)."""
    return rng.integers(0, 2**64, size=-(-n_rows // ROWS), dtype=np.uint64)
