"""What outputs and results say of their run, so that it can be had again: as metadata, as JSON; reading it again."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import dirprim_filter as dp
from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.settings import Settings, deal
from dirprim_filter.cli.texts import counted
from dirprim_filter.config import FilterConfig, LearningConfig, TrackingConfig, from_table
from dirprim_filter.recording.container.errors import without_secrets
from dirprim_filter.recording.container.source import open_files
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.scan import scan

if TYPE_CHECKING:
    from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment

CONFIG_KEY = "experiment"
"""Of the metadata record and the JSON object that hold an experiment."""


def provenance(command: str, *, inputs: Sequence[Path], **options: Any) -> dict[str, str]:
    """The command, its options, configurations among them, the version and the inputs' checksums, as text."""
    said = {"command": command, "version": version("dirprim-filter")}
    for name, value in options.items():
        if value is not None:
            text = json.dumps(asdict(value), sort_keys=True) if hasattr(value, "__dataclass_fields__") else str(value)
            said[name] = without_secrets(text)
    names = [without_secrets(str(path)).rpartition("/")[2] for path in inputs]
    for path, name in zip(inputs, names, strict=True):
        said[f"sha256 {name if names.count(name) == 1 else without_secrets(str(path))}"] = checksum(path)
    return said


def save_learned(
    learned: dp.PrimitiveMap, output: Path, *, said: dict[str, Any], counts: str, force: bool,
    inputs: Sequence[Path] = (),
) -> None:  # fmt: skip
    """Write a map with what its metadata says, and say what it is; `counts`: of what it was learned from."""
    what = provenance("learn", inputs=inputs, config=LearningConfig(), **said)
    dp.save_map(learned, output, metadata=what, force=force)
    size_m, n_modes = learned.tessellation.area.mean() ** 0.5, (learned.own_weight > 0).sum(axis=1).mean()
    origin = "" if learned.origin is None else f", origin {learned.origin}"
    cells = f"{counted(learned.tessellation.n_cells, 'cell')} of {size_m:.3g} m, {n_modes:.1f} modes each"
    typer.echo(f"{output}: {cells}{origin}, from {counts}")


def metadata_of(path: Path) -> dict[str, str]:
    """What the metadata records of a log say."""
    with scan(path) as log:
        return {key: value for _, entries in log.metadata for key, value in entries.items()}


def checksum(path: Path) -> str:
    """The file's SHA-256, in hexadecimal; of several files that of theirs."""
    sums = []
    for _, bytes_of in open_files(path):
        whole = hashlib.sha256()
        for block in bytes_of.blocks():
            whole.update(block)
        bytes_of.close()
        sums.append(whole.hexdigest())
    return sums[0] if len(sums) == 1 else hashlib.sha256(" ".join(sums).encode()).hexdigest()


def report(
    command: str, inputs: Sequence[Path], reading: Reading, lost: Losses, *, table: Mapping[str, Any],
    settings: Mapping[str, Any], text: Callable[[], str], as_json: bool,
) -> int:  # fmt: skip
    """Print a table as text, or as JSON with what reproduces it: version, checksums, options; -> the exit code."""
    if not as_json:
        typer.echo(text())
        return exit_codes.of_losses(lost)
    said = {
        "format": f"dirprim {command}", "format_version": 2,  # 1 had neither `format` nor `inputs`
        "version": version("dirprim-filter"),
        "inputs": [{"name": path.name, "sha256": checksum(path)} for path in inputs],
        "reading": reading.said(), CONFIG_KEY: settings,
    }  # fmt: skip
    typer.echo(json.dumps(_plain({**table, **said})))
    return exit_codes.of_losses(lost)


def _plain(value: Any) -> Any:
    """NaN and infinities, which JSON lacks, become null; intervals have names."""
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_experiment(path: Path | None) -> dict[str, Any]:
    """The experiment that a TOML file describes, or that an earlier run's JSON or MCAP carries; of no file none.

    Raises:
        ValueError: the file describes none.
    """
    if path is None:
        return {}
    try:
        if path.suffix == ".toml":
            return tomllib.loads(path.read_text())
        is_json = path.suffix == ".json"
        config = json.loads(path.read_text())[CONFIG_KEY] if is_json else json.loads(metadata_of(path)[CONFIG_KEY])
        return {name: value for name, value in config.items() if value is not None}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, RecordingError) as error:
        got = "none" if isinstance(error, KeyError) else error
        raise ValueError(
            f"{path}: expected an experiment in TOML, or the JSON or MCAP of an earlier run, got {got}"
        ) from error


def read_filter(
    path: Path | None, settings: Settings, *others: type, **given: Any
) -> tuple[FilterConfig, TrackingConfig]:  # fmt: skip
    """The configuration of a tracker: what is given, else by the file, else the defaults.

    Args:
        path: TOML with the tables `filter` and `tracking`, or what an earlier run wrote.
        settings: fields of either, by name.
        others: dataclasses whose fields may be among the settings too.
        given: the same by options; None is not given.

    Raises:
        BadParameter: a setting is neither's.
        ValueError: the file has none, or a field is unknown or out of range.
    """
    config = read_experiment(path)
    kinds: dict[str, type[Any]] = {"filter": FilterConfig, "tracking": TrackingConfig}
    if path is not None and path.suffix == ".toml" and (unknown := [*config.keys() - kinds]):
        raise ValueError(f"{path}: {unknown[0]}: expected the tables filter and tracking")
    made = []
    for (name, kind), own in zip(kinds.items(), deal(settings, *kinds.values(), *others), strict=False):
        known = kind.__dataclass_fields__
        stated = {of: value for of, value in given.items() if of in known and value is not None}
        table = config.get(name, {})
        made.append(from_table(kind, table | stated | own if isinstance(table, dict) else table, where=name))
    return made[0], made[1]


def read_tracking(path: Path | None, settings: Settings, *others: type, **given: Any) -> TrackingExperiment:
    """The experiment of trackers: what is given, else by the file, else the defaults; as `read_filter`."""
    from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment

    own, *of_trackers = deal(settings, TrackingExperiment, FilterConfig, TrackingConfig, *others)
    made = read_experiment(path) | own | {name: value for name, value in given.items() if value is not None}
    for name, stated in zip(("filter", "tracking"), of_trackers, strict=False):
        if stated:
            made[name] = (made.get(name) or {}) | stated
    return from_table(TrackingExperiment, made)
