"""The origin of a log's plane: no single fix decides it, all that is made of the log has it, and other planes move."""

from dataclasses import replace

import numpy as np
import pyproj
import pytest
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from mcap_files import detections, write_protobuf_log

from dirprim_filter import Detections, Tracks, learn_primitives, load_map, read_estimates, save_map, write_tracks
from dirprim_filter.columns import GLOBE, ORIGIN
from dirprim_filter.filtering import Tracker
from dirprim_filter.origin import REACH_M, Origin
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.estimate_tables import write_estimates
from dirprim_filter.recording.losses import FAR, INVALID
from dirprim_filter.recording.reader import read_track_logs, read_tracks, stream_detections
from dirprim_filter.recording.transforms.geodesy import FIXES, median_of
from dirprim_filter.recording.writer import EstimateWriter
from dirprim_filter.replay import replay
from situations import one_cell_map, tracks_of

HERE = np.array([48.137, 11.575])
START_NS, STEP_NS, N = 1_700_000_000_000_000_000, 100_000_000, 150
DRIVE = HERE + np.column_stack([np.linspace(0, 1e-3, N), np.linspace(0, 2e-3, N)])


def fixes(path, places):
    """A log of a fix each .1 s."""
    time_ns = [START_NS + k * STEP_NS for k in range(len(places))]
    made = [LocationFix(latitude=latitude, longitude=longitude) for latitude, longitude in places.tolist()]
    for one, at_ns in zip(made, time_ns, strict=True):
        one.timestamp.FromNanoseconds(at_ns)
    return write_protobuf_log(path, [("/gps", *of) for of in zip(time_ns, made, strict=True)])


def csv(path, places, header="time_s,track_id,latitude_deg,longitude_deg"):
    rows = [f"{0.1 * k:.1f},v,{a!r},{b!r}" for k, (a, b) in enumerate(places.tolist())]
    path.write_text("\n".join([header, *rows]))
    return path


WRITERS = {"log.mcap": fixes, "table.csv": csv}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("bad", [(0.0, 0.0), (0.0, 0.001), (11.575, 48.137), (51.5, 11.575), (-48.137, -168.425)])
@pytest.mark.parametrize("at", [0, 60])
def test_one_wrong_fix_is_no_origin_and_is_named(tmp_path, name, bad, at, caplog):
    """Placeholders, latitude and longitude swapped, 370 km away, and the other side of the Earth."""
    places = DRIVE.copy()
    places[at] = bad
    log = read_track_logs(WRITERS[name](tmp_path / name, places))
    assert len(log.tracks) == N - 1
    assert log.losses.dropped == {INVALID if bad == (0.0, 0.0) and name == "log.mcap" else FAR: 1}
    assert caplog.text.count("left out") == caplog.text.count("left out 1 rows") == 1
    assert np.abs(np.array(log.tracks.origin) - HERE).max() < 2e-3
    np.testing.assert_allclose(log.tracks.origin.to_globe(log.tracks.position), np.delete(DRIVE, at, axis=0), atol=1e-8)


def test_the_origin_is_the_median_of_the_first_fixes_however_they_are_read(tmp_path, monkeypatch):
    expected = median_of(DRIVE)
    assert expected == Origin(*np.sort(DRIVE[:FIXES], axis=0)[FIXES // 2])
    path = fixes(tmp_path / "log.mcap", DRIVE)
    whole = read_tracks(path)
    assert whole.origin == expected
    monkeypatch.setattr("dirprim_filter.recording.schemas.decoders.BATCH_MESSAGES", 7)
    streamed = detections(path)
    assert streamed.origin == expected
    np.testing.assert_array_equal(streamed.position, whole.position)
    assert read_tracks(csv(tmp_path / "table.csv", DRIVE)).origin == expected
    assert median_of(np.array([[0.0, 179.9], [0.0, -179.9], [0.0, -179.8]])) == (0.0, -179.9)


def test_places_go_to_the_plane_and_back_as_by_pyproj(tmp_path):
    """By PROJ's geocentric coordinates and a rotation of our own; and back within a millimetre over all its reach."""
    origin, rng = Origin(*HERE), np.random.default_rng(0)
    geodetic = HERE + rng.uniform(-2.0, 2.0, (500, 2))
    to_centre = pyproj.Transformer.from_crs(4979, 4978, always_xy=True).transform
    there, base = (np.array(to_centre(*part.T[::-1], np.zeros(len(part)))).T for part in (geodetic, HERE[None]))
    latitude, longitude = np.radians(HERE)
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    plane = (there - base) @ np.column_stack([east, np.cross(up, east)])
    near = np.hypot(*plane.T) < REACH_M - 1e4
    np.testing.assert_allclose(origin.to_plane(geodetic)[near], plane[near], atol=1e-3)
    _, _, metres = pyproj.Geod(ellps="WGS84").inv(*geodetic[near].T[::-1], *origin.to_globe(plane[near]).T[::-1])
    assert np.max(metres) < 1e-3


def test_all_that_is_made_of_a_log_has_its_origin(tmp_path):
    tracks = read_tracks(fixes(tmp_path / "log.mcap", DRIVE))
    origin = tracks.origin
    assert origin is not None
    write_tracks(tracks, tmp_path / "tracks.mcap", detections=Detections.of(tracks))
    assert read_tracks(tmp_path / "tracks.mcap") == tracks
    assert all(seen.origin == origin for seen in stream_detections(tmp_path / "tracks.mcap"))
    with EstimateWriter(tmp_path / "out.mcap", metadata={}) as writer:  # of a tracker whose map has no origin
        replay(Detections.of(tracks).frames(), Tracker(one_cell_map(), rng=np.random.default_rng(0)), [writer])
    estimates = read_estimates(tmp_path / "out.mcap")
    assert estimates.origin == estimates[:3].origin == origin
    for name in ("out.csv", "out.parquet"):
        write_estimates(estimates, tmp_path / name)
        again = read_tracks(tmp_path / name)
        assert again.origin == origin
        np.testing.assert_array_equal(again.position, estimates.position)
    table = estimates.to_arrow()
    np.testing.assert_array_equal(np.column_stack([table[name] for name in GLOBE]), origin.to_globe(estimates.position))
    assert [table[name][0].as_py() for name in ORIGIN] == list(origin)
    learned = learn_primitives(tracks, tessellation="grid", cell_size=20.0, rng=np.random.default_rng(0))
    save_map(learned, tmp_path / "map.mcap")
    assert load_map(tmp_path / "map.mcap").origin == learned.origin == learned.without_places().origin == origin
    save_map(replace(learned, origin=None), tmp_path / "bare.mcap")
    assert load_map(tmp_path / "bare.mcap").origin is None


def test_rows_of_two_planes_do_not_join():
    one, other = (replace(tracks_of(np.zeros((1, 1, 2))), origin=at) for at in (HERE, (48.2, 11.5)))
    assert one.origin == tuple(HERE)
    with pytest.raises(ValueError, match=r"origin: expected parts of one plane, got origins 48.137,11.575 and 48.2,"):
        Tracks.concatenate([one, other])
    assert Tracks.concatenate([Tracks.none(), one]).origin == one.origin
    with pytest.raises(ValueError, match="origin: expected latitude,longitude in degrees"):
        replace(one, origin=(91.0, 0.0))
    with pytest.raises(ValueError, match=r"expected the map's origin, 48\.2"):
        Tracker(replace(one_cell_map(), origin=(48.2, 11.5)), rng=np.random.default_rng(0)).step(Detections.of(one))


def test_logs_of_one_command_are_on_the_plane_of_the_first(tmp_path):
    """A log of fixes, a table, and what was converted before, with an origin of its own."""
    later = DRIVE + np.array([3e-3, -1e-3])
    first, second = fixes(tmp_path / "log.mcap", DRIVE), csv(tmp_path / "table.csv", later)
    own = read_tracks(second)
    write_tracks(own, tmp_path / "converted.mcap")
    own_origin, whole = own.origin, read_tracks([first, second])
    joined = read_tracks([first, tmp_path / "converted.mcap"])
    assert whole.origin == joined.origin == median_of(DRIVE) != own_origin
    expected = whole.origin.to_plane(later)
    for tracks in (whole, joined):
        np.testing.assert_allclose(tracks[tracks.group == 1].position, expected, atol=1e-4)


def test_metres_and_degrees_meet_only_where_the_origin_is_stated(tmp_path):
    degrees = fixes(tmp_path / "log.mcap", DRIVE)
    metres = csv(tmp_path / "metres.csv", np.column_stack([np.arange(9.0), np.zeros(9)]), "time_s,track_id,x_m,y_m")
    write_tracks(read_tracks(metres), tmp_path / "metres.mcap")
    for plain in (metres, tmp_path / "metres.mcap"):
        for logs, why in (
            ([degrees, plain], r"metres.*: expected latitudes and longitudes, as .*log.mcap has the"),
            ([plain, degrees], r"log.mcap: expected positions in metres, as of .*, which has no orig"),
        ):
            with pytest.raises(RecordingError, match=why):
                read_tracks(logs)
        stated = read_tracks([plain, degrees], origin=Origin(*HERE))
        assert stated.origin == tuple(HERE)
        assert read_tracks(plain).origin is None
