"""Logs by path, URL or pattern, and by what one is known not to have changed."""

from __future__ import annotations

import errno
import glob
import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dirprim_filter.recording.container.errors import without_secrets
from dirprim_filter.recording.errors import MissingExtraError, RecordingError

MARKS = ("ETag", "etag", "LastModified", "last_modified", "mtime", "updated")
"""What file systems call it."""
ACCESS = re.compile(
    r"[^=]*(sig|token|key|secret|pass|auth|cred|expires|policy)|x-(amz|goog)-|s[a-z]{1,2}=", re.IGNORECASE
)
"""In a URL's query: what is signed, by whom and for how long; of S3, Google and Azure, and as others call it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundLog:
    """A log that can be read.

    Attributes:
        url: its URL, or its absolute path, by which it is read.
        name: what a store calls it, see `name_of`.
        version: its size, and its ETag or time of change where that is known: the same for as long as the log is.
    """

    url: str
    name: str
    version: str


def find_logs(patterns: Iterable[str]) -> list[FoundLog]:
    """The logs of paths, URLs, and patterns with `*` and `**` of either, each once, in order of their names.

    Raises:
        RecordingError: a pattern finds nothing, a URL cannot be asked, or standard input is asked for.
        OSError: a file cannot be read.
    """
    found: dict[str, FoundLog] = {}
    for pattern in patterns:
        if pattern == "-":
            raise RecordingError(
                "-: expected a file or a URL, for a store knows logs by their names; write it to a file"
            )
        logs = _remote(pattern) if "://" in pattern else _local(pattern)
        if not logs:
            raise RecordingError(f"{pattern}: expected logs, found none; check the pattern, and quote it")
        found |= {log.name: log for log in logs}
    return [found[name] for name in sorted(found)]


def name_of(text: str) -> str:
    """What a store calls a log: its absolute path, or its URL without what gives access; a name is its own name.

    Of a query a hash stays, so that two logs have two names, but of none of what changes as a URL is signed anew.
    """
    if "://" not in text:
        return str(Path(text).resolve())
    place, asks, query = text.partition("?")
    if not asks or query.startswith("..."):
        return without_secrets(text)
    lasting = "&".join(of for of in query.split("&") if not ACCESS.match(of))
    digest = hashlib.sha256(lasting.encode(errors="surrogateescape")).hexdigest()[:12] if lasting else ""
    return f"{without_secrets(place)}?...{digest}"


def _local(pattern: str) -> list[FoundLog]:
    paths = [pattern] if Path(pattern).exists() else glob.glob(pattern, recursive=True)  # noqa: PTH207 (Path has no absolute patterns)
    if not paths and not glob.has_magic(pattern):
        raise FileNotFoundError(errno.ENOENT, "No such file", pattern)
    found = ((name_of(path), Path(path).stat()) for path in paths if Path(path).is_file())
    return [FoundLog(url=name, name=name, version=f"{stat.st_size} {stat.st_mtime_ns}") for name, stat in found]


def _remote(pattern: str) -> list[FoundLog]:
    try:
        import fsspec  # noqa: PLC0415 (an extra)
    except ImportError as error:
        raise MissingExtraError(pattern, library="fsspec", extra="fleet") from error
    # A query of http, as of a signed URL, is no pattern.
    is_pattern = glob.has_magic(pattern.partition("?")[0] if pattern.startswith("http") else pattern)
    try:
        files, path = fsspec.core.url_to_fs(pattern)
        files.invalidate_cache()  # of an earlier listing in this process
        # All at once: each asked for by itself, s3fs goes through all of its listing.
        about: dict[str, Any] = files.glob(path, detail=True) if is_pattern else {path: files.info(path)}
    except FileNotFoundError as error:
        raise FileNotFoundError(errno.ENOENT, "No such file", pattern) from error
    except Exception as error:  # of the scheme's own package
        raise RecordingError(f"{pattern}: expected a URL that fsspec can ask: {error}; copy the logs here") from error
    logs = []
    for own, info in about.items():
        if info.get("type") != "directory":
            url, mark = files.unstrip_protocol(own), next((str(info[name]) for name in MARKS if info.get(name)), "")
            logs.append(FoundLog(url=url, name=name_of(url), version=f"{info.get('size') or 0} {mark}"))
    return logs
