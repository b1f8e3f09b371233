"""Harmed maps: each is refused in one line, or read and used.

Numbers are set to what is out of any range, and bytes to others; what still loads is asked for densities, samples,
cells and a forecast.
"""

import numpy as np
from test_map_file import encode, load_map, opened, some_map, write

from dirprim_filter import forecast
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.map_file import encoded

EXTREME = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e9, -1e9, 5e-324, 0.0, -1.0)
EXTREME_WHOLE = (-(2**63), 2**63 - 1, 2**62, 2**31, -1, 0, 10**6)
MAPS = {"grid": encoded(some_map(10)), "voronoi": encoded(some_map(10, voronoi=True))}


def harmed(data, rng):
    """The message with some numbers, or some bytes, that are others."""
    if rng.random() < 0.3:
        changed = bytearray(data)
        for _ in range(rng.integers(1, 4)):
            changed[rng.integers(len(data))] = rng.integers(256)
        return bytes(changed)
    scalars, tables = opened(data)
    for _ in range(rng.integers(1, 3)):
        if rng.random() < 0.2:
            name = rng.choice([name for name, value in scalars.items() if isinstance(value, int | float)])
            extreme = EXTREME_WHOLE if isinstance(scalars[name], int) else EXTREME
            scalars[name] = type(scalars[name])(rng.choice(np.array(extreme)))
        else:
            columns = tables[
                rng.choice([name for name, columns in tables.items() if len(next(iter(columns.values())))])
            ]
            column = columns[rng.choice(list(columns))]
            extreme = EXTREME_WHOLE if column.dtype == np.int64 else EXTREME
            column[rng.integers(len(column)) if rng.random() < 0.7 else slice(None)] = rng.choice(np.array(extreme))
    return encode(scalars, tables)


def check_map(kind, path, rng):
    """Load a harmed map, and ask what was loaded for what maps are asked for. -> whether it was refused."""
    try:
        made = load_map(write(path, [harmed(MAPS[kind], rng)]))
    except RecordingError:
        return True
    place = np.concatenate([rng.normal(scale=1e3, size=(20, 2)), made.tessellation.centers[: made.n_rows.size]])
    with np.errstate(all="ignore"):
        made.tessellation.cell_of(place)
        made.log_density(place, np.zeros(len(place)), np.ones(len(place)))
        made.sample(place, rng=rng)
        forecast(made, position=place[-1], direction=0.0, speed=3.0, horizon_s=1.0, dt_s=0.5, n_samples=20, rng=rng)
    return False
