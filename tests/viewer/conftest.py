"""One small scene for all tests of the viewer: three cells along a road to the north-east, two vehicles on it."""

import numpy as np
import pytest
import rerun as rr

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from situations import estimates_of, tracks_of
from tessellation import GridTessellation

START_NS = 1_700_000_000_123_456_789
STEP_NS = 100_000_000
N_PARTICLES = 50


@pytest.fixture(autouse=True)
def strict():
    """Without it the SDK turns every mistake into a warning."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture
def scene_map():
    """Three cells of 10 m; two own modes, then one background mode; the third cell holds no data."""
    cells = GridTessellation.covering(np.array([[5.0, 5.0], [15.0, 15.0], [25.0, 25.0]]), cell_size=10.0)
    return PrimitiveMap(
        tessellation=cells,
        modes=Modes.flat(
            np.array([[0.9, 0.0, 0.1], [0.6, 0.3, 0.1], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]),
            np.array([[np.pi / 2, 0.0, 0.0], [0.3, 2.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
            np.array([[500.0, 1.0, 0.0], [8.0, 0.5, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 0.0]]),
            np.full((4, 3), 4.0),
            np.array([[0.5, 1.0, 1.0]] * 4),
        ),
        n_rows=np.array([100, 60, 0, 160]),
        n_background_modes=1,
    )


@pytest.fixture
def scene_tracks():
    """Two vehicles, five rows each, to the north-east at 10 m/s."""
    way = np.add.outer([5.0, 15.0], 0.7071 * np.arange(5))
    time_ns, track_id = START_NS + STEP_NS * np.arange(5), np.array([[7], [8]])
    return tracks_of(way[..., None] * np.ones(2), track_id=track_id, time_ns=time_ns, direction=np.pi / 4, speed=10.0)


@pytest.fixture
def scene_frames(scene_tracks):
    """What a filter could say of `scene_tracks`; the last frame has lost all vehicles."""
    rng = np.random.default_rng(1)
    frames = []
    for time_ns in np.unique(scene_tracks.time_ns):
        now = scene_tracks[scene_tracks.time_ns == time_ns]
        n = len(now) * N_PARTICLES
        cloud = now.position[:, None] + rng.normal(0.0, 0.7, (len(now), N_PARTICLES, 2))
        estimates = estimates_of(
            now.track_id, time_ns=now.time_ns, position=now.position, direction=now.direction,
            direction_resultant=0.9, speed=now.speed, effective_sample_size=30.0, log_evidence=-2.0,
        )  # fmt: skip
        samples = Particles(
            position=cloud.reshape(-1, 2), direction=rng.normal(np.pi / 4, 0.2, n), speed=np.full(n, 10.0),
            weight=np.full(n, 1.0 / N_PARTICLES), vehicle=np.repeat(np.arange(len(now)), N_PARTICLES),
        )  # fmt: skip
        seen = Detections.of(now)
        frames.append(TrackedFrame(time_ns=int(time_ns), detections=seen, estimates=estimates, particles=samples))
    nothing = {"detections": Detections.none(), "estimates": Estimates.concatenate([]), "particles": Particles.none()}
    return [*frames, TrackedFrame(time_ns=frames[-1].time_ns + STEP_NS, **nothing)]
