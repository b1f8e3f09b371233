"""A store: a folder of summaries, one for each recording, and a manifest of the logs they came from.

    STORE/store.json                  how logs are read and counted, and the frame of their positions
    STORE/logs/HASH-OF-URL.json       the manifest
    STORE/recordings/HASH-OF-ROWS.parquet
    STORE/receipts/HASH-OF-URL.json   of logs that are finished and not yet in the manifest
    STORE/archives/HASH.json          which recordings count together, as recordings/HASH.parquet

What counts are the archives, and of the recordings that the manifest names those that are in none, each once. A
recording is written before the manifest or an archive names it, and every file takes its name when it is whole: so
whatever is killed, nothing half counts.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Container
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self

from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store.archive import Archive
from dirprim_filter.store.config import FORMAT, StoreConfig
from dirprim_filter.store.log_files import LogFile
from dirprim_filter.store.manifest import Entry, new_file, remove_parts
from dirprim_filter.store.receipts import Receipt
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.table import write_summary

CONFIG_FILE, MANIFEST, RECORDINGS, RECEIPTS = "store.json", "logs", "recordings", "receipts"
ARCHIVES = "archives"


@dataclass(frozen=True, slots=True, kw_only=True)
class Store:
    """A store that exists.

    Attributes:
        path: its folder.
        config: how its logs are read and counted.
    """

    path: Path
    config: StoreConfig

    @classmethod
    def open(cls, path: Path) -> Self:
        """A store that is there.

        Raises:
            RecordingError: there is none, or of another version.
        """
        try:
            said = json.loads((path / CONFIG_FILE).read_bytes())
            return cls(path=path, config=StoreConfig.from_json(said["config"], said["format"]))
        except (FileNotFoundError, NotADirectoryError):
            raise RecordingError(f"{path}: expected a store, found none; make one with `dirprim store add`") from None
        except (ValueError, TypeError, KeyError) as error:
            raise RecordingError(f"{path / CONFIG_FILE}: expected a store of format {FORMAT}, got {error}") from error

    @classmethod
    def create(cls, path: Path, config: StoreConfig) -> Self:
        """A new store, in a folder that is not there yet or empty.

        Raises:
            RecordingError: the folder holds something else.
            OSError: it cannot be made.
        """
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise RecordingError(f"{path}: expected a store or an empty folder, found other files; choose another")
        for name in (MANIFEST, RECORDINGS, RECEIPTS):
            (path / name).mkdir(parents=True, exist_ok=True)
        store = cls(path=path, config=config)
        store._write_config(None)
        return store

    @property
    def frame(self) -> str | None:
        """Of all positions; None while there is no recording."""
        frame = json.loads((self.path / CONFIG_FILE).read_bytes())["frame"]
        return None if frame is None else str(frame)

    def entries(self) -> list[Entry]:
        """The logs that were added, in order of their URLs."""
        return sorted((Entry.read(path) for path in (self.path / MANIFEST).glob("*.json")), key=lambda entry: entry.url)

    def archives(self) -> list[Archive]:
        """Recordings that count together, in order of their names."""
        return sorted((Archive.read(path) for path in (self.path / ARCHIVES).glob("*.json")), key=lambda a: a.name)

    def archived(self) -> dict[str, str]:
        """The recordings that do not count by themselves, and the name of the archive of each."""
        return {rows: archive.name for archive in self.archives() for rows in archive.recordings}

    def recorded(self) -> dict[str, list[list[int]]]:
        """What counts, recordings by the hashes of their rows and archives by their names, and the tiles of each."""
        archived = self.archived()
        single = {entry.rows: entry.tiles for entry in self.entries() if entry.rows not in archived}
        return single | {archive.name: archive.tiles for archive in self.archives()}

    def rows(self) -> list[str]:
        """The names of what counts, see `recorded`, in order."""
        return sorted(self.recorded())

    @property
    def digest(self) -> str:
        """SHA-256 of the names of the recordings, and of how they were counted: what is learned depends on no more."""
        return hashlib.sha256(repr((self.config.digest, self.frame, self.rows())).encode()).hexdigest()

    def recording(self, rows: str) -> Path:
        """The file of a recording, by the hash of its rows."""
        return self.path / RECORDINGS / f"{rows}.parquet"

    def receipt(self, url: str) -> Path:
        """The file of what came of a log, until it counts."""
        return self.path / RECEIPTS / Entry.name_of(url)

    def holds(self, entry: Entry | None, log: LogFile, archived: Container[str] = ()) -> bool:
        """Whether an entry is of a log as it is now, counted as this store counts, and its recording is there.

        Args:
            entry: None of a log that is not known.
            log: it.
            archived: recordings that are in archives.
        """
        return (
            entry is not None and log.mark != "" and entry.config == self.config.digest
            and (entry.url, entry.size, entry.mark) == (log.url, log.size, log.mark)
            and (entry.rows in archived or self.recording(entry.rows).exists())
        )  # fmt: skip

    def record(self, entry: Entry, frame: str) -> None:
        """Count a log whose recording is written.

        Raises:
            ValueError: positions in another frame than those of the store, or of an archived log another version.
        """
        self.check_frame(entry.url, frame)
        replaced = self.entry_of(entry.url)
        if replaced is not None and replaced.rows != entry.rows:
            self._check_single(replaced)
        entry.write(self.path / MANIFEST)
        if entry.rows in self.archived():
            self.recording(entry.rows).unlink(missing_ok=True)
        if replaced is not None and replaced.rows != entry.rows:
            self._drop(replaced.rows)

    def archive(self, archive: Archive, summary: Summary) -> None:
        """Let recordings count together, and no longer by themselves."""
        (self.path / ARCHIVES).mkdir(exist_ok=True)
        with new_file(self.recording(archive.name)) as file:
            write_summary(summary, file)
        archive.write(self.path / ARCHIVES)
        for rows in archive.recordings:
            self.recording(rows).unlink(missing_ok=True)

    def check_frame(self, url: str, frame: str) -> None:
        """Whether positions can be counted beside those of the store; the first log's frame becomes the store's.

        Raises:
            ValueError: they cannot.
        """
        ours = self.frame
        if ours is None:
            self._write_config(frame)
        elif ours != frame:
            raise ValueError(
                f"{url}: expected positions in frame {ours!r} as in the rest of the store, got {frame!r}; use another "
                "store, or another --frame or --origin for this one from its first log on"
            )

    def entry_of(self, url: str) -> Entry | None:
        """The entry of a log; None where it was not added."""
        wanted = self.path / MANIFEST / Entry.name_of(url)
        return Entry.read(wanted) if wanted.exists() else None

    def forget(self, *urls: str) -> list[Entry]:
        """Take logs out: the rest is what it would be had they never been added.

        Raises:
            ValueError: one is not in the store, or in an archive of which others stay.
        """
        found = {url: self.entry_of(url) for url in urls}
        gone = [entry for entry in found.values() if entry is not None]
        for url, entry in found.items():
            if entry is None:
                raise ValueError(f"{url}: is not in the store; `dirprim store info {self.path}` lists what is")
        left = {entry.rows for entry in self.entries() if entry.url not in found}
        empty = [a for a in self.archives() if left.isdisjoint(a.recordings)]
        ends = {rows for archive in empty for rows in archive.recordings}
        for entry in gone:
            if entry.rows not in left | ends:
                self._check_single(entry)
        for archive in empty:
            (self.path / ARCHIVES / f"{archive.name}.json").unlink()
            self.recording(archive.name).unlink(missing_ok=True)
        for entry in gone:
            (self.path / MANIFEST / Entry.name_of(entry.url)).unlink()
            self._drop(entry.rows)
        return gone

    def _check_single(self, entry: Entry) -> None:
        """Whether a log can be taken out by itself.

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
        for name in set(other.recorded()) - here:
            with other.recording(name).open("rb") as source, new_file(self.recording(name)) as file:
                shutil.copyfileobj(source, file)
        (self.path / ARCHIVES).mkdir(exist_ok=True)
        for archive in archives:
            archive.write(self.path / ARCHIVES)
        new = [entry for entry in theirs if entry.url not in mine]
        for entry in new:
            entry.write(self.path / MANIFEST)
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

    def tidy(self) -> None:
        """Remove what killed processes left, but for receipts of logs that do not count yet."""
        for name in (MANIFEST, RECORDINGS, RECEIPTS, ARCHIVES, "."):
            remove_parts(self.path / name)
        for rows in self.archived():
            self.recording(rows).unlink(missing_ok=True)
        for path in (self.path / RECEIPTS).glob("*.json"):
            receipt = Receipt.read(path)
            if self.entry_of(receipt.log.url) == receipt.entry:
                path.unlink(missing_ok=True)

    def _drop(self, rows: str) -> None:
        """Remove a recording that does not count by itself, or no more."""
        if rows not in self.recorded():
            self.recording(rows).unlink(missing_ok=True)

    def _write_config(self, frame: str | None) -> None:
        said = {"format": FORMAT, "config": self.config.to_json(), "frame": frame}
        with new_file(self.path / CONFIG_FILE) as file:
            file.write(json.dumps(said, sort_keys=True, indent=1).encode())
