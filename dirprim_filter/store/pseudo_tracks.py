"""Pseudo-vehicles: ways through the lattice that make every step exactly as often as it was counted.

A step is three states, one after the other: before, here, after. Two steps can follow each other where the last two
states of the one are the first two of the other, and at each such pair of states as many steps arrive as leave. So all
can be chained into ways from where a vehicle came into sight to where one went out of it: an Eulerian decomposition of
the graph of pairs. Which arrival goes on by which departure the counts do not say: here those of like speed and, where
vehicles stand, any, so that the times for which they stand are those of a Markov chain. Who passes a pair of states
that many vehicles passed goes on as any of them; who passes one alone is followed.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.store.lattice import NONE, PARTS, Lattice, unpacked
from dirprim_filter.store.steps import AFTER, BEFORE, HERE, TICK_NS, WHEN, unpacked_when
from dirprim_filter.store.tallies import Tally
from dirprim_filter.tracks import Tracks

APART_NS = 2_000_000_000
"""From one pseudo-vehicle's end to the next one's begin: they never meet."""
IRRATIONAL = np.array([0.0, 0.6180339887498949, 0.7548776662466927, 0.5698402909980532])
"""Multiples of these, modulo 1, are spread evenly (Roberts 2018)."""


def pseudo_tracks(steps: Tally, lattice: Lattice) -> tuple[Tracks, IntArray]:
    """The ways of all pseudo-vehicles, one after the other in time; and (n,) the kind of step of each row.

    Args:
        steps: see `Summary.steps`.
        lattice: that they are counted on.

    Raises:
        ValueError: the steps do not chain: they are no sum of whole recordings.
    """
    kind, number = _repeated(steps)
    key = steps.key[kind]
    position, direction, speed = lattice.motion(key[:, HERE], _placed(steps, kind, number))
    order, way = _in_ways(key, speed)
    step_ns = unpacked_when(key[order, WHEN], lattice)[2] * TICK_NS
    lasts = np.where(np.diff(way, prepend=way[:1]) == 0, step_ns, APART_NS)
    tracks = Tracks(
        track_id=way, time_ns=np.cumsum(lasts) - lasts[:1], position=position[order], direction=direction[order],
        speed=speed[order],
    )  # fmt: skip
    return tracks, kind[order]


def kinds_in_ways(steps: Tally, lattice: Lattice) -> IntArray:
    """(n,) the kind of each step, one way after the other: where `BEFORE` is `NONE`, the next one begins.

    Raises:
        ValueError: the steps do not chain.
    """
    kind, _ = _repeated(steps)
    _, _, speed = lattice.motion(steps.key[:, HERE], steps.value[:, 1:5] / steps.value[:, :1])
    order, _ = _in_ways(steps.key[kind], speed[kind])
    return kind[order]


def _repeated(steps: Tally) -> tuple[IntArray, IntArray]:
    """The kind of each step, and which of its kind it is."""
    count = steps.value[:, 0]
    kind = np.repeat(np.arange(len(steps)), count)
    return kind, np.arange(kind.size) - np.repeat(np.cumsum(count) - count, count)


def _in_ways(key: IntArray, speed: FloatArray) -> tuple[IntArray, IntArray]:
    """Steps in order of their ways and of their places there, and the number of each one's way, ascending."""
    way, place = _ways(_chained(key, speed), np.flatnonzero(key[:, BEFORE] == NONE))
    order = np.lexsort((place, way))
    return order, way[order]


def _placed(steps: Tally, kind: IntArray, number: IntArray) -> FloatArray:
    """(n, 4) where in its bins each step is: evenly spread, with the mean and the variance of its kind.

    Each coordinate in another order, for how they go together was not counted.
    """
    count = steps.value[:, :1]
    mean = steps.value[:, 1:5] / count
    variance = steps.value[:, 5:] / count - mean * mean
    apart = np.sqrt(12.0 * np.maximum(variance, 0.0) / np.maximum(count * count - 1, 1))
    out = mean[kind] + 0.5
    several = np.flatnonzero(count[kind, 0] > 1)
    kind, number = kind[several], number[several]
    for i, multiple in enumerate(IRRATIONAL):
        order = np.lexsort(((number * multiple) % 1.0 if i else number, kind))
        place = np.empty(several.size)
        place[order] = number  # `number` counts up within each kind
        out[several, i] += (place - 0.5 * (count[kind, 0] - 1)) * apart[kind, i]
    return np.asarray(np.clip(out, 0.01, PARTS - 0.01))


def _chained(key: IntArray, speed: FloatArray) -> IntArray:
    """(n,) the step that follows each, `NONE` where the vehicle goes out of sight. (n, 4), (n,)."""
    rng = np.random.default_rng(0)  # of the order of those that stand alone
    stands = unpacked(key[:, HERE])[3] == 0
    arrives, leaves = np.flatnonzero(key[:, AFTER] != NONE), np.flatnonzero(key[:, BEFORE] != NONE)
    among = [np.where(stands, rng.random(stands.size), speed) for _ in range(2)]
    arrives = arrives[np.lexsort((among[0][arrives], *key[arrives][:, [AFTER, HERE, WHEN]].T))]
    leaves = leaves[np.lexsort((among[1][leaves], *key[leaves][:, [HERE, BEFORE, WHEN]].T))]
    pair = key[arrives][:, [WHEN, HERE, AFTER]]
    if arrives.size != leaves.size or (pair != key[leaves][:, [WHEN, BEFORE, HERE]]).any():
        raise ValueError("steps: expected those of whole recordings, got some that nothing goes before or after")
    following = np.full(len(key), NONE)
    following[arrives] = leaves
    node = np.cumsum(np.append(0, (pair[1:] != pair[:-1]).any(axis=1)))[: len(pair)]
    _join_circles(following, arrives, node, key[:, BEFORE] == NONE)
    return following


def _join_circles(following: IntArray, arrives: IntArray, node: IntArray, born: BoolArray) -> None:
    """Let ways go around the circles that they touch, until there are none.

    Args:
        following: (n,) changed in place.
        arrives: (m,) the steps that another follows, in order of their pair of states.
        node: (m,) the number of that pair.
        born: (n,) where ways begin.
    """
    n = following.size
    while True:
        links = coo_array((np.ones(arrives.size, np.int8), (arrives, following[arrives])), shape=(n, n))
        _, part = connected_components(links, directed=False)
        is_way = np.zeros(n, np.bool_)
        is_way[part[born]] = True
        on_way = is_way[part[arrives]]
        if on_way.all():
            return
        host = np.full(node[-1] + 1, NONE)
        host[node[on_way]] = arrives[on_way]
        touching = np.flatnonzero(~on_way & (host[node] != NONE))
        _, one_each = np.unique(part[arrives[touching]], return_index=True)
        if not one_each.size:
            raise ValueError("steps: expected those of whole recordings, got some that no vehicle comes to")
        for i in touching[one_each].tolist():
            a, b = int(arrives[i]), int(host[node[i]])
            following[a], following[b] = following[b], following[a]


def _ways(following: IntArray, born: IntArray) -> tuple[IntArray, IntArray]:
    """The way that each step is on, and its place in it."""
    way, place = np.full(following.size, NONE), np.zeros(following.size, np.int64)
    now, name, steps = born, np.arange(born.size), 0
    while now.size:
        way[now], place[now] = name, steps
        now = following[now]
        goes_on = now != NONE
        now, name, steps = now[goes_on], name[goes_on], steps + 1
    return way, place
