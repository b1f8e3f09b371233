"""The files of a store by their names: written as a whole, and deleted only where a store wrote them.

The library of Delta tables does so; what is wrong with it becomes one line, without secrets.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from dirprim_filter.recording.container.errors import without_secrets
from dirprim_filter.recording.errors import MissingExtraError, RecordingError
from dirprim_filter.store.files import FIT, PATH

FITS = "_fits"
"""Folder of what was fitted; Delta leaves alone what begins so."""
LOG = re.compile(r"_delta_log/(\d{20}\..*|_last_checkpoint|_commit_.*\.tmp)")
"""Of Delta's library."""
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


@dataclass(frozen=True)
class Folder:
    """A folder by its absolute path, or its URL in an object store; small, so that workers are sent it."""

    path: str

    def __str__(self) -> str:
        return shown(self.path)

    def put(self, name: str, data: bytes) -> None:
        """Write a file as a whole.

        Raises:
            RecordingError: it cannot be written.
        """
        with asking(self.path):
            stream = self._files.open_output_stream(name)
            stream.write(data)
            stream.close()

    def get(self, name: str) -> bytes | None:
        """What a file holds; None where there is none.

        Raises:
            RecordingError: it cannot be read.
        """
        with asking(self.path), suppress(FileNotFoundError):
            stream = self._files.open_input_file(name)
            return bytes(stream.read(stream.size()))
        return None

    def delete(self, names: Iterable[str]) -> None:
        """Those of them that a store wrote, if they are there."""
        for name in filter(_is_own, names):
            with suppress(OSError):  # what stays is what no one knows of
                self._files.delete_file(name)

    def listed(self, folder: str, *, deep: bool = True) -> list[Any]:
        """What pyarrow knows of the files in a folder of it, and of folders.

        Raises:
            RecordingError: it cannot be listed.
        """
        with asking(self.path):
            return list(self._files.get_file_info_selector(folder, True, deep))

    def require_room(self) -> None:
        """Whether a store may be made here: where nothing is but what one leaves that is killed as it makes one.

        Raises:
            RecordingError: something is there.
        """
        path = Path(self.path)
        if "://" not in self.path and not path.is_dir():
            if path.exists():
                raise RecordingError(f"{self}: expected a store, or the name of a new folder, got that of a file")
            return
        for top in self.listed("", deep=False):
            is_own = top.path in ("rows", FITS, "_delta_log") and not top.is_file
            within = [at.path for at in self.listed(top.path) if at.is_file] if is_own else [top.path]
            if other := next((name for name in within if not _is_own(name) and not LOG.fullmatch(name)), None):
                raise RecordingError(
                    f"{self}: expected a store or an empty folder, got one with {other} in it; choose another name, "
                    "such as that of a new folder in it"
                )

    @cached_property
    def _files(self) -> Any:
        from deltalake._internal import DeltaFileSystemHandler  # noqa: PLC0415 (pyarrow's wrapper of it cannot write)

        if "://" not in self.path:
            Path(self.path).mkdir(parents=True, exist_ok=True)
        return DeltaFileSystemHandler(self.path)

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}


def _is_own(name: str) -> bool:
    """Whether a store gives this name to what it writes."""
    return bool(PATH.fullmatch(name) or FIT.fullmatch(name))
