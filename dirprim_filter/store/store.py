"""A store: a folder, here or far away, of summaries, one for each recording, and a manifest of their logs.

    STORE/store.json                  how logs are read and counted
    STORE/frame.json                  the frame of their positions, from the first on
    STORE/logs/HASH-OF-URL.json       the manifest
    STORE/recordings/HASH-OF-ROWS.parquet
    STORE/archives/HASH.json          which recordings count together, as recordings/HASH.parquet

What counts are the archives, and of the recordings that the manifest names those that are in none, each once. A
recording is written before the manifest or an archive names it, and every file is there when it is whole (`folder`): so
whatever is killed, nothing half counts. How logs are read and counted, and their frame, are written once: of two who
begin at the same time, the second is refused or follows the first.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Container, Iterable
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Self

from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store.archive import ARCHIVES, Archive
from dirprim_filter.store.config import FORMAT, StoreConfig
from dirprim_filter.store.folder import Folder, LocalFolder, folder_at
from dirprim_filter.store.knots import Knots
from dirprim_filter.store.log_files import LogFile
from dirprim_filter.store.manifest import MANIFEST, Entry
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.table import write_knots, write_summary
from dirprim_filter.store.workers import Workers

if TYPE_CHECKING:
    from dirprim_filter.store.remote_folder import RemoteFile

CONFIG_FILE, FRAME_FILE, RECORDINGS = "store.json", "frame.json", "recordings"
PARTS = (MANIFEST, RECORDINGS, ARCHIVES)
ROWS = ".parquet"
MERGED_AT_ONCE = 8
"""Recordings, whose files are held in memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Store:
    """A store that exists.

    Attributes:
        folder: where its files are.
        config: how its logs are read and counted.
    """

    folder: Folder
    config: StoreConfig

    @classmethod
    def open(cls, path: str | PathLike[str]) -> Self:
        """A store that is there: its folder, or a URL that fsspec knows, such as s3://bucket/fleet.

        Raises:
            RecordingError: there is none, or of another version, or its server cannot be asked.
        """
        folder = folder_at(path)
        try:
            said = json.loads(folder.read(CONFIG_FILE))
            return cls(folder=folder, config=StoreConfig.from_json(said["config"], said["format"]))
        except (FileNotFoundError, NotADirectoryError):
            raise RecordingError(f"{folder}: expected a store, found none; make one with `dirprim store add`") from None
        except (ValueError, TypeError, KeyError) as error:
            raise RecordingError(f"{folder}/{CONFIG_FILE}: expected a store of format {FORMAT}, got {error}") from error

    @classmethod
    def create(cls, path: str | PathLike[str], config: StoreConfig) -> Self:
        """A new store, where nothing is yet.

        Args:
            path: as for `open`.
            config: how its logs will be read and counted.

        Raises:
            RecordingError: other files are there, or the server cannot be asked.
            OSError: it cannot be made.
        """
        folder = folder_at(path)
        said = json.dumps({"format": FORMAT, "config": config.to_json()}, sort_keys=True, indent=1).encode()
        if folder.is_free():
            folder.make("")
            if folder.create(CONFIG_FILE, said):
                folder.make(MANIFEST, RECORDINGS)
                return cls(folder=folder, config=config)
        raise RecordingError(f"{folder}: expected a store or an empty folder, found other files; choose another")

    @staticmethod
    def is_at(path: str | PathLike[str]) -> bool:
        """Whether there is one, of whatever version.

        Raises:
            RecordingError: a server cannot be asked.
        """
        return folder_at(path).has(CONFIG_FILE)

    @property
    def path(self) -> Path | str:
        """Its folder, or its URL."""
        return self.folder.path if isinstance(self.folder, LocalFolder) else str(self.folder)

    @property
    def frame(self) -> str | None:
        """Of all positions; None while there is no recording. Once it is known it stays.

        Raises:
            RecordingError: its file is damaged.
        """
        found = self.folder.read_some([FRAME_FILE, CONFIG_FILE])
        try:
            if FRAME_FILE in found:
                return str(json.loads(found[FRAME_FILE])["frame"])
            frame = json.loads(found[CONFIG_FILE]).get("frame")  # of stores of before
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise RecordingError(f"{self._named(FRAME_FILE)}: expected a frame, got {error!r}; restore it") from error
        return None if frame is None else str(frame)

    def entries(self) -> list[Entry]:
        """The logs that were added, in order of their URLs."""
        found = self.folder.read_all(MANIFEST)
        return sorted((Entry.from_json(data, self._named(name)) for name, data in found.items()), key=lambda e: e.url)

    def entries_of(self, urls: Iterable[str]) -> dict[str, Entry]:
        """Those of some logs by their URLs, but for logs that were not added."""
        names = {Entry.file_of(url): url for url in urls}
        found = self.folder.read_some(names)
        return {names[name]: Entry.from_json(data, self._named(name)) for name, data in found.items()}

    def archives(self) -> list[Archive]:
        """Recordings that count together, in order of their names."""
        found = self.folder.read_all(ARCHIVES)
        return [Archive.from_json(data, self._named(name)) for name, data in sorted(found.items())]

    def archived(self) -> dict[str, str]:
        """The recordings that do not count by themselves, and the name of the archive of each."""
        return {rows: archive.name for archive in self.archives() for rows in archive.recordings}

    def recorded(self) -> dict[str, list[list[int]]]:
        """What counts, recordings by the hashes of their rows and archives by their names, and the tiles of each."""
        archives = self.archives()
        archived = {rows for archive in archives for rows in archive.recordings}
        single = {entry.rows: entry.tiles for entry in self.entries() if entry.rows not in archived}
        return single | {archive.name: archive.tiles for archive in archives}

    def rows(self) -> list[str]:
        """The names of what counts, see `recorded`, in order."""
        return sorted(self.recorded())

    @property
    def digest(self) -> str:
        """SHA-256 of the names of the recordings, and of how they were counted: what is learned depends on no more."""
        return hashlib.sha256(repr((self.config.digest, self.frame, self.rows())).encode()).hexdigest()

    def recording(self, rows: str) -> Path | RemoteFile:
        """The file of a recording, by the hash of its rows, or of an archive by its name; to be read by `open`."""
        return self.folder.file(_recording(rows))

    def has_recording(self, rows: str) -> bool:
        """Whether that file is there."""
        return self.folder.has(_recording(rows))

    def recording_sizes(self) -> dict[str, int]:
        """Bytes of the files of recordings and archives that are there, whether they count or not."""
        return {
            name.rpartition("/")[2].removesuffix(ROWS): size for name, size in self.folder.sizes(RECORDINGS).items()
        }

    def write_recording(self, rows: str, summary: Summary) -> None:
        """Write what `recording` is."""
        with self.folder.new_file(_recording(rows)) as file:
            write_summary(summary, file)

    def holds(self, entry: Entry | None, log: LogFile, there: Container[str]) -> bool:
        """Whether an entry is of a log as it is now, counted as this store counts, and its recording is there.

        Args:
            entry: None of a log that is not known.
            log: it.
            there: recordings that are there, by themselves or in archives.
        """
        return (
            entry is not None and log.mark != "" and entry.config == self.config.digest and entry.rows in there
            and (entry.url, entry.size, entry.mark) == (log.url, log.size, log.mark)
        )  # fmt: skip

    def record(self, entry: Entry) -> None:
        """Count a log, in the place of what was counted of it, whose recording is written and its frame checked."""
        self._write(entry)

    def archive(self, archive: Archive, knots: Knots, summary: Summary) -> None:
        """Let recordings count together, and no longer by themselves: as a summary, whose steps follow from knots."""
        with self.folder.new_file(_recording(archive.name)) as file:
            write_knots(knots, summary, file)
        self.folder.write({archive.file: archive.to_json()})
        self.folder.remove(*map(_recording, archive.recordings))

    def check_frame(self, url: str, frame: str) -> None:
        """Whether positions can be counted beside those of the store; the first log's frame becomes the store's.

        Raises:
            ValueError: they cannot.
        """
        ours = self.frame
        if ours is None:
            self.folder.create(FRAME_FILE, json.dumps({"frame": frame}).encode())
            ours = self.frame  # of who came first
        if ours != frame:
            raise ValueError(
                f"{url}: expected positions in frame {ours!r} as in the rest of the store, got {frame!r}; use another "
                "store, or another --frame or --origin for this one from its first log on"
            )

    def entry_of(self, url: str) -> Entry | None:
        """The entry of a log; None where it was not added."""
        return self.entries_of([url]).get(url)

    def forget(self, *urls: str) -> list[Entry]:
        """Take logs out: the rest is what it would be had they never been added.

        Raises:
            ValueError: one is not in the store, or in an archive of which others stay.
        """
        found = self.entries_of(urls)
        for url in urls:
            if url not in found:
                raise ValueError(f"{url}: is not in the store; `dirprim store info {self.path}` lists what is")
        gone = [found[url] for url in dict.fromkeys(urls)]
        left = {entry.rows for entry in self.entries() if entry.url not in found}
        empty = [a for a in self.archives() if left.isdisjoint(a.recordings)]
        ends = {rows for archive in empty for rows in archive.recordings}
        for entry in gone:
            if entry.rows not in left | ends:
                self.check_single(entry)
        for archive in empty:
            self.folder.remove(archive.file)
            self.folder.remove(_recording(archive.name))
        self.folder.remove(*(Entry.file_of(entry.url) for entry in gone))
        self.drop(*(entry.rows for entry in gone))
        self.gather()
        return gone

    def check_single(self, entry: Entry) -> None:
        """Whether a log can be taken out, or another be counted in its place.

        Raises:
            ValueError: it is archived.
        """
        of = {rows: archive for archive in self.archives() for rows in archive.recordings}.get(entry.rows)
        if of is not None:
            raise ValueError(
                f"{entry.url}: `store compact` made one of {len(of.recordings)} recordings of {of.month}; none can be "
                "taken out or replaced alone: forget all logs of that month together"
            )

    def merge(self, other: Store) -> int:
        """Add all recordings of another store; -> how many logs are new.

        Raises:
            ValueError: it was read or counted otherwise, is in another frame, holds another version of a log, or in an
                archive what is here by itself or in another.
        """
        self.check_config(other.config)
        theirs = other.entries()
        if theirs:
            self.check_frame(str(other.path), other.frame or "")
        mine = {entry.url: entry for entry in self.entries()}
        for entry in theirs:
            if entry.url in mine and mine[entry.url].rows != entry.rows:
                raise ValueError(f"{entry.url}: the stores hold two versions of it; forget one of them first")
        ours, here = {archive.name for archive in self.archives()}, set(self.recorded()) | set(self.archived())
        archives = [archive for archive in other.archives() if archive.name not in ours]
        for archive in archives:
            if not here.isdisjoint(archive.recordings):
                raise ValueError(
                    f"{other.path}: holds {archive.month} in an archive with recordings that {self.path} holds "
                    "otherwise; merge stores before they are compacted"
                )
        missing = sorted(_recording(name) for name in other.recorded().keys() - here)
        for i in range(0, len(missing), MERGED_AT_ONCE):
            self.folder.write({name: other.folder.read(name) for name in missing[i : i + MERGED_AT_ONCE]})
        self.folder.write({archive.file: archive.to_json() for archive in archives})
        new = [entry for entry in theirs if entry.url not in mine]
        self._write(*new)
        self.gather()
        return len(new)

    def check_config(self, asked: StoreConfig) -> None:
        """Whether logs read and counted so can be added.

        Raises:
            ValueError: they cannot.
        """
        for field in fields(StoreConfig):
            ours, theirs = getattr(self.config, field.name), getattr(asked, field.name)
            if ours != theirs:
                raise ValueError(f"{self.path}: expected {field.name} {ours}, as its logs are counted, got {theirs}")

    def check_seen_by(self, workers: Workers) -> None:
        """Whether workers see what this process does.

        Raises:
            ValueError: they do not.
        """
        if not (workers.in_process or self.folder.is_shared):
            raise ValueError(
                f"{self.path}: is in the memory of this process, and --workers and --scheduler see nothing of it; use "
                "--workers 1, or a store in a folder"
            )

    def tidy(self) -> None:
        """Remove what killed processes left."""
        self.folder.remove_parts(*PARTS, ".")
        if archived := self.archived():
            self.folder.remove(*map(_recording, sorted(archived.keys() & self.recording_sizes().keys())))

    def gather(self, *, anew: bool = True) -> None:
        """Let others read the manifest fast; `anew` if entries came or went."""
        self.folder.gather(MANIFEST, anew=anew)

    def drop(self, *recordings: str) -> None:
        """Remove recordings that do not count by themselves, or no more."""
        if recordings:
            counts = self.recorded()
            self.folder.remove(*(_recording(rows) for rows in recordings if rows not in counts))

    def _named(self, name: str) -> str:
        """A file of it, as users know it."""
        return f"{self.folder}/{name}"

    def _write(self, *entries: Entry) -> None:
        """Put entries into the manifest, in the place of what was there of their logs."""
        self.folder.write({Entry.file_of(entry.url): entry.to_json() for entry in entries})


def _recording(rows: str) -> str:
    return f"{RECORDINGS}/{rows}{ROWS}"
