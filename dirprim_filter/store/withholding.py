"""What a map must not say: how few vehicles moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.motion_learning import likeliest_modes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.visits import Visits


def withheld(learned: PrimitiveMap, visits: Visits, mode: IntArray, min_vehicles: int) -> PrimitiveMap:
    """The map without modes, manoeuvres and transitions of fewer vehicles.

    A vehicle is of the mode that its visit to the cell fits best. What such modes weighed goes to the place-free
    primitive, and a cell without modes is place-free.

    Args:
        learned: the map.
        visits: of the vehicles that it was learned from.
        mode: (v,) of each visit.
        min_vehicles: so many at least.
    """
    enough = vehicles_of_modes(learned, visits, mode) >= min_vehicles
    kept = kept_manoeuvres(learned.motion, enough, min_vehicles)
    return replace(without_modes(learned, enough), motion=_often_driven(learned.motion, kept, min_vehicles))


def without_modes(learned: PrimitiveMap, enough: BoolArray) -> PrimitiveMap:
    """The map with those own and borrowed modes alone that `enough` vehicles drive, (n_cells, own and borrowed modes).

    Of the others nothing stays, neither directions nor speeds.
    """
    weight = learned.direction.weight.copy()
    weight[:-1, : enough.shape[1]] *= enough
    weight /= weight.sum(axis=1, keepdims=True)
    gone = weight == 0.0
    gone[-1] = gone[:, learned.n_own_modes - 1] = False  # who stands does so everywhere alike

    def of_kept(column: FloatArray, filler: float) -> FloatArray:
        return np.where(gone if column.ndim == gone.ndim else gone[..., None], filler, column)

    return replace(
        learned,
        direction=VonMisesMixture(
            weight=weight, mean_direction=of_kept(learned.direction.mean_direction, 0.0),
            concentration=of_kept(learned.direction.concentration, 0.0),
        ),
        speed=Gamma(shape=of_kept(learned.speed.shape, 1.0), rate=of_kept(learned.speed.rate, 1.0)),
        bend=of_kept(learned.bend, 0.0), gain=of_kept(learned.gain, 0.0),
    )  # fmt: skip


def kept_manoeuvres(motion: Motion, enough: BoolArray, least: int) -> BoolArray:
    """(z,) those of no place, and of modes that `enough` vehicles drive those with so many visits."""
    kept = motion.cell < 0
    placed = ~kept
    kept[placed] = enough[motion.cell[placed], motion.mode[placed]] & (motion.visits[placed] >= least)
    return kept


def vehicles_of_modes(learned: PrimitiveMap, visits: Visits, mode: IntArray) -> FloatArray:
    """(n_cells, own and borrowed modes) how many vehicles visited each."""
    n_own, n_modes = learned.n_own_modes, learned.n_own_modes + learned.n_borrowed_modes
    n_cells, inside = learned.tessellation.n_cells, np.flatnonzero(visits.cell >= 0)
    of_modes = [(inside, mode)]
    if learned.n_borrowed_modes:
        moving = inside[~visits.stands[inside]]
        of_modes.append((moving, likeliest_modes(learned, visits, range(n_own, n_modes))))
    visited = [
        np.unique(np.column_stack([visits.cell[v], of[v], visits.vehicle[visits.begin[v]]]), axis=0)
        for v, of in of_modes
    ]
    cell, of_mode, _ = np.concatenate(visited).T
    number = np.bincount(cell * n_modes + of_mode, minlength=n_cells * n_modes)
    return number.reshape(n_cells, n_modes).astype(float)


def _often_driven(motion: Motion, kept: BoolArray, least: int) -> Motion:
    """Some of the manoeuvres, and the transitions between them that happened at least so often."""
    placed = motion.cell >= 0
    z = kept.size
    often = motion.count >= np.where(np.repeat(placed, np.diff(motion.first)), least, 0.0)
    start = np.repeat(np.arange(z), np.diff(motion.first))[often]
    transition = csr_array((motion.count[often], (start, motion.following[often])), shape=(z, z))[kept][:, kept]
    columns = {name: getattr(motion, name)[kept] for name in (*FLOATS, "cell", "mode")}
    return replace(
        motion, **columns, first=transition.indptr.astype(np.int64), following=transition.indices.astype(np.int64),
        count=transition.data.astype(np.float64),
    )  # fmt: skip
