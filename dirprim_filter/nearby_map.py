"""The part of a large map that is near vehicles: it moves on with them, tile by tile."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Protocol

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import Worlds
from dirprim_filter.filtering.measurements import FASTEST, MOST_SPREADS
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.sight import Sight

SPARE_M = 250.0
"""What is loaded reaches farther by that, so that vehicles come to its end only now and then."""
OUTWARDS = np.array([-1.0, -1.0, 1.0, 1.0])


class Tiles(Protocol):
    """A map of which tiles can be read by themselves."""

    @property
    def box(self) -> FloatArray:
        """(n_tiles, 4) west, south, east and north of each tile and of all where its cells may be, metres."""
        ...

    @property
    def margin_m(self) -> float:
        """What is at a place depends on no cells farther from it than that."""
        ...

    def tiles_with(self, cell: IntArray) -> IntArray:
        """The tiles of the last part that have some cells (n,)."""
        ...

    def part(self, tiles: IntArray) -> PrimitiveMap:
        """The map of some tiles (n,) alone."""
        ...


class NearbyMap:
    """A map, or the part of it that tracking needs now.

    Held are the tiles of all ground where a particle may come until the frame: as far as vehicles drive since their
    last measurement. Nothing is held of where none is left. So what is believed of a vehicle's place is what the whole
    map says, to the last bit; but how probably it exists depends a little on how many vehicles are expected where, and
    of those that come from what is not held no more is known than how many there are on average.

    Args:
        source: the map; or its tiles.
        ahead_s: seconds beyond a frame for which vehicles are moved on, as in forecasts.
        noise_m: standard deviation of a detection that says none.
        sight: of the sensor, where it does not see everywhere: held as well, for where nothing is seen no frame thins
            out who came before.

    Attributes:
        part: what is held now.
        followers: called when that changes.
    """

    def __init__(
        self, source: PrimitiveMap | Tiles, *, ahead_s: float, noise_m: float, sight: Sight | None = None
    ) -> None:
        self._tiles = None if isinstance(source, PrimitiveMap) else source
        self._held = np.empty(0, np.int64)
        self.part = source if isinstance(source, PrimitiveMap) else source.part(self._held)
        self.followers: list[Callable[[PrimitiveMap], None]] = []
        self._ahead_m, self._noise_m = FASTEST * ahead_s, noise_m
        self._sight = np.empty((0, 4)) if sight is None else sight.boxes

    def tell(self, follower: Callable[[PrimitiveMap], None]) -> None:
        """Tell what is held, now and whenever it changes."""
        follower(self.part)
        self.followers.append(follower)

    def along(self, frames: Iterable[Detections], worlds: Worlds) -> Iterable[Detections]:
        """The same frames; before each the part is what it takes, before the first when this is called."""
        if self._tiles is None:
            return frames
        rest = self._each(iter(frames), self._tiles, worlds)
        return chain([first] if (first := next(rest, None)) is not None else [], rest)

    def _each(self, frames: Iterator[Detections], tiles: Tiles, worlds: Worlds) -> Iterator[Detections]:
        for seen in frames:
            if len(seen):
                self._follow(seen, tiles, worlds)
            yield seen

    def _follow(self, seen: Detections, tiles: Tiles, worlds: Worlds) -> None:
        time_ns, reach = int(seen.time_ns[-1]), tiles.margin_m + self._ahead_m
        ground = np.vstack([worlds.ground(time_ns), self._beginnings(seen), self._sight])
        if np.isin(_on(tiles.box, ground, reach), self._held).all():
            return
        near = _on(tiles.box, ground, reach + SPARE_M)
        self._held = np.union1d(near, tiles.tiles_with(worlds.in_use(time_ns)))
        self.part = tiles.part(self._held)
        for tell in self.followers:
            tell(self.part)

    def _beginnings(self, seen: Detections) -> FloatArray:
        """(n, 4) where tracks may begin, and particles be moved to, by each detection."""
        spread = np.sqrt(np.trace(seen.covariance, axis1=1, axis2=2))
        reach = MOST_SPREADS * np.where(np.isnan(spread), self._noise_m, spread)
        return np.asarray(np.tile(seen.position, 2) + reach[:, None] * OUTWARDS)


def _on(box: FloatArray, ground: FloatArray, reach_m: float) -> IntArray:
    """Which boxes (t, 4) touch any of some ground (n, 4), or what is near it."""
    wide = ground + reach_m * OUTWARDS
    touches = (box[:, None, 2:] >= wide[:, :2]) & (box[:, None, :2] <= wide[:, 2:])
    return np.flatnonzero(np.all(touches, axis=2).any(axis=1))
