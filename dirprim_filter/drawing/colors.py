"""Colours for speed, direction and vehicles: RGBA as uint8, safe for the colour-blind.

Speed runs through viridis (van der Walt and Smith, 2015), which rises in lightness all the way. Direction
runs around an ellipse in OKLab (Ottosson, 2020), in which lightness and the blue-yellow axis, the two that
colour-blindness leaves, go around together: north is light, south dark, east amber, west blue.
"""

import zlib
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import AnyArray, FloatArray
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.track_ids import numbered

ByteArray = npt.NDArray[np.uint8]

VIRIDIS: FloatArray = np.array([
    [68, 1, 84], [72, 24, 106], [71, 45, 123], [66, 64, 134], [59, 82, 139], [51, 99, 141],
    [44, 114, 142], [38, 130, 142], [33, 145, 140], [31, 160, 136], [40, 174, 128], [63, 188, 115],
    [94, 201, 98], [132, 212, 75], [173, 220, 48], [216, 226, 25], [253, 231, 37],
], np.float64)  # fmt: skip
"""(17, 3) equidistant colours from dark (slow) to light (fast)."""

WHEEL: FloatArray = np.array([
    [195, 153, 0], [191, 165, 3], [186, 177, 44], [179, 188, 72], [170, 198, 97], [160, 207, 121],
    [148, 213, 144], [136, 216, 165], [124, 218, 184], [115, 216, 201], [108, 213, 216], [106, 207, 227],
    [107, 199, 234], [111, 189, 238], [117, 178, 238], [125, 166, 234], [132, 155, 227], [138, 143, 217],
    [145, 132, 205], [150, 122, 191], [155, 114, 175], [160, 107, 158], [164, 101, 141], [169, 97, 124],
    [174, 95, 107], [178, 95, 90], [183, 98, 73], [187, 103, 56], [191, 109, 36], [193, 118, 3],
    [195, 129, 0], [196, 140, 0],
], np.float64)  # fmt: skip
"""(32, 3) equidistant colours of the circle from east on."""

OKABE_ITO = np.array([[86, 180, 233], [233, 104, 20], [224, 141, 187], [230, 159, 0], [90, 140, 255]], np.uint8)
"""(5, 3) distinguishable colours for vehicles (Okabe and Ito, 2008), less the greens and yellows of fast roses,
and lightened for a dark ground."""


def speed_color(speed: FloatArray, *, fastest: float) -> ByteArray:
    """Viridis from 0 m/s to `fastest` and beyond. (...) m/s -> (..., 4)."""
    return _between(VIRIDIS, np.asarray(speed) / fastest)


def direction_color(direction: FloatArray) -> ByteArray:
    """The cyclic colour of directions, radians from east. (...) -> (..., 4)."""
    wheel = _color_wheel()
    place = np.rint(np.asarray(direction) * (len(wheel) / TWO_PI)).astype(np.int64) % len(wheel)
    return wheel[place]


@lru_cache(maxsize=1)
def _color_wheel() -> ByteArray:
    """(1024, 4) the colours of the circle from east on: looked up, because particles come by the hundred thousand."""
    return _between(np.concatenate([WHEEL, WHEEL[:1]]), np.linspace(0.0, 1.0, 1024, endpoint=False))


def track_color(track_id: AnyArray | Sequence[str]) -> ByteArray:
    """One colour for each vehicle, the same in every run and picture. (n,) ids -> (n, 4).

    The palette's place comes from a checksum of the id's text: Python's own hash differs from run to run.
    """
    names, number = numbered(np.asarray(track_id))
    place = np.array([zlib.crc32(name.encode()) % len(OKABE_ITO) for name in names], dtype=np.int64)
    return _rgba(OKABE_ITO[place[number]])


def fan_opacity(n: int) -> float:
    """Of each of n forecasts' regions, 0 to 1; of more than six, which lie over each other, fainter."""
    return float(np.clip(0.15 * 6 / max(n, 6), 0.05, 0.15))


def _between(colors: FloatArray, share: FloatArray) -> ByteArray:
    """The colour at a share of the way through equidistant ones. (k, 3), (...) -> (..., 4)."""
    place = np.clip(share, 0.0, 1.0) * (len(colors) - 1)
    rgb = [np.interp(place, np.arange(len(colors)), channel) for channel in colors.T]
    return _rgba(np.stack(rgb, axis=-1))


def _rgba(rgb: npt.NDArray[np.floating] | ByteArray) -> ByteArray:
    rgba = np.full((*rgb.shape[:-1], 4), 255, dtype=np.uint8)
    rgba[..., :3] = np.rint(rgb)
    return rgba
