"""A map that is loaded and let go tile by tile: tracking by it is tracking by the whole.

What is believed of a vehicle's motion is the same to the last bit. How probably it exists depends on how many
undetected vehicles are expected where, and what of these is not held is known on average alone.
"""

from dataclasses import fields, replace

import numpy as np
import pytest

from benchmarks.city_map import city
from dirprim_filter import nearby_map
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import Tracker, Worlds, tracker
from dirprim_filter.filtering.smoothing import Smoother, smoother
from dirprim_filter.filtering.undetected import Undetected
from dirprim_filter.forecasting import Forecaster
from dirprim_filter.nearby_map import NearbyMap
from dirprim_filter.primitives.traffic import Traffic
from dirprim_filter.recording import open_map, save_map
from dirprim_filter.recording.map_file import MapFile
from dirprim_filter.recording.schemas import map_tiles, tiled_map
from dirprim_filter.sensor import Sensor
from dirprim_filter.sight import Sight
from tessellation import tiles

KNOBS = FilterConfig(n_particles=60, max_gap_s=0.3)
SIDE = 9
EXISTENCE = 1e-4
"""By how much probabilities of existence may differ, in proportion; they do by 5e-6, where journeys take 10 s."""


@pytest.fixture(scope="module")
def in_tiles():
    """Maps of some tens of metres count as large, and are kept as such."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tiled_map, "WHOLE_CELLS", 10)
        patch.setattr(map_tiles, "TILE_M", 72.0)
        for module in (tiles, tiled_map):
            patch.setattr(module, "BLOCK_SQUARES", 8)
        patch.setattr(tiled_map, "DENSE_SQUARES", 0)
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


def run(source, frames, *, sensor=None, smooth=False, follows=True):
    """All that is believed, forecast and smoothed; the probabilities of existence; the cells held at each frame."""
    nearby = NearbyMap(
        source, ahead_s=0.3 + (sensor.latency_s if sensor else 0.0), noise_m=KNOBS.noise_m,
        sight=sensor.sight if sensor else None,
    )  # fmt: skip
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
    out, exists, held = [], [], []

    def note(estimates):
        out.extend(getattr(estimates, field.name) for field in fields(estimates) if field.name != "existence")
        exists.append(estimates.existence)

    with smoothing:
        for frame in along:
            worlds.predict(frame)
            worlds.weigh()
            made = worlds.frame()
            note(made.estimates)
            particles = made.particles.thinned(1)
            out += [particles.position, particles.direction, particles.speed, particles.weight, particles.mode]
            if int(frame.time_ns[0]) % 500_000_000 == 0:
                out.append(forecaster.paths(made))
            if smooth:
                smoothing.write(made)
            worlds.resample()
            held.append(np.empty(0, np.int64) if nearby.part.part is None else nearby.part.part.cell)
    for estimates in smoothed:
        note(estimates)
    return out, np.concatenate(exists), held


def are_equal(one, other):
    return len(one) == len(other) and all(
        np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize("case", ["labelled", "unlabelled", "sensor", "sight", "smoothed"])
def test_tracking_by_what_is_near_gives_the_same_bytes_but_for_how_probably_a_vehicle_exists(
    ring, city_map, city_file, case
):
    """And what is held does not grow with the way: at most a part of all that it was at some time."""
    frames = crossing(ring, city_map)
    if case in ("unlabelled", "sight", "smoothed"):
        frames = [frame.without_ids() for frame in frames]
    how = {"smooth": case == "smoothed"}
    if case == "sensor":
        how["sensor"] = replace(Sensor.white(0.5), latency_s=0.1)
    if case == "sight":
        how["sensor"] = replace(Sensor.white(0.5), sight=middle_of(city_map))
    with MapFile(city_file) as by_tiles:
        found, exists, held = run(by_tiles, frames, **how)
    expected, probably, _ = run(city_map, frames, **how)
    assert are_equal(expected, found)
    np.testing.assert_allclose(exists, probably, rtol=EXISTENCE)
    n_held = np.array([cell.size for cell in held])
    most = 0.8 if case == "sight" else 0.55  # sight is held
    assert 0 < n_held.max() < most * np.unique(np.concatenate(held)).size
    assert len(set(n_held.tolist())) > 4


@pytest.mark.parametrize("margin_m", [None, -80.0])
def test_less_than_what_is_near_gives_other_bytes(ring, city_map, city_file, monkeypatch, margin_m):
    """A part that stays where it was, and one that ends too near."""
    frames = crossing(ring, city_map)[:20]
    if margin_m is not None:
        monkeypatch.setattr(MapFile, "margin_m", margin_m)
    with MapFile(city_file) as by_tiles:
        found, *_ = run(by_tiles, frames, follows=margin_m is not None)
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
    of_all, ours = Traffic.of(whole), Traffic.of(part)
    for name in ("present", "begins", "ends"):
        np.testing.assert_array_equal(getattr(ours, name)[:n], getattr(of_all, name)[part.part.manoeuvre])
    assert ours.total_area == of_all.total_area
    for name in ("present", "begins"):
        assert getattr(ours, name).sum() == pytest.approx(getattr(of_all, name).sum(), rel=1e-12)
    np.testing.assert_allclose(ours.later(ours.present, 0.3), ours.present, rtol=1e-9)  # as many come as go


def along_a_diagonal(city_map, by_tiles, *, p, sight=None, holds_sight=True, forgets=False, every=1):
    """By how much, in proportion, a part's first detections and level differ from those of the whole; the worst."""
    config, worst, rng = TrackingConfig(detection_probability=p), np.zeros(2), np.random.default_rng(0)
    centers, knobs = city_map.tessellation.centers, FilterConfig()
    beyond = np.empty((0, 4)) if sight is None or not holds_sight else sight.boxes
    whole, ours = Undetected(Traffic.of(city_map), config, knobs, sight=sight), None
    for i, place in enumerate(np.linspace(centers.min(axis=0), centers.max(axis=0), 60)):
        held = nearby_map._on(by_tiles.box, np.vstack([np.tile(place, 2), beyond]), 60.0)
        part = Traffic.of(by_tiles.part(held))
        ours = ours or Undetected(part, config, knobs, sight=sight)
        if forgets:
            ours._past.clear()
        ours.move_to(part)
        dt_s, near = rng.uniform(0.05, 0.15), np.linalg.norm(centers - place, axis=1) < 25.0
        for of in (whole, ours):
            of.advance(dt_s, 5.0)
        expected, found = (of.first_detections(centers[near]) for of in (whole, ours))
        seen = centers[near][rng.random(near.sum()) < 0.05]
        for of in (whole, ours) if i % every == 0 else ():
            of.see(seen)
        off = np.max(np.abs(found / expected - 1.0), initial=0.0), abs(ours.level / whole.level - 1.0)
        worst = np.maximum(worst, off)
    return worst


@pytest.mark.parametrize(("p", "every", "tolerance"), [(0.9, 1, 3e-3), (0.5, 1, 3e-3), (0.9, 20, 0.2)])
def test_undetected_vehicles_of_a_part_are_those_of_the_whole(city_map, city_file, p, every, tolerance):
    """To some thousandths, at 10 Hz where journeys take 10 s; if the last frames were forgotten, not at all.

    Where one frame in 20 has detections of a kind, vehicles come from beyond what is held before the next.
    """
    with MapFile(city_file) as by_tiles:
        assert (along_a_diagonal(city_map, by_tiles, p=p, every=every) < tolerance).all()
        assert (along_a_diagonal(city_map, by_tiles, p=p, every=every, forgets=True) > 0.2).all()


def test_what_is_in_sight_is_held_so_that_undetected_vehicles_are_those_of_the_whole(city_map, city_file):
    with MapFile(city_file) as by_tiles:
        assert (along_a_diagonal(city_map, by_tiles, p=0.9, sight=middle_of(city_map)) < 1e-9).all()
        control = along_a_diagonal(city_map, by_tiles, p=0.9, sight=middle_of(city_map), holds_sight=False)
    assert control[1] > 0.01


def middle_of(city_map):
    """A sensor that sees a square of 120 m."""
    corners = 60.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return Sight.of([(city_map.tessellation.centers.mean(axis=0) + corners).tolist()])


def test_no_ground_is_no_cell(city_map, city_file):
    far = Detections(track_id=np.array(["a"]), time_ns=[0], position=np.full((1, 2), 1e5))
    with MapFile(city_file) as by_tiles:
        found, _, held = run(by_tiles, [far])
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
