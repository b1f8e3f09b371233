"""A part of a map: tracking by it is tracking by the whole, to the last bit."""

from dataclasses import fields, replace

import numpy as np
import pytest

from benchmarks.city_map import city
from dirprim_filter.cli.ground import ground_of
from dirprim_filter.cli.reading import Reading
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import Tracker
from dirprim_filter.forecasting import Forecaster
from dirprim_filter.primitives.part import Ground
from dirprim_filter.primitives.schedule import Schedule
from dirprim_filter.primitives.traffic import Traffic
from dirprim_filter.recording import load_map, save_map
from dirprim_filter.recording.schemas import map_tiles, tiled_map
from dirprim_filter.recording.writer import write_tracks

KNOBS = FilterConfig(n_particles=100)
N_PLACES = 9


@pytest.fixture
def city_map(ring_map, tmp_path, monkeypatch):
    """Nine rings beside each other, 90 m apart, in a file of several tiles that counts as large."""
    monkeypatch.setattr(tiled_map, "WHOLE_CELLS", 10)
    monkeypatch.setattr(map_tiles, "TILE_CELLS", 50)
    made = city(ring_map, N_PLACES)
    flow, pace = np.random.default_rng(1).uniform(0.5, 2.0, (2, 24, made.tessellation.n_cells, made.n_own_modes))
    save_map(replace(made, schedule=Schedule(by="hour", zone="UTC", flow=flow, pace=pace)), tmp_path / "city.mcap")
    return tmp_path / "city.mcap"


def seen(ring, city_map):
    """Vehicles of two of the rings; one comes into sight later, far from all others; and a false detection."""
    here = ring[(ring.track_id < 4) & (ring.time_ns < 2_000_000_000)]
    shift = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], 2 * apart(load_map(city_map), ring)])
    moved = replace(here, position=here.position + shift[here.vehicle])
    late = moved[(moved.vehicle < 3) | (moved.time_ns > 700_000_000)]
    return Detections.of(late)


def apart(whole, ring):
    """From one ring to that beside it and above."""
    n = whole.tessellation.n_cells // N_PLACES
    centers = whole.tessellation.centers
    return centers[4 * n] - centers[0]


def followed(model, detections):
    """All that is believed and forecast of unlabelled and of labelled vehicles."""
    out = []
    for shown in (detections, detections.without_ids()):
        tracker = Tracker(model, config=KNOBS, with_innovations=True, rng=np.random.default_rng(0))
        forecaster = Forecaster(model, [], horizon_s=1.0, config=KNOBS, rng=np.random.default_rng(0))
        for frame in shown.frames():
            tracker.predict(frame)
            tracker.weigh()
            made = tracker.frame()
            out += [getattr(made.estimates, field.name) for field in fields(made.estimates)]
            particles = made.particles.thinned(1)
            out += [particles.position, particles.direction, particles.speed, particles.weight, particles.mode]
            out.append(forecaster.paths(made))
            tracker.resample()
    return out


@pytest.mark.parametrize(("by_hour", "reach_m"), [(False, 30.0), (True, 45.0)])
def test_tracking_by_a_part_gives_the_same_bytes(ring, city_map, by_hour, reach_m):
    """By the hour a manoeuvre's flow follows from that of the next cells, here of the ring."""
    detections = seen(ring, city_map)
    whole = load_map(city_map)
    if not by_hour:
        save_map(replace(whole, schedule=None), city_map, force=True)
        whole = load_map(city_map)
    part = load_map(city_map, near=lambda: Ground(detections.position, reach_m))
    assert 0 < part.tessellation.n_cells < 0.4 * whole.tessellation.n_cells
    expected, found = followed(whole, detections), followed(part, detections)
    assert all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(expected, found, strict=True))
    too_small = load_map(city_map, near=lambda: Ground(detections.position[:1], 6.0))
    other = followed(too_small, detections)
    assert not all(np.array_equal(a, b) for a, b in zip(expected, other, strict=True))


def test_where_vehicles_are_expected_is_of_the_whole(ring, city_map):
    whole, part = load_map(city_map), load_map(city_map, near=lambda: Ground(np.zeros((1, 2)), 30.0))
    for name in ("present", "begins", "ends", "area"):
        np.testing.assert_array_equal(getattr(Traffic.of(whole), name), getattr(Traffic.of(part), name))
    position = seen(ring, city_map).position
    share = Traffic.of(whole).later(Traffic.of(whole).present, 0.3)
    expected, found = (Traffic.of(of).density(share, position, spread_m=0.5) for of in (whole, part))
    np.testing.assert_array_equal(expected, found)


def test_a_part_has_the_rows_of_its_cells(city_map):
    whole = load_map(city_map)
    part = load_map(city_map, near=lambda: Ground(np.zeros((1, 2)), 30.0))
    rows = np.append(part.tessellation.cells, -1)
    for name in ("direction", "speed"):
        for field in fields(getattr(whole, name)):
            of_all, ours = (getattr(getattr(of, name), field.name) for of in (whole, part))
            np.testing.assert_array_equal(ours, of_all[rows], err_msg=field.name)
    for name in ("n_rows", "bend", "gain", "centers"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[rows])
    np.testing.assert_array_equal(part.schedule.pace, whole.schedule.pace[:, rows[:-1]])
    place = 20.0 * np.array([[1.0, 0.0], [0.0, 1.0]])
    expected, found = (of.log_density(place, np.array([1.6, 3.1]), np.array([8.0, 7.0])) for of in (whole, part))
    np.testing.assert_array_equal(expected, found)


def test_a_small_map_is_loaded_whole_and_its_ground_not_asked_for(ring_map, tmp_path):
    save_map(ring_map, tmp_path / "map.mcap")
    assert load_map(tmp_path / "map.mcap", near=lambda: pytest.fail("asked")).part is None


def test_no_ground_is_no_cell(city_map):
    part = load_map(city_map, near=lambda: Ground(np.empty((0, 2)), 30.0))
    assert part.tessellation.n_cells == 0
    followed(part, Detections(track_id=np.array(["a"]), time_ns=[0], position=np.zeros((1, 2))))


def test_a_part_is_not_saved(city_map, tmp_path):
    part = load_map(city_map, near=lambda: Ground(np.zeros((1, 2)), 30.0))
    with pytest.raises(TypeError, match="got LocatedPart"):
        save_map(part, tmp_path / "part.mcap")
    assert not (tmp_path / "part.mcap").exists()


def test_the_ground_is_where_the_log_says_and_a_drive_beyond(ring, tmp_path):
    write_tracks(ring[ring.track_id < 2], tmp_path / "log.mcap")
    ground = ground_of(tmp_path / "log.mcap", Reading(), seconds=0.5)()
    assert ground.covers(ring.position[ring.track_id < 2] + [21.0, 21.0]).all()
    assert not ground.covers(np.array([[150.0, 0.0]])).any()
    assert ground_of(tmp_path / "pipe", Reading(), seconds=0.5) is None
