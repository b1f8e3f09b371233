"""A map's summary: by it tiles are read without the others, wherever they stand; without it maps are read whole."""

from dataclasses import replace

import numpy as np
import pytest
from test_map_file import assert_equal, some_map

from dirprim_filter.primitives.traffic import Passages, Totals
from dirprim_filter.recording import load_map, open_map, save_map, topic_names
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.map_file import MapFile
from dirprim_filter.recording.schemas import map_tiles, tiled_map
from dirprim_filter.recording.schemas.map_summary import add_tile, summary_of
from dirprim_filter.recording.schemas.map_tiles import encode_tiles

N_CELLS = 150


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch):
    monkeypatch.setattr(map_tiles, "TILE_CELLS", 40)
    monkeypatch.setattr(tiled_map, "WHOLE_CELLS", 100)
    monkeypatch.setattr(tiled_map, "DENSE_SQUARES", 0)


def messages_of(made):
    """The summary of a map, and its tiles."""
    summary = summary_of(made)
    for tile in encode_tiles(made):
        add_tile(summary, tile)
    return summary, list(encode_tiles(made))


def write(path, summary, tiles, *, in_one_chunk=False):
    with LogWriter(path, metadata={}) as writer:
        for tile in tiles:
            writer.write(topic_names.MAP, tile, 0)
            if not in_one_chunk:
                writer.end_chunk()
        if summary is not None:
            writer.write(topic_names.MAP_SUMMARY, summary, 0)


def part_of(path, tiles):
    with MapFile(path) as opened:
        return opened.part(np.array(tiles))


@pytest.mark.parametrize("voronoi", [False, True])
@pytest.mark.parametrize("in_one_chunk", [False, True])
def test_tiles_are_found_wherever_they_stand(tmp_path, voronoi, in_one_chunk):
    made = some_map(N_CELLS, voronoi=voronoi)
    save_map(made, tmp_path / "map.mcap")
    summary, tiles = messages_of(made)
    write(tmp_path / "other.mcap", summary, tiles[1:] + tiles[:1] if in_one_chunk else tiles, in_one_chunk=in_one_chunk)
    for wanted in ([2], [0, 3]):
        expected, found = (part_of(tmp_path / name, wanted) for name in ("map.mcap", "other.mcap"))
        np.testing.assert_array_equal(found.part.cell, expected.part.cell)
        np.testing.assert_array_equal(found.motion.push, expected.motion.push)


def test_a_tile_that_stays_is_as_one_that_is_read_anew(tmp_path):
    save_map(some_map(N_CELLS), tmp_path / "map.mcap")
    with MapFile(tmp_path / "map.mcap") as opened:
        opened.part(np.array([0, 1]))
        found = opened.part(np.array([1, 2]))
    expected = part_of(tmp_path / "map.mcap", [1, 2])
    np.testing.assert_array_equal(found.part.cell, expected.part.cell)
    np.testing.assert_array_equal(found.motion.following, expected.motion.following)
    np.testing.assert_array_equal(found.part.traffic.flow.toarray(), expected.part.traffic.flow.toarray())


def test_the_summary_has_the_sums_of_all_manoeuvres(tmp_path):
    made = some_map(N_CELLS)
    save_map(made, tmp_path / "map.mcap")
    with MapFile(tmp_path / "map.mcap") as opened:
        summary = opened._tiles.summary
        assert open_map(tmp_path / "map.mcap").is_large
    assert summary.n_cells == N_CELLS
    assert summary.totals == Totals.of(Passages.of(made), made.tessellation)
    assert summary.totals.seconds >= made.motion.seconds[: made.motion.n_placed].sum()


def test_of_a_map_without_transitions_nothing_is_known_of_traffic_in_any_part(tmp_path):
    made = some_map(N_CELLS)
    nothing = np.zeros(len(made.motion) + 1, np.int64)
    motion = replace(made.motion, first=nothing, following=nothing[:0], count=made.motion.count[:0])
    save_map(replace(made, motion=motion), tmp_path / "map.mcap")
    save_map(made, tmp_path / "control.mcap")
    assert part_of(tmp_path / "map.mcap", [2]).part.traffic is None
    assert part_of(tmp_path / "control.mcap", [2]).part.traffic is not None


def test_without_a_summary_a_map_is_read_whole(tmp_path):
    made = some_map(N_CELLS)
    write(tmp_path / "map.mcap", None, encode_tiles(made))
    assert_equal(load_map(tmp_path / "map.mcap"), made)
    assert_equal(open_map(tmp_path / "map.mcap"), made)
    with pytest.raises(RecordingError, match=r"map\.mcap: has no summary"):
        part_of(tmp_path / "map.mcap", [0])


def test_a_map_whose_summary_is_damaged_is_read_whole(tmp_path):
    made, path = some_map(N_CELLS), tmp_path / "map.mcap"
    save_map(made, path)
    with MapFile(path) as opened:
        (file,) = opened._messages._summaries.by_file()
        (chunk,) = (chunk for chunk in file.outline.chunks if not file.is_beside(chunk))
        assert opened.is_large
    data = bytearray(path.read_bytes())
    data[chunk.end - 8] ^= 0xFF
    path.write_bytes(data)
    assert_equal(open_map(path), made)
    assert_equal(load_map(path), made)


def set_number(part, name, value):
    def harm(summary, _):
        setattr(getattr(summary, part) if part else summary, name, value)

    return harm


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (set_number("", "version", 3), "of an older version, 3"),
        (lambda summary, _: summary.tiles.pop(), "expected 4 tiles, got 3"),
        (set_number("traffic", "seconds", np.nan), "traffic: expected no negative"),
        (set_number("traffic", "begun", -1.0), "traffic: expected no negative"),
        (set_number("traffic", "seconds", 0.0), "traffic: expected no negative"),
        (set_number("", "n_cells", 100), "cells: expected numbers 0 to 99"),
        (set_number("", "n_manoeuvres", 100), "expected"),
        (set_number("shared", "n_place_free_modes", 0), "tiles of several"),
        (lambda _, tiles: tiles.reverse(), r"expected tiles \[3\], got 0"),
        (lambda _, tiles: tiles[3].motion.arrived.__setitem__(2, np.inf), "arrived: expected no negative"),
        (lambda _, tiles: tiles[3].motion.number.__setitem__(2, -1), "manoeuvres: expected numbers"),
        (lambda _, tiles: tiles[3].cell.__setitem__(2, 149), "cells: expected numbers 0 to 149, each once"),
    ],
)
def test_what_is_harmed_is_reported_in_one_line(tmp_path, harm, message):
    summary, tiles = messages_of(some_map(N_CELLS))
    harm(summary, tiles)
    write(tmp_path / "map.mcap", summary, tiles)
    with pytest.raises(RecordingError, match=message) as caught:
        part_of(tmp_path / "map.mcap", [3])
    assert "map.mcap" in str(caught.value)
    assert "\n" not in str(caught.value)
