"""A map that is loaded and let go tile by tile: tracking by it is tracking by the whole, to the last bit."""

from dataclasses import fields, replace

import numpy as np
import pytest

from benchmarks.city_map import city
from dirprim_filter import nearby_map
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import Tracker, Worlds, tracker
from dirprim_filter.filtering.smoothing import Smoother, smoother
from dirprim_filter.forecasting import Forecaster
from dirprim_filter.nearby_map import NearbyMap
from dirprim_filter.primitives.schedule import Schedule
from dirprim_filter.primitives.traffic import Traffic
from dirprim_filter.recording import open_map, save_map
from dirprim_filter.recording.map_file import MapFile
from dirprim_filter.recording.schemas import map_tiles, tiled_map
from dirprim_filter.sensor import Sensor
from tessellation import blocks as of_blocks
from tessellation import locate, tiles

KNOBS = FilterConfig(n_particles=60, max_gap_s=0.3)
SIDE = 9


@pytest.fixture(scope="module")
def in_tiles():
    """Maps of some tens of metres count as large, and are kept as such."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tiled_map, "WHOLE_CELLS", 10)
        patch.setattr(map_tiles, "TILE_M", 72.0)
        for module in (of_blocks, tiles, tiled_map):
            patch.setattr(module, "BLOCK_SQUARES", 8)
        for module in (of_blocks, locate):
            patch.setattr(module, "DENSE_SQUARES", 0)
        patch.setattr(nearby_map, "SPARE_M", 15.0)
        patch.setattr(smoother, "WHOLE_S", 0.2)
        for module in (nearby_map, tracker, smoother):
            patch.setattr(module, "FASTEST", 20.0)
        yield


@pytest.fixture(scope="module")
def city_map(ring_map, in_tiles):
    """Rings beside each other, nine each way."""
    return city(ring_map, SIDE**2)


@pytest.fixture(scope="module")
def city_file(city_map, tmp_path_factory):
    """The same in a file."""
    path = tmp_path_factory.mktemp("city") / "city.mcap"
    save_map(city_map, path)
    return path


def crossing(ring, city_map, n_frames=6 * SIDE):
    """Vehicles that go round on ring after ring, from one corner of the city to the other; one is lost in between."""
    n = city_map.tessellation.n_cells // SIDE**2
    apart = city_map.tessellation.centers[(SIDE + 1) * n] - city_map.tessellation.centers[0]
    rows = []
    times = np.unique(ring.time_ns)[:n_frames]
    for i, time_ns in enumerate(times.tolist()):
        here = ring[(ring.time_ns == time_ns) & (ring.track_id < 3)]
        place = SIDE * i // n_frames
        seen = replace(here, position=here.position + place * apart, track_id=here.track_id + 10 * place)
        rows.append(seen[(seen.track_id % 10 > 0) | (i % 4 != 2)])
    return [Detections.of(row) for row in rows]


def by_hour(made):
    flow, pace = np.random.default_rng(1).uniform(0.5, 2.0, (2, 24, made.tessellation.n_cells, made.n_own_modes))
    return replace(made, schedule=Schedule(by="hour", zone="UTC", flow=flow, pace=pace))


def run(source, frames, *, sensor=None, smooth=False, follows=True):
    """All that is believed, forecast and smoothed; and the cells that were held at each frame."""
    nearby = NearbyMap(source, ahead_s=0.3 + (sensor.latency_s if sensor else 0.0), noise_m=KNOBS.noise_m)
    smoothed = []
    smoothing = Smoother(max_gap_s=KNOBS.max_gap_s, sinks=[lambda frame: smoothed.append(frame.estimates)])

    def tracker_of(group):
        knobs = {"config": KNOBS, "sensor": sensor, "rng": np.random.default_rng(0)}
        return (
            smoothing.tracker(group, nearby.part, tracking=None, **knobs) if smooth else Tracker(nearby.part, **knobs)
        )

    worlds = Worlds(tracker_of)
    along = nearby.along(frames, worlds)
    forecaster = Forecaster(nearby.part, [], horizon_s=0.3, dt_s=0.1, config=KNOBS, rng=np.random.default_rng(0))
    nearby.followers += [worlds.move_to, forecaster.move_to] if follows else []
    out, held = [], []
    with smoothing:
        for frame in along:
            worlds.predict(frame)
            worlds.weigh()
            made = worlds.frame()
            out += [getattr(made.estimates, field.name) for field in fields(made.estimates)]
            particles = made.particles.thinned(1)
            out += [particles.position, particles.direction, particles.speed, particles.weight, particles.mode]
            if int(frame.time_ns[0]) % 500_000_000 == 0:
                out.append(forecaster.paths(made))
            if smooth:
                smoothing.write(made)
            worlds.resample()
            held.append(np.empty(0, np.int64) if nearby.part.part is None else nearby.part.part.cell)
    for estimates in smoothed:
        out += [getattr(estimates, field.name) for field in fields(estimates)]
    return out, held


def are_equal(one, other):
    return len(one) == len(other) and all(
        np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize("case", ["labelled", "unlabelled", "by hour", "sensor", "smoothed"])
def test_tracking_by_what_is_near_gives_the_same_bytes(ring, city_map, city_file, tmp_path, case):
    """And what is held does not grow with the way: at most a part of all that it was at some time."""
    frames, whole, path = crossing(ring, city_map), city_map, city_file
    if case in ("unlabelled", "smoothed"):
        frames = [frame.without_ids() for frame in frames]
    if case == "by hour":
        whole, path = by_hour(city_map), tmp_path / "by_hour.mcap"
        save_map(whole, path)
    how = {"smooth": case == "smoothed"}
    if case == "sensor":
        how["sensor"] = replace(Sensor.white(0.5), latency_s=0.1)
    with MapFile(path) as by_tiles:
        found, held = run(by_tiles, frames, **how)
    assert are_equal(run(whole, frames, **how)[0], found)
    n_held = np.array([cell.size for cell in held])
    most = 0.8 if case == "by hour" else 0.55  # an hour's flow depends on the cells ahead
    assert 0 < n_held.max() < most * np.unique(np.concatenate(held)).size
    assert len(set(n_held.tolist())) > 4


@pytest.mark.parametrize("margin_m", [None, -80.0])
def test_less_than_what_is_near_gives_other_bytes(ring, city_map, city_file, monkeypatch, margin_m):
    """A part that stays where it was, and one that ends too near."""
    frames = crossing(ring, city_map)[:20]
    if margin_m is not None:
        monkeypatch.setattr(MapFile, "margin_m", margin_m)
    with MapFile(city_file) as by_tiles:
        found, _ = run(by_tiles, frames, follows=margin_m is not None)
    assert not are_equal(run(city_map, frames)[0], found)


def test_a_part_is_as_the_whole_but_for_its_numbers(city_map, city_file):
    whole = city_map
    with MapFile(city_file) as by_tiles:
        part = by_tiles.part(np.array([3, 20]))
    rows = np.append(part.part.cell, -1)
    assert 1 < rows.size < 0.9 * whole.tessellation.n_cells
    for name in ("direction", "speed"):
        for field in fields(getattr(whole, name)):
            of_all, ours = (getattr(getattr(of, name), field.name) for of in (whole, part))
            np.testing.assert_array_equal(ours, of_all[rows], err_msg=field.name)
    for name in ("n_rows", "bend", "gain", "centers"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[rows])
    np.testing.assert_array_equal(part.tessellation.area, whole.tessellation.area[rows[:-1]])
    n = part.motion.n_placed
    np.testing.assert_array_equal(part.motion.push[:n], whole.motion.push[part.part.manoeuvre])
    for name in ("present", "begins", "ends", "area", "center"):
        np.testing.assert_array_equal(getattr(Traffic.of(whole), name), getattr(Traffic.of(part), name))
    near = part.tessellation.centers + 1.0
    share = Traffic.of(whole).later(Traffic.of(whole).present, 0.3)
    expected, found = (Traffic.of(of).density(share, near, spread_m=0.1) for of in (whole, part))
    np.testing.assert_array_equal(expected, found)


def test_no_ground_is_no_cell(city_map, city_file):
    far = Detections(track_id=np.array(["a"]), time_ns=[0], position=np.full((1, 2), 1e5))
    with MapFile(city_file) as by_tiles:
        found, held = run(by_tiles, [far])
    assert held[0].size == 0
    assert are_equal(run(city_map, [far])[0], found)


def test_a_part_is_not_saved(city_file, tmp_path):
    with MapFile(city_file) as by_tiles, pytest.raises(TypeError, match="got LocatedPart"):
        save_map(by_tiles.part(np.array([0])), tmp_path / "part.mcap")
    assert not (tmp_path / "part.mcap").exists()


def test_only_a_large_map_is_read_by_its_tiles(ring_map, city_file, tmp_path, monkeypatch):
    save_map(ring_map, tmp_path / "map.mcap")
    monkeypatch.setattr(tiled_map, "WHOLE_CELLS", 100)
    assert open_map(tmp_path / "map.mcap").part is None
    with open_map(city_file) as by_tiles:
        assert by_tiles.is_large
