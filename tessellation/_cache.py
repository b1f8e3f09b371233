"""Where compiled kernels are kept."""

import os
from contextlib import suppress
from pathlib import Path


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
