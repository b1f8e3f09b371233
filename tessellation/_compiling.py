"""How kernels are compiled: once per installation, and without unused wrappers."""

from typing import Any

COMPILED: dict[str, Any] = {"cache": True, "no_cfunc_wrapper": True, "fastmath": False}
"""Options of numba's `njit`. The wrapper for C callbacks would take a tenth of the time that compiling takes.
A kernel without `fastmath` of its own gets that of whichever kernel is the first to call it; fused sums break ties."""
