"""Mcity's roadside sensor without the instrumented vehicle for some seconds of each pass.

Detections are real; map and sensor are of the other drives. The rivals get them less the sensor's bias and latency, as
ours knows these; they are fitted to the judged windows themselves, in their favour.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import mcity_drives as mcity
import numpy as np
from paired_errors import RowErrors, true_rows

from dirprim_filter import PrimitiveMap
from dirprim_filter.detections import Detections
from dirprim_filter.sensor import without_bias
from grounds.findings import WITH, WITHOUT, Asked, Findings, learned
from grounds.windows import Answer, Window, judged, ours

GAPS_S = (3.0, 6.0)
MARGIN_S, CONTEXT_S = 2.0, 10.0
"""Of a pass: at least in sight before and after a gap, and looked at about it."""
PAUSE_S = 2.0
"""Between two detections of a vehicle in two passes of it."""


def windows_of(drive: int, gap_s: float) -> list[tuple[Window, Window]]:
    """Windows of a drive, one after the other in each pass; as detected, and less bias and latency."""
    rows, truth, sensor = mcity.detected(drive), mcity.true(drive), mcity.calibrated(drive)
    near = RowErrors.of(Detections.of(rows), truth, gate_m=mcity.GATE_M)
    fair, (at, keys) = without_bias(rows, sensor), true_rows(truth, rows.time_ns)
    found = []
    for vehicle in np.unique(near.key % 64):
        column = np.sort(near.column[near.key % 64 == vehicle])
        own, true_ns = keys % 64 == vehicle, at.time_ns[keys % 64 == vehicle]
        splits = np.flatnonzero(np.diff(rows.time_ns[column]) > PAUSE_S * 1e9) + 1
        for number, part in enumerate(np.split(column, splits)):
            time_s = (rows.time_ns[part] - rows.time_ns[part[0]]) * 1e-9
            hidden_s = (true_ns - rows.time_ns[part[0]]) * 1e-9
            for start in np.arange(MARGIN_S, time_s[-1] - gap_s - MARGIN_S, gap_s):
                gone = (hidden_s > start) & (hidden_s <= start + gap_s)
                kept = (time_s <= start) | (time_s > start + gap_s)
                kept &= (time_s > start - CONTEXT_S) & (time_s <= start + gap_s + CONTEXT_S)
                if gone.sum() < 0.8 * gap_s * 10.0:
                    continue
                cluster, place = f"{drive}/{vehicle}/{number}", at.position[own][gone]
                found.append((
                    Window(cluster, time_s[kept], rows.position[part][kept], hidden_s[gone], place),
                    Window(cluster, time_s[kept] - sensor.latency_s, fair.position[part][kept], hidden_s[gone], place),
                ))  # fmt: skip
    return found


def of_mcity_blind(asked: Asked) -> list[Findings]:
    """Every drive with truth, by the others."""
    mcity.DATA = asked.data / "mcity_roadside"
    drives = sorted(mcity.with_truth())
    maps = {drive: learned(mcity.traffic(drive), asked, f"mcity_without_{drive}", quick_m=10.0) for drive in drives}
    tables = []
    for gap_s in GAPS_S[: 1 if asked.is_smoke else None]:
        by_drive = {drive: windows_of(drive, gap_s)[: 2 if asked.is_smoke else None] for drive in drives}
        by_drive = {drive: of for drive, of in by_drive.items() if of}
        seen, fair = ([pair[which] for of in by_drive.values() for pair in of] for which in (0, 1))
        by_map = {
            WITH: partial(_answers, by_drive, maps, gap_s),
            WITHOUT: partial(_answers, by_drive, {drive: of.without_places() for drive, of in maps.items()}, gap_s),
        }
        tables += judged(
            seen, fair, by_map, fair=fair, about=f"mcity_blind, gaps of {gap_s:g} s ({len(by_drive)} drives)",
            n_seeds=asked.n_seeds, density=1.0, noise_m=0.5,
        )  # fmt: skip
    return tables


def _answers(
    by_drive: Mapping[int, Sequence[tuple[Window, Window]]], maps: Mapping[int, PrimitiveMap], gap_s: float, seed: int
) -> tuple[Answer, Answer]:
    """Of all drives' windows, each by its own sensor and map."""
    found = []
    for drive, pairs in by_drive.items():
        sensor = mcity.calibrated(drive)
        config, tracking = mcity.configured(sensor)
        config = replace(config, max_gap_s=gap_s + 5.0, interaction="none")
        windows = [of for of, _ in pairs]
        found.append(ours(windows, maps[drive], config, seed=seed, tracking=tracking, sensor=sensor))
    online, smoothed = (
        Answer(*(np.concatenate(column) for column in zip(*parts, strict=True))) for parts in zip(*found, strict=True)
    )
    return online, smoothed
