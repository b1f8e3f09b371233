"""Results as JSON: the figures, and the settings that reproduce them; reading those settings again."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dirprim_filter.cli.settings import Settings, deal

if TYPE_CHECKING:
    from dirprim_filter.cli.reading import Reading
    from dirprim_filter.config import FilterConfig, TrackingConfig

FORMAT_VERSION = 2
"""Of the objects that `--json` writes; 1 had neither `format` nor `inputs`."""
CONFIG_KEY = "experiment"
"""Of the metadata record and the JSON object that hold an experiment."""


def result_object(
    command: str, *, inputs: Sequence[Path], experiment: Mapping[str, Any], reading: Reading, table: Mapping[str, Any]
) -> dict[str, Any]:
    """The table, and what reproduces it: version, checksums of the files, experiment, reading options."""
    from importlib.metadata import version

    from dirprim_filter.cli.provenance import checksum

    return {
        "format": f"dirprim {command}",
        "format_version": FORMAT_VERSION,
        "version": version("dirprim-filter"),
        "inputs": [{"name": path.name, "sha256": checksum(path)} for path in inputs],
        "reading": {name: value for name, value in reading.said().items() if value is not None},
        CONFIG_KEY: dict(experiment),
    } | {name: value for name, value in table.items() if name != CONFIG_KEY}


def as_json(result: Mapping[str, Any]) -> str:
    """One object; NaN and infinities, which JSON lacks, become null."""

    def plain(value: Any) -> Any:
        if hasattr(value, "_asdict"):
            value = value._asdict()
        if isinstance(value, dict):
            return {name: plain(inner) for name, inner in value.items()}
        if isinstance(value, list | tuple):
            return [plain(inner) for inner in value]
        if isinstance(value, float) and not math.isfinite(value):
            return None
        return value

    return json.dumps(plain(dict(result)))


def read_experiment(path: Path | None, *, of: str) -> dict[str, Any]:
    """The experiment that a TOML file describes, or that an earlier run's JSON or MCAP carries; of no file none.

    Args:
        path: the file.
        of: the command whose run it may be.

    Raises:
        ValueError: the file describes none.
    """
    from dirprim_filter.recording.errors import RecordingError

    if path is None:
        return {}
    try:
        if path.suffix == ".toml":
            return tomllib.loads(path.read_text())
        if path.suffix == ".json":
            config = json.loads(path.read_text())[CONFIG_KEY]
        else:
            config = json.loads(_metadata(path)[CONFIG_KEY])
    except (
        tomllib.TOMLDecodeError, json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError, RecordingError
    ) as error:  # fmt: skip
        raise ValueError(
            f"{path}: expected an experiment in TOML, or the JSON or MCAP of `dirprim {of}`, got {error}"
        ) from error
    if not isinstance(config, dict):
        raise ValueError(f"{path}: expected an object under {CONFIG_KEY!r}, got {type(config).__name__}")  # noqa: TRY004 - the file's error, not a caller's
    return {name: value for name, value in config.items() if value is not None}


def read_filter(path: Path | None, settings: Settings, **given: Any) -> tuple[FilterConfig, TrackingConfig]:
    """The configuration of a tracker: what is given, else by the file, else the defaults.

    Args:
        path: TOML with the tables `filter` and `tracking`, or what an earlier `track` or `evaluate tracking` wrote.
        settings: fields of either, by name.
        given: the same by options; None is not given.

    Raises:
        BadParameter: a setting is neither's.
        ValueError: the file has none, or a field is unknown or out of range.
    """
    from dirprim_filter.config import FilterConfig, TrackingConfig
    from dirprim_filter.evaluation.tracking_experiment import config_of

    config = read_experiment(path, of="track")
    if path is not None and path.suffix == ".toml":
        unknown = [name for name in config if name not in {"filter", "tracking"}]
        if unknown:
            raise ValueError(f"{path}: {unknown[0]}: expected the tables filter and tracking")
    kinds: dict[str, type[Any]] = {"filter": FilterConfig, "tracking": TrackingConfig}
    names = [[field.name for field in fields(kind)] for kind in kinds.values()]
    made = []
    for (name, kind), own, known in zip(kinds.items(), deal(settings, *names), names, strict=True):
        stated = {of: value for of, value in given.items() if of in known and value is not None}
        made.append(config_of(kind, dict(config.get(name) or {}) | stated | own, where=name))
    return made[0], made[1]


def _metadata(path: Path) -> dict[str, str]:
    from dirprim_filter.recording.scan import scan

    with scan(path) as log:
        return {key: value for _, entries in log.metadata for key, value in entries.items()}
