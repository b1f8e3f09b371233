"""Where an output came from: the metadata that lets a run be repeated."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any


def provenance(command: str, *, inputs: Sequence[Path], config: Any = None, **options: object) -> dict[str, str]:
    """The command, its options, its configuration, the version and the inputs' checksums, as text."""
    from dirprim_filter.recording.container.errors import without_secrets

    said = {"command": command, "version": version("dirprim-filter")}
    said |= {name: without_secrets(str(value)) for name, value in options.items() if value is not None}
    if config is not None:
        said["config"] = json.dumps(asdict(config), sort_keys=True)
    names = [without_secrets(str(path)).rpartition("/")[2] for path in inputs]
    for path, name in zip(inputs, names, strict=True):
        said[f"sha256 {name if names.count(name) == 1 else without_secrets(str(path))}"] = checksum(path)
    return said


def metadata_of(path: Path) -> dict[str, str]:
    """What the metadata records of a log say."""
    from dirprim_filter.recording.scan import scan

    with scan(path) as log:
        return {key: value for _, entries in log.metadata for key, value in entries.items()}


def checksum(path: Path) -> str:
    """The file's SHA-256, in hexadecimal; of several files that of theirs."""
    from dirprim_filter.recording.container.source import open_files

    sums = []
    for _, bytes_of in open_files(path):
        whole = hashlib.sha256()
        for block in bytes_of.blocks():
            whole.update(block)
        bytes_of.close()
        sums.append(whole.hexdigest())
    return sums[0] if len(sums) == 1 else hashlib.sha256(" ".join(sums).encode()).hexdigest()
