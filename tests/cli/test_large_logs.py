"""Of a log with images a command holds no more than of one without."""

from io import BufferedWriter, FileIO

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from cli.commands import DONE, GRID, dirprim
from dirprim_filter import write_tracks
from dirprim_filter.detections import Detections
from peak_memory import FORGET, with_growth
from situations import ring_traffic

MARK, BLANK, N_IMAGES = b"the road at night", 2 << 20, 100
IMAGE = MARK + bytes(BLANK)
MOST_GROWTH = 120 << 20


class Sparse(BufferedWriter):
    """An image takes no room on the disk."""

    def write(self, data):
        begin, mark, end = bytes(data).partition(MARK)
        super().write(begin + mark)
        if mark:
            self.seek(BLANK, 1)
        super().write(end[BLANK:] if mark else end)
        return len(data)


@pytest.fixture
def camera_log(tmp_path, monkeypatch):
    """Vehicles on a ring, seen by a sensor and by a camera: 200 MB."""
    monkeypatch.chdir(tmp_path)
    tracks = ring_traffic(np.random.default_rng(7))
    write_tracks(tracks, tmp_path / "small.mcap", detections=Detections.of(tracks))
    path = tmp_path / "log.mcap"
    with (tmp_path / "small.mcap").open("rb") as small, Sparse(FileIO(path, "w")) as file:
        writer = Writer(file, compression=CompressionType.NONE, chunk_size=len(IMAGE))
        writer.start()
        reader = make_reader(small)
        n = reader.get_summary().statistics.message_count
        image = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"uint8[] data")
        camera, channels = writer.register_channel("/camera", "cdr", image), {}
        for number, (schema, channel, message) in enumerate(reader.iter_messages()):
            if channel.id not in channels:
                of = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, of)
            times = message.log_time, message.publish_time
            writer.add_message(channels[channel.id], times[0], message.data, times[1], message.sequence)
            if number * N_IMAGES // n < (number + 1) * N_IMAGES // n:
                writer.add_message(camera, times[0], IMAGE, times[1])
        writer.finish()
    assert path.stat().st_size > N_IMAGES * len(IMAGE)
    assert path.stat().st_blocks * 512 < 10 * len(IMAGE)
    return path


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
