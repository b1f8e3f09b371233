"""A folder far away: what fsspec finds under a URL, such as a prefix of an object store.

A put is whole or nothing there, so files need no other name while they are written. Other processes may write at any
time: every request asks the server, no listing is kept. What files of the manifest hold is kept by their marks, and
fetched again when these change: from the bundle that lies beside their folder, as far as it has them; recordings are
copied. Copies are in a temporary folder that processes of a machine share which were given the same opened store; it
goes with the one that made it.
"""

from __future__ import annotations

import errno
import io
import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, NamedTuple
from uuid import uuid4

from dirprim_filter.recording.errors import MissingExtraError, RecordingError
from dirprim_filter.store.bundle import LARGEST, Marked, bundled, lacking, unbundled
from dirprim_filter.store.folder import new_file

ETAGS, TIMES = ("ETag", "etag"), ("LastModified", "last_modified", "updated")
"""What file systems call them; both are a file's mark. Of two changes within its resolution a time misses one, and an
ETag may be that of the contents: while a file is listed and fetched it may be another, and later what it was again."""
BUNDLE = ".bundle"
FEW, SHARE = 100, 0.05
"""Files, of all: that so many are to be fetched each by itself is no reason to write their bundle anew."""
MANY = 500
"""Files: so many take longer to be fetched than ten times as many to be listed."""
SPARE = 0.25
"""Of the disk with the temporary folder: where less is free, no more copies are kept."""


@dataclass(frozen=True, slots=True)
class RemoteFolder:
    """What is under a URL; see `Folder`.

    Attributes:
        url: without a slash at its end.
        opened: copies are kept for as long as this is the same, and by all processes alike.
    """

    url: str
    opened: str = field(default_factory=lambda: uuid4().hex, compare=False, repr=False)

    def __str__(self) -> str:
        """Its URL."""
        return self.url

    @property
    def is_shared(self) -> bool:
        """All schemes but one are of a server or a disk."""
        return not self.url.startswith("memory://")

    def is_free(self) -> bool:
        """Object stores know no empty folders."""
        with self._asking("") as (files, path):
            try:
                return not files.ls(path, detail=False)
            except FileNotFoundError:
                return True

    def make(self, *parts: str) -> None:
        """Never a bucket, which a slip of the pen would make."""
        for part in ("", *parts):
            with self._asking(part, "written") as (files, path), suppress(FileExistsError):
                files.mkdir(path, create_parents=False)

    def has(self, name: str) -> bool:
        """By its metadata."""
        with self._asking(name) as (files, path):
            try:
                return bool(files.info(path)["type"] == "file")
            except FileNotFoundError:
                return False

    def sizes(self, part: str) -> dict[str, int]:
        """By one listing, of a thousand files a request."""
        return {name: int(about.get("size") or 0) for name, about in self._listed(part).items()}

    def read(self, name: str) -> bytes:
        """All of it, by one request."""
        with self._asking(name) as (files, path):
            return bytes(files.cat_file(path, start=0))  # else s3fs asks for its size first

    def read_some(self, names: Iterable[str]) -> dict[str, bytes]:
        """By one request each, ten at a time; of a great many of one folder those that are neither kept nor bundled."""
        names = list(names)
        parts = {name.partition("/")[0] for name in names}
        if len(names) <= MANY or len(parts) > 1:
            return self._fetched(names)
        held = self.read_all(parts.pop())
        return {name: held[name] for name in names if name in held}

    def read_all(self, part: str) -> dict[str, bytes]:
        """Listed, and of those fetched that are new or changed."""
        return {name: data for name, (_, data) in self._held(part).items()}

    def gather(self, part: str, *, anew: bool) -> None:
        """By their bundle, where it lacks many, or has many that are gone."""
        marks = self._marks(part) if anew else {name: mark for name, (mark, _) in self._kept().read(part).items()}
        if not (anew or marks):
            return
        there = self._bundle(part)
        apart = len(lacking(there, marks)) + len(there.keys() - marks.keys())
        if apart > max(FEW, SHARE * len(marks)):
            data = bundled(self._held(part))
            if data is not None:
                self.write({part + BUNDLE: data})

    def write(self, files: Mapping[str, bytes]) -> None:
        """By one request each, many at a time."""
        with self._asking("", "written") as (there, path):
            there.pipe({f"{path}/{name}": data for name, data in files.items()})

    def create(self, name: str, data: bytes) -> bool:
        """By a put on that condition; of a server that knows none, if the file was not there just before."""
        with self._asking(name, "written") as (files, path):
            try:
                files.pipe_file(path, data, mode="create")
            except FileExistsError:
                return False
            except OSError as error:  # s3fs says nothing more of a condition that does not hold
                if files.exists(path):
                    return False
                if error.errno not in (errno.EINVAL, errno.ENOSYS):
                    raise
                files.pipe_file(path, data)
        return True

    @contextmanager
    def new_file(self, name: str) -> Iterator[BinaryIO]:
        """In memory until it is whole."""
        file = io.BytesIO()
        yield file
        self.write({name: file.getvalue()})

    def remove(self, *names: str) -> None:
        """Many at a time, where that can be asked."""
        with self._asking("", "written") as (files, path):
            paths = [f"{path}/{name}" for name in names]
            with suppress(FileNotFoundError):
                if len(paths) == 1:
                    files.rm_file(paths[0])
                elif paths:
                    files.rm(paths)

    def remove_parts(self, *parts: str) -> None:
        """There are none."""

    def file(self, name: str) -> RemoteFile:
        """Fetched when it is opened."""
        return RemoteFile(self, name)

    def open(self, name: str) -> BinaryIO:
        """A file, from its copy or else fetched."""
        copies = self._kept().copies()
        copy = copies / PurePosixPath(name).name
        with suppress(OSError):  # there is none
            return copy.open("rb")
        data = self.read(name)
        with suppress(OSError):  # without a copy it is fetched again
            disk = shutil.disk_usage(copies)
            if disk.free - len(data) > SPARE * disk.total:
                with new_file(copy) as file:
                    file.write(data)
        return io.BytesIO(data)

    def _listed(self, part: str) -> dict[str, dict[str, Any]]:
        """What is known of the files of a folder in it, by their names."""
        with self._asking(part) as (files, path):
            try:
                found = files.ls(path, detail=True)  # of an empty folder s3fs needs fewer requests than to find
            except FileNotFoundError:
                return {}
        return {f"{part}/{PurePosixPath(about['name']).name}": about for about in found if about["type"] == "file"}

    def _marks(self, part: str) -> dict[str, str]:
        """Of the files of a folder in it whose names end in .json, in order of these; empty where there is no ETag."""
        marks = {}
        for name, about in sorted(self._listed(part).items()):
            if name.endswith(".json"):
                etag, time = (next((str(about[key]) for key in keys if about.get(key)), "") for keys in (ETAGS, TIMES))
                marks[name] = etag and f"{etag} {time}"
        return marks

    def _held(self, part: str) -> Marked:
        """The files of a folder in it, kept for the next time, and those fetched that are not kept already."""
        marks, known = self._marks(part), self._kept().read(part)
        fetched = lacking(known, marks)
        if len(fetched) > FEW:
            bundle = self._bundle(part)
            known = known | {name: bundle[name] for name in fetched & bundle.keys()}
            fetched = lacking(known, marks)
        new = self._fetched(sorted(fetched))
        held = {
            name: (mark, new[name]) if name in fetched else known[name] for name, mark in marks.items()
            if name not in fetched or name in new
        }  # fmt: skip
        self._kept().keep(part, held, write=held != self._kept().read(part))
        return held

    def _fetched(self, names: list[str]) -> dict[str, bytes]:
        """Those of some files that are there."""
        if not names:
            return {}
        with self._asking("") as (files, path):
            got = files.cat_ranges([f"{path}/{name}" for name in names], 0, None, on_error="return")
        found = {}
        for name, one in zip(names, got, strict=True):
            if isinstance(one, FileNotFoundError):  # it may go at any time
                continue
            with self._asking(name):
                if isinstance(one, BaseException):
                    raise one
            found[name] = bytes(one)
        return found

    def _bundle(self, part: str) -> Marked:
        """The bundle of a folder in it; empty where there is none."""
        with suppress(FileNotFoundError), self._asking(part + BUNDLE) as (files, path):
            try:
                return unbundled(bytes(files.cat_file(path, start=0, end=LARGEST)))
            except OSError as error:
                if error.errno != errno.EINVAL:  # as an empty file is refused, which has no range
                    raise
        return {}

    def _kept(self) -> _Kept:
        kept = _known.get(self.url)
        if kept is None or kept.opened != self.opened:
            kept = _known[self.url] = _Kept(self.opened)
        return kept

    @contextmanager
    def _asking(self, name: str, what: str = "read") -> Iterator[tuple[Any, str]]:
        """The file system and a path in it; its errors become ours."""
        url = f"{self.url}/{name}" if name else self.url
        try:
            import fsspec  # noqa: PLC0415 (an extra)
        except ImportError as error:
            raise MissingExtraError(url, library="fsspec", extra="fleet") from error
        try:
            files, path = fsspec.core.url_to_fs(url)
            files.invalidate_cache()
            yield files, path.rstrip("/")
        except FileNotFoundError as error:
            if what == "read":
                raise FileNotFoundError(errno.ENOENT, "No such file", url) from error
            raise _refused(url, what, error) from error
        except ImportError as error:
            raise RecordingError(
                f"{url}: expected the package for such URLs: {error}; 'dirprim-filter[fleet]' has that of s3"
            ) from error
        except Exception as error:  # of the package for such URLs, and of its own kinds
            raise _refused(url, what, error) from error


def _refused(url: str, what: str, error: Exception) -> RecordingError:
    why = str(error) or type(error).__name__
    return RecordingError(
        f"{url}: expected a folder that can be {what}: {why}; check the URL, your credentials and their rights"
    )


class RemoteFile(NamedTuple):
    """A file far away."""

    folder: RemoteFolder
    name: str

    def __str__(self) -> str:
        """Its URL."""
        return f"{self.folder}/{self.name}"

    def open(self, mode: str = "rb") -> BinaryIO:
        """Its bytes; `mode` is rb, as for a path.

        Raises:
            ValueError: another mode.
            FileNotFoundError: it is not there.
            RecordingError: it cannot be read.
        """
        if mode != "rb":
            raise ValueError(f"mode: expected rb, got {mode!r}")
        return self.folder.open(self.name)


class _Kept:
    """What this process keeps of a remote folder."""

    def __init__(self, opened: str) -> None:
        self.opened = opened
        self._read: dict[str, Marked] = {}

    def copies(self) -> Path:
        """The folder of copies; others may remove it at any time."""
        folder = Path(tempfile.gettempdir()) / f"dirprim-store-{self.opened}"
        with suppress(OSError):  # it is there, or there is no room: then nothing is copied
            folder.mkdir(mode=0o700)
            weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        return folder

    def read(self, part: str) -> Marked:
        """What was kept of a folder in it, by this process or another."""
        if part not in self._read:
            with suppress(OSError):  # there is none
                self._read[part] = unbundled((self.copies() / (part + BUNDLE)).read_bytes())
        return self._read.get(part, {})

    def keep(self, part: str, files: Marked, *, write: bool) -> None:
        """Keep what is in a folder in it; for other processes if it is to be written."""
        self._read[part] = files
        data = bundled(files) if write else None
        if data is not None:
            with suppress(OSError), new_file(self.copies() / (part + BUNDLE)) as file:  # else they fetch it themselves
                file.write(data)


_known: dict[str, _Kept] = {}
"""By URLs."""
