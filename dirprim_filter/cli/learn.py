"""`dirprim learn`: a map of directional primitives from logs."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.options import (
    Cells,
    Force,
    LogsOrStore,
    Output,
    Scheduler,
    Seed,
    SensorFile,
    StoreWorkers,
    Tessellation,
    seconds,
    time_ns,
)
from dirprim_filter.cli.reading import Reading, reads_logs

if TYPE_CHECKING:
    from pathlib import Path

    from dirprim_filter.cli.progress import LearningProgress
    from dirprim_filter.primitives import PrimitiveMap
    from dirprim_filter.store.workers import Workers


class Modes(StrEnum):
    """How modes are counted and fitted."""

    BIC = "bic"
    DBSCAN = "dbscan"


class Shape(StrEnum):
    """How a primitive varies inside its cell."""

    CURVED = "curved"
    FLAT = "flat"


class Slots(StrEnum):
    """What weights and speeds turn with."""

    HOUR = "hour"
    WEEK = "week"


MinVehicles = Annotated[
    int | None, typer.Option("--min-vehicles", min=1, help="Of a store: leave out what fewer vehicles did. Default: 5.")
]
HalfLife = Annotated[
    float | None,
    typer.Option("--half-life", help="Of a store: in which half of all places change, such as 30d.", parser=seconds),
]
Now = Annotated[
    str | None,
    typer.Option("--now", help="With --half-life: when age is counted from, as --end. Default: the last log's."),
]
By = Annotated[
    Slots | None,
    typer.Option("--by", help="Of a store: weights and mean speeds by the hour of the day, or of the week."),
]
Zone = Annotated[
    str | None,
    typer.Option("--zone", help="With --by: whose clocks count, such as Europe/Berlin. Default: UTC."),
]


@reads_logs
def learn(
    logs: LogsOrStore,
    output: Output,
    tessellation: Tessellation = Cells.JOINT,
    cell_size: Annotated[float | None, typer.Option(help="Metres. Default: chosen on held-out vehicles.")] = None,
    cells: Annotated[int | None, typer.Option(help="Approximate number of cells, instead of their size.")] = None,
    modes: Annotated[Modes, typer.Option(help="bic, or the paper's dbscan.")] = Modes.BIC,
    primitive: Annotated[Shape, typer.Option(help="How a primitive varies inside its cell.")] = Shape.CURVED,
    sensor: SensorFile = None,
    min_vehicles: MinVehicles = None,
    half_life: HalfLife = None,
    now: Now = None,
    by: By = None,
    zone: Zone = None,
    workers: StoreWorkers = None,
    scheduler: Scheduler = None,
    seed: Seed = 0,
    reading: Reading = Reading(),
    force: Force = False,
) -> int:
    """Learn from logs, or from a store of them, how vehicles move at each place.

    Example: dirprim learn recordings/roundabout_learn.mcap -o map.mcap
    """
    import numpy as np

    from dirprim_filter.cli.progress import learning_progress
    from dirprim_filter.cli.provenance import provenance
    from dirprim_filter.config import LearningConfig
    from dirprim_filter.recording import save_map
    from dirprim_filter.recording.errors import OutputExistsError
    from dirprim_filter.store.workers import workers_for

    if output.exists() and not force:  # before the work, not after it
        raise OutputExistsError(output)
    source: _Logs | _Store
    if any(map(_is_store, logs)):
        if len(logs) > 1 or sensor is not None or reading != Reading():
            raise ValueError(
                f"{logs[0]}: a store is learned from alone, and fixes how its logs are read; leave out the rest"
            )
        source = _Store(logs[0], min_vehicles, half_life, now, by, zone, workers_for(0, workers, scheduler))
    elif (min_vehicles, half_life, now, by, zone, workers, scheduler) != (None,) * 7:
        raise ValueError(
            "--min-vehicles, --half-life, --now, --by, --zone, --workers, --scheduler: expected a store, got logs; see "
            "`dirprim store add`"
        )
    else:
        source = _Logs(logs, sensor, reading)
    config = LearningConfig()
    options = {
        "tessellation": tessellation.value, "cell_size": cell_size, "n_cells": cells, "modes": modes.value,
        "primitive": primitive.value,
    }  # fmt: skip
    with learning_progress() as bars:
        learned = source.learn(config=config, bars=bars, rng=np.random.default_rng(seed), **options)
    said = provenance("learn", inputs=source.files, config=config, seed=seed, **options, **source.said)
    save_map(learned, output, metadata=said, force=force)
    n_modes = float((learned.own_weight > 0).sum(axis=1).mean())
    typer.echo(
        f"{output}: {counted(learned.tessellation.n_cells, 'cell')} of "
        f"{float(learned.tessellation.area.mean()) ** 0.5:.3g} m, {n_modes:.1f} modes each, from {source.counts}"
    )
    return source.exit_code


def _is_store(path: Path) -> bool:
    """Whether it is no log: a folder that rosbag2 did not record, or a URL that a store is under."""
    from dirprim_filter.recording.container.rosbag2 import METADATA
    from dirprim_filter.recording.container.source import as_url
    from dirprim_filter.recording.errors import RecordingError
    from dirprim_filter.store.store import Store

    if as_url(str(path)) is None:
        return path.is_dir() and not (path / METADATA).exists()
    try:
        return path.suffix != ".mcap" and Store.is_at(path)
    except RecordingError:  # a server of logs may answer anything: who reads it as a log says what is wrong
        return False


class _Logs:
    """Logs to learn from."""

    def __init__(self, logs: list[Path], sensor: Path | None, reading: Reading) -> None:
        from dirprim_filter.recording.sensor_file import load_sensor
        from dirprim_filter.sensor import without_bias

        sensing = None if sensor is None else load_sensor(sensor)
        log = reading.tracks(logs)
        self._tracks = log.tracks if sensing is None else without_bias(log.tracks, sensing)
        self.files = logs
        self.said = {"sensor": None if sensing is None else repr(sensing), **reading.said()}
        self.counts = f"{counted(log.tracks.n_tracks, 'track')}, {counted(len(log.tracks), 'row')}"
        self.exit_code = losses.exit_code(log.losses)

    def learn(self, bars: LearningProgress, **options: Any) -> PrimitiveMap:
        from dirprim_filter.primitives import learn_primitives

        return learn_primitives(self._tracks, progress=bars.progress, stage=bars.stage, **options)


class _Store:
    """A store to learn from; what of its logs was lost has been said when they were added."""

    exit_code = losses.DONE
    files: tuple[Path, ...] = ()

    def __init__(
        self, folder: Path, min_vehicles: int | None, half_life_s: float | None, now: str | None,
        by: Slots | None, zone: str | None, workers: Workers,
    ) -> None:  # fmt: skip
        from dirprim_filter.store.fading import LATEST, Fading
        from dirprim_filter.store.learning import MIN_VEHICLES
        from dirprim_filter.store.store import Store

        if now is not None and half_life_s is None:
            raise ValueError("--now: expected --half-life with it")
        if zone is not None and by is None:
            raise ValueError("--zone: expected --by with it")
        store = Store.open(folder)
        entries = store.entries()
        if not entries:
            raise ValueError(f"{store.path}: expected logs to learn from, the store is empty; see `dirprim store add`")
        now_ns = time_ns(now)
        self._store = store
        self._by: Literal["hour", "week"] | None = None if by is None else by.value
        self._zone = "UTC" if zone is None else zone
        self._workers = workers
        self._least = MIN_VEHICLES if min_vehicles is None else min_vehicles
        self._fading = None
        if half_life_s is not None:
            self._fading = Fading(half_life_s=half_life_s, now_ns=LATEST if now_ns is None else now_ns)
        self.said = {
            "sha256 store": store.digest, "min_vehicles": self._least, "half_life_s": half_life_s, "now": now,
        }  # fmt: skip
        if by is not None:
            self.said |= {"by": self._by, "zone": self._zone}
        n_rows = sum({entry.rows: entry.n_rows for entry in entries}.values())
        self.counts = f"{counted(len(entries), 'log')}, {counted(n_rows, 'row')}"

    def learn(self, bars: LearningProgress, **options: Any) -> PrimitiveMap:
        from dirprim_filter.store.updating import learn_from_store

        return learn_from_store(
            self._store,
            min_vehicles=self._least,
            fading=self._fading,
            by=self._by,
            zone=self._zone,
            workers=self._workers,
            progress=bars.progress,
            stage=bars.stage,
            fitted=bars.tiles,
            **options,
        )
