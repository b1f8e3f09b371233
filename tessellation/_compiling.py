"""How kernels are compiled: once per installation, and without unused wrappers."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any


def has_a_place() -> bool:
    """Whether what is compiled can be kept: numba refuses to compile where it cannot, as for users without a home."""
    if os.access(Path(__file__).parent, os.W_OK):
        return True
    from numba.misc.appdirs import AppDirs  # noqa: PLC0415 - of installations that others own

    own: str = AppDirs(appname="numba", appauthor=False).user_cache_dir  # type: ignore[no-untyped-call]
    for folder in (os.environ.get("NUMBA_CACHE_DIR") or own, own):
        with suppress(OSError):
            Path(folder).mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK | os.X_OK):
                return True
    return False


COMPILED: dict[str, Any] = {"cache": has_a_place(), "no_cfunc_wrapper": True, "fastmath": False}
"""Options of numba's `njit`. The wrapper for C callbacks would take a tenth of the time that compiling takes.
No kernel has `fastmath`: by it a loop inlined into its caller would round otherwise than the same loop called, and the
run that compiles otherwise than those that load what it compiled. See `dirprim_filter.distributions._arithmetic`."""

UNCOUNTED: dict[str, Any] = {"_nrt": False}
"""For kernels that allocate nothing and run for every particle: numba counts no references in them. Each name for an
array, and each part of one, else costs an atomic count, for which threads wait for each other."""
INLINED: dict[str, Any] = UNCOUNTED | {"forceinline": True}
"""The same for those that take tables of many arrays, which cost more to hand over than to read."""
