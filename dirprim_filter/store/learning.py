"""A map learned from a summary: of steps of pseudo-vehicles, faded by age, by hour, without what few vehicles did."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives import learn_primitives
from dirprim_filter.primitives.leader import LeaderResponse
from dirprim_filter.primitives.leader_learning import LeaderSums
from dirprim_filter.primitives.motion_learning import modes_of
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.schedule import By
from dirprim_filter.primitives.visits import Visits
from dirprim_filter.store.by_hour import Strengths, choose_strengths, fit_schedule
from dirprim_filter.store.fading import Fading, refreshed
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.pseudo_tracks import APART_NS, pseudo_tracks
from dirprim_filter.store.steps import WHEN, passed_place, unpacked_when
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.tallies import Tally
from dirprim_filter.store.withholding import withheld
from dirprim_filter.tracks import Tracks

logger = logging.getLogger(__name__)

MIN_VEHICLES = 5
MOST_STEPS = 1_000_000
"""Of pseudo-vehicles drawn evenly from all hours: more tell next to nothing new."""
MOST_BY_HOUR = 200_000
"""Of them by which it is chosen how strongly hours lean on all day."""
PLACE_M = 256.0
"""Side of the places where held-out vehicles choose, of all vehicles there: of a share of the vehicles everywhere they
would choose for cells that know little."""
BLOCK_STEPS = 200_000
"""At a time become pseudo-vehicles."""
GOLDEN = 0.6180339887498949
"""Multiples of it, modulo 1, are spread evenly: every block of them holds its share below any number."""


def learn_from_summary(
    summary: Summary,
    *,
    min_vehicles: int = MIN_VEHICLES,
    fading: Fading | None = None,
    by: By | None = None,
    zone: str = "UTC",
    rng: np.random.Generator,
    **options: Any,
) -> PrimitiveMap:
    """Learn a map: the same for the same summary, however it came together, and the same state of `rng`.

    Args:
        summary: of recordings.
        min_vehicles: of what fewer vehicles did at a place the map says nothing; see `withheld`.
        fading: left out, all recordings count alike. Else weights and mean speeds fade by it, all the rest more slowly;
            see `Fading.slowly`.
        by: how weights and mean speeds turn, with the "hour" of the day or of the "week"; left out, not at all.
        zone: of the clocks that say the hour, such as Europe/Berlin.
        rng: as for `learn_primitives`.
        options: others of `learn_primitives`.

    Raises:
        ValueError: nothing is left to learn from, by hour no two days, or options as for `learn_primitives`.
    """
    if min_vehicles < 1:
        raise ValueError(f"min_vehicles: expected at least 1, got {min_vehicles}")
    visible = visible_tracks(summary, min_vehicles=min_vehicles, fading=fading and fading.slowly)
    return learn_from_visible(
        visible, summary.leader_sums, min_vehicles=min_vehicles, fading=fading, by=by, zone=zone, rng=rng, **options
    ).primitive_map


class Visible(NamedTuple):
    """Pseudo-vehicles that a map is learned from."""

    tracks: Tracks
    hour: IntArray  # (n_tracks,) since 1970-01-01, in which each came into sight


class Learned(NamedTuple):
    """A map, and what its schedule was fitted by, if it has one."""

    primitive_map: PrimitiveMap
    strengths: Strengths | None


def learn_from_visible(
    visible: Visible, sums: LeaderSums, *, min_vehicles: int, fading: Fading | None, by: By | None, zone: str,
    rng: np.random.Generator, fitted_anew: bool = False, **options: Any,
) -> Learned:  # fmt: skip
    """As `learn_from_summary`, of pseudo-vehicles and the sums that the response to leaders is learned from.

    Of a map whose cells are `fitted_anew` afterwards, if they can be, nothing is left out before.
    """
    tracks, hour = visible
    if not len(tracks):
        raise ValueError(
            f"summary: expected places that {min_vehicles} vehicles passed the same way, got none; add recordings, or "
            "ask for fewer vehicles"
        )
    learned = learn_primitives(tracks, rng=rng, **options)
    seen = float(sums.acceleration.weight.sum()) >= min_vehicles
    leader = sums.response() if seen else LeaderResponse.none()
    learned = replace(learned, motion=replace(learned.motion, leader=leader))
    if by is None and ((min_vehicles == 1 and fading is None) or (fitted_anew and learned.refit is not None)):
        return Learned(learned, None)
    rows = TrackRows.thinned(tracks, interval_s=0.0)
    if fitted_anew and learned.refit is not None:  # then visits are for strengths alone
        rows = rows[at_some_places(rows.position, MOST_BY_HOUR, rng=rng)]
    visits = Visits.of(rows, learned.tessellation)
    mode = modes_of(learned, visits)
    if min_vehicles > 1:
        learned = withheld(learned, visits, mode, min_vehicles)
    if fading is not None:
        learned = refreshed(learned, visits, mode, hour, fading)
    if by is None:
        return Learned(learned, None)
    strengths = choose_strengths(learned, visits, mode, hour, by=by, zone=zone, min_vehicles=min_vehicles)
    schedule = fit_schedule(
        learned, visits, mode, hour, strengths, by=by, zone=zone, min_vehicles=min_vehicles
    )  # fmt: skip
    return Learned(replace(learned, schedule=schedule), strengths)


def at_some_places(position: FloatArray, most: int, *, rng: np.random.Generator) -> BoolArray:
    """(n,) all rows of places drawn evenly, until there are at least so many. (n, 2) metres."""
    if len(position) <= most:
        return np.ones(len(position), np.bool_)
    places, place = np.unique(np.floor(position / PLACE_M), axis=0, return_inverse=True)
    order = rng.permutation(len(places))
    n_rows = np.cumsum(np.bincount(place)[order])
    return np.isin(place, order[: int(np.searchsorted(n_rows, most)) + 1])


def visible_tracks(summary: Summary, *, min_vehicles: int = MIN_VEHICLES, fading: Fading | None = None) -> Visible:
    """Pseudo-vehicles, where at least so many vehicles passed each place each way; of older ones as many as count.

    Raises:
        ValueError: none is left.
    """
    whens = summary.whens
    if not len(whens):
        raise ValueError("summary: expected at least one vehicle, got none; add a recording first")
    hour, _, _ = unpacked_when(whens.key[:, 0], summary.lattice)
    share = np.ones(hour.size) if fading is None else fading.share(hour)
    share *= min(1.0, MOST_STEPS / max(n_steps_left(whens, summary.lattice, fading), 1.0))
    n_ways, end_ns = 0, 0
    parts: list[Tracks] = []
    hours: list[IntArray] = []
    for first, last in _blocks(whens):
        steps = summary.steps_of(first, last)
        tracks, kind = pseudo_tracks(steps, summary.lattice)
        way = tracks.track_id + n_ways
        when = np.searchsorted(whens.key[:, 0], steps.key[kind, WHEN])
        shown = ((way * GOLDEN) % 1.0 < share[when]) & is_passed(tracks, summary.passed, summary.lattice, min_vehicles)
        parts.append(_shown(replace(tracks, track_id=way), shown, end_ns))
        hours.append(hour[when[shown]])
        n_ways, end_ns = n_ways + tracks.n_tracks, end_ns + len(tracks) * APART_NS
    tracks = Tracks.concatenate(parts)
    n_steps = int(whens.value[:, 0].sum())
    logger.info("%d of %d steps of pseudo-vehicles are learned from", len(tracks), n_steps)
    _, rows = np.unique(tracks.vehicle, return_index=True)
    return Visible(tracks, np.concatenate(hours)[rows])


def n_steps_left(whens: Tally, lattice: Lattice, fading: Fading | None) -> float:
    """How many steps age leaves; `whens` as of `Summary`."""
    count = whens.value[:, 0].astype(np.float64)
    if fading is not None:
        count *= fading.share(unpacked_when(whens.key[:, 0], lattice)[0])
    return float(count.sum())


def _shown(tracks: Tracks, shown: BoolArray, begin_ns: int) -> Tracks:
    """Some rows of pseudo-vehicles, apart in time wherever one was left out: else learning would fill it in."""
    row = np.flatnonzero(shown)
    lasts = np.where(np.diff(row) == 1, np.diff(tracks.time_ns[row]), APART_NS)
    return replace(tracks[row], time_ns=begin_ns + np.cumsum(np.append(0, lasts))[: row.size])


def _blocks(whens: Tally) -> list[tuple[int, int]]:
    """First and last of some hours and folds, of about `BLOCK_STEPS` steps: all at once may be too many."""
    before = np.cumsum(whens.value[:, 0]) - whens.value[:, 0]
    begins = np.flatnonzero(np.diff(before // BLOCK_STEPS, prepend=-1) > 0)
    when = whens.key[:, 0]
    return list(zip(when[begins].tolist(), when[np.append(begins[1:], when.size) - 1].tolist(), strict=True))


def is_passed(tracks: Tracks, passed: Tally, lattice: Lattice, min_vehicles: int) -> BoolArray:
    """(n,) where so many vehicles passed the place the way the row does; `passed` as of `Summary`."""
    state, _ = lattice.states(tracks.position, tracks.direction, tracks.speed)
    place = passed_place(state, lattice)
    known = passed.key[:, 0]
    at = np.minimum(np.searchsorted(known, place), max(known.size - 1, 0))
    return np.asarray((known[at] == place) & (passed.value[at, 0] >= min_vehicles))
