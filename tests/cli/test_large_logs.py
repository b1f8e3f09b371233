"""Of a log with images a command holds no more than of one without."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap.writer import CompressionType

from cli.commands import DONE, GRID, dirprim
from dirprim_filter import write_tracks
from dirprim_filter.detections import Detections
from peak_memory import FORGET, with_growth
from recording.mcap_files import protobuf_schema, stock, write_messages
from situations import ring_traffic

N_IMAGES, IMAGE = 100, bytes(2 << 20)
MOST_GROWTH = 120 << 20


@pytest.fixture
def camera_log(tmp_path, monkeypatch):
    """Vehicles on a ring, seen by a sensor and by a camera: 200 MB, which do not stay on the disk."""
    monkeypatch.chdir(tmp_path)
    tracks = ring_traffic(np.random.default_rng(7))
    write_tracks(tracks, tmp_path / "small.mcap", detections=Detections.of(tracks))
    small, path = stock(tmp_path / "small.mcap"), tmp_path / "log.mcap"

    def sent():
        for number, (schema, channel, message) in enumerate(small):
            yield channel.topic, message.log_time, message.data, (schema.name, schema.encoding, schema.data)
            if number % (len(small) // N_IMAGES) == 0:
                yield "/camera", message.log_time, IMAGE, protobuf_schema(CompressedImage)

    write_messages(path, sent(), "protobuf", compression=CompressionType.NONE, chunk_size=len(IMAGE))
    assert path.stat().st_size > N_IMAGES * len(IMAGE)
    yield path
    path.unlink()


@pytest.mark.slow
@pytest.mark.skipif(not FORGET.exists(), reason="only Linux says how much memory was the most")
def test_memory_does_not_follow_from_images(camera_log):
    for command in (
        f"info {camera_log} --check", f"learn {camera_log} -o map.mcap {GRID}",
        f"track {camera_log} --map map.mcap -o tracks.mcap --end 5 --set n_particles=50",
    ):  # fmt: skip
        code, grown = with_growth(lambda command=command: dirprim(command))
        assert code == DONE
        assert grown < MOST_GROWTH, f"{command}: {grown >> 20} MiB"
