"""How kernels are compiled: once per installation, and without unused wrappers."""

import os
from pathlib import Path
from typing import Any


def has_a_place() -> bool:
    """Whether what is compiled can be kept: numba refuses to compile where it cannot, as for users without a home."""
    package, given = Path(__file__).parent, os.environ.get("NUMBA_CACHE_DIR")
    if os.access(package, os.W_OK) or (given and _takes_files(Path(given))):
        return True
    from numba.misc.appdirs import AppDirs  # noqa: PLC0415 - of installations that others own

    own = AppDirs(appname="numba", appauthor=False)  # type: ignore[no-untyped-call]
    return _takes_files(Path(own.user_cache_dir))


def _takes_files(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


COMPILED: dict[str, Any] = {"cache": has_a_place(), "no_cfunc_wrapper": True, "fastmath": False}
"""Options of numba's `njit`. The wrapper for C callbacks would take a tenth of the time that compiling takes.
No kernel has `fastmath`: by it a loop inlined into its caller would round otherwise than the same loop called, and the
run that compiles otherwise than those that load what it compiled. See `dirprim_filter.distributions._arithmetic`."""

UNCOUNTED: dict[str, Any] = {"_nrt": False}
"""For kernels that allocate nothing and run for every particle: numba counts no references in them. Each name for an
array, and each part of one, else costs an atomic count, for which threads wait for each other."""
INLINED: dict[str, Any] = UNCOUNTED | {"forceinline": True}
"""The same for those that take tables of many arrays, which cost more to hand over than to read."""
