"""The library of Delta tables: where tables are, and what is wrong with them in one line, without secrets."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dirprim_filter.recording.container.errors import without_secrets
from dirprim_filter.recording.errors import MissingExtraError, RecordingError

ANSI = re.compile(r"\x1b\[[0-9;]*m")


def address_of(path: str | Path) -> str:
    """As Delta takes it: an absolute path, or a URL, which `Path` takes a slash of."""
    text = re.sub(r"^file:/+", "/", str(path))
    if ":/" in text:
        return re.sub(r":/+", "://", text, count=1)
    return str(Path(text).resolve())


def shown(path: str | Path) -> str:
    """As messages name it: without what is secret in a URL."""
    return without_secrets(address_of(path) if ":/" in str(path) else str(path))


@contextmanager
def asking(path: str | Path) -> Iterator[Any]:
    """Within, the library of Delta tables is asked; what is wrong becomes one line, without colours and secrets.

    Raises:
        MissingExtraError: it is not installed.
        RecordingError: whatever it raises.
    """
    try:
        import deltalake  # noqa: PLC0415 (an extra)
    except ImportError as error:
        raise MissingExtraError(shown(path), library="deltalake", extra="fleet") from error
    try:
        yield deltalake
    except (OSError, deltalake.exceptions.DeltaError, ValueError, TypeError) as error:
        reason = " ".join(ANSI.sub("", str(error)).replace("↳", "").split())
        raise RecordingError(f"{shown(path)}: {reason or type(error).__name__}") from error
