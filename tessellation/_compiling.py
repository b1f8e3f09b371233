"""How kernels are compiled: once per installation, and without unused wrappers."""

from typing import Any

COMPILED: dict[str, Any] = {"cache": True, "no_cfunc_wrapper": True, "fastmath": False}
"""Options of numba's `njit`. The wrapper for C callbacks would take a tenth of the time that compiling takes.
No kernel has `fastmath`: by it a loop inlined into its caller would round otherwise than the same loop called, and the
run that compiles otherwise than those that load what it compiled. See `dirprim_filter.distributions._arithmetic`."""

UNCOUNTED: dict[str, Any] = {"_nrt": False}
"""For kernels that allocate nothing and run for every particle: numba counts no references in them. Each name for an
array, and each part of one, else costs an atomic count, for which threads wait for each other."""
INLINED: dict[str, Any] = UNCOUNTED | {"forceinline": True}
"""The same for those that take tables of many arrays, which cost more to hand over than to read."""
