"""Traffic and maps that several test modules build with numbers of their own."""

import numpy as np

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker, _kernels
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import CellRows
from dirprim_filter.tracks import Tracks
from tessellation import GridTessellation

TRUSTING = TrackingConfig(clutter_density=1e-12)
"""Of a sensor without false detections: whatever it reports is a vehicle from its first detection on."""


def tracks_of(position, **columns):
    """Vehicles at places (vehicles, rows, 2), a row each 0.1 s; they head east at 1 m/s but for the columns given."""
    position = np.asarray(position, np.float64)
    shape = position.shape[:-1]
    usual = {"track_id": np.arange(shape[0])[:, None], "time_ns": 10**8 * np.arange(shape[1])}
    given = usual | {"direction": 0.0, "speed": 1.0} | columns
    filled = {name: np.broadcast_to(column, shape).ravel() for name, column in given.items()}
    return Tracks(position=position.reshape(-1, 2), **filled)


def seen_at(time_s, places, ids=None, **columns):
    """Detections of one instant, in order of their places (n, 2); without ids unless these are given."""
    n = len(places)
    known = {"track_id": [""] * n if ids is None else ids, "time_ns": [round(time_s * 1e9)] * n}
    return Detections(**known, position=np.reshape(places, (-1, 2)), **columns)


def tracker_of(model, *, density=3.0, tracking=None, with_innovations=False, seed=0, **settings):
    """A tracker by a map or, of None, by a Kalman filter of white acceleration of this density."""
    config = FilterConfig(**settings)
    model = model or ConstantVelocityKalman(acceleration_density=density, config=config)
    rng = np.random.default_rng(seed)
    return Tracker(model, config=config, tracking=tracking, with_innovations=with_innovations, rng=rng)


def estimates_by(tracker, seen):
    """What a tracker estimates of all detections, frame by frame."""
    return Estimates.concatenate([tracker.track(frame).estimates for frame in seen.frames()])


def keys(rows):
    """Of which vehicle and instant each row is; an id is the same as a number and as a text."""
    return list(zip(map(str, rows.track_id.tolist()), rows.time_ns.tolist(), strict=True))


def beside(rows, others):
    """(2, k) numbers of rows, and of those of others that are of the same vehicle and instant."""
    row_of = {key: i for i, key in enumerate(keys(others))}
    return np.array([(i, row_of[key]) for i, key in enumerate(keys(rows)) if key in row_of]).T


def estimates_of(track_id, *, position=0.0, **columns):
    """Estimates at time 0 that are sure of a course to the east at 1 m/s, but for the columns given."""
    n = len(track_id)
    sure = dict.fromkeys(("direction_resultant", "speed", "speed_std", "effective_sample_size"), 1.0)
    given = sure | {"time_ns": 0, "direction": 0.0, "log_evidence": 0.0} | columns
    return Estimates(
        track_id=track_id, position=np.broadcast_to(position, (n, 2)), covariance=np.tile(np.eye(2), (n, 1, 1)),
        **{name: np.resize(column, n) for name, column in given.items()},
    )  # fmt: skip


def simulated(truth, n, seed):
    """Directions and speeds of n vehicles, of modes (weight, mean direction, concentration, shape, mean speed)."""
    rng, (weight, mean, concentration, shape, mean_speed) = np.random.default_rng(seed), np.asarray(truth).T
    mode = rng.choice(weight.size, size=n, p=weight)
    direction = wrap(rng.vonmises(mean[mode], concentration[mode]))
    return direction, rng.standard_gamma(shape[mode]) * mean_speed[mode] / shape[mode]


def ring_traffic(rng, *, n_vehicles=40, radius=20.0, speed=8.0, n_rows=100, dt_s=0.1):
    """Vehicles that drive counter-clockwise around the origin, at speeds and radii of their own."""
    start = rng.uniform(0, 2 * np.pi, n_vehicles)
    pace = speed * rng.gamma(50.0, 1 / 50.0, n_vehicles)
    r = radius + rng.normal(0, 0.7, n_vehicles)
    t = np.arange(n_rows) * dt_s
    angle = start[:, None] + pace[:, None] / r[:, None] * t
    position = np.stack([r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)], axis=-1)
    time_ns = (t * 1e9).round().astype(np.int64)
    return tracks_of(position, time_ns=time_ns, direction=wrap(angle + np.pi / 2), speed=pace[:, None])


def on_the_ring(time_s, *, from_=0.0):
    """Where a vehicle is that drives around it at 8 m/s from an angle on."""
    angle = from_ + 0.4 * time_s
    return 20.0 * np.array([np.cos(angle), np.sin(angle)])


def rows_of(direction, speed, *, position=(0.0, 0.0), time_ns=0, first_id=0):
    """Tracks of one row for each vehicle, all at one time."""
    track_id, place = first_id + np.arange(len(direction)), np.broadcast_to(position, (1, len(direction), 2))
    return tracks_of(place, track_id=track_id, time_ns=time_ns, direction=direction, speed=speed)


def one_cell(direction, speed, *, weight=None, n_vehicles, position=None):
    """Rows of one cell around the origin, as the fit takes them."""
    n, none = speed.size, np.zeros(1)
    weight, place = np.ones(n) if weight is None else weight, np.zeros((n, 2)) if position is None else position
    columns = np.stack([np.cos(direction), np.sin(direction), speed, np.log(speed), weight, *place.T])
    return CellRows(columns, np.array([0, n]), np.array([float(n_vehicles)]), none, none)


def one_cell_map(*, mean=0.0, concentration=1e6, speed=10.0, shape=1e8, side=1e4, bend=(0.0, 0.0), gain=(0.0, 0.0)):
    """One cell around the origin, in which vehicles drive one way at one speed; outside they do the same, unbent."""
    column, slope = np.ones((2, 1)), {"bend": np.zeros((2, 1, 2)), "gain": np.zeros((2, 1, 2))}
    slope["bend"][0], slope["gain"][0] = bend, gain
    return PrimitiveMap(
        tessellation=GridTessellation(
            origin=np.full(2, -side / 2), cell_size=side, n_x=1, n_y=1, square=np.zeros(1, np.int64)
        ),
        modes=Modes.flat(
            column, mean * column, concentration * column, shape * column, shape / speed * column
        )._replace(**slope),
        n_rows=np.array([1, 1]),
        n_background_modes=0,
    )


def junction_traffic(rng, *, n_vehicles=60, dt_s=0.1, n_rows=90):
    """Vehicles that come from the west at about 10 m/s; in a junction 40 m on a third each turns left or right.

    Who turns brakes to 5 m/s before it, and drives a quarter of a circle of 10 m radius.
    """
    parts = []
    for i in range(n_vehicles):
        turn = (0.0, 1.0, -1.0)[i % 3]
        pace, late = rng.normal(1.0, 0.05), rng.uniform(0.0, 1.0)
        s, theta, place, rows = 0.0, 0.0, np.array([0.0, rng.normal(0, 0.4)]), []
        for _ in range(n_rows):
            slow = abs(turn) * np.exp(-(((s - 45.0) / 15.0) ** 2))
            speed = pace * (10.0 - 5.0 * slow)
            rows.append([*place, theta, speed])
            step = speed * dt_s
            bend = turn / 10.0 if 40.0 < s < 40.0 + 5.0 * np.pi else 0.0
            middle = theta + 0.5 * bend * step
            place = place + step * np.array([np.cos(middle), np.sin(middle)])
            s, theta = s + step, theta + bend * step
        x, y, direction, speed = np.array(rows).T
        time_ns = ((late + dt_s * np.arange(n_rows)) * 1e9).round().astype(np.int64)
        place = np.column_stack([x, y])
        parts.append(tracks_of([place], track_id=i, time_ns=time_ns, direction=direction, speed=speed))
    return Tracks.concatenate(parts)


def gaussian_belief(bayes, key, mean, covariance):
    """A particle filter of the same motion with one belief: a Gaussian of x, y and their rates."""
    rng = np.random.default_rng(key)
    drawn = rng.multivariate_normal(mean, covariance, bayes.n_particles, method="eigh").T
    course, still = np.arctan2(drawn[3], drawn[2]), np.zeros((2, bayes.n_particles))
    other = bayes.resumed(key, np.vstack([drawn, still[:1], np.cos(course), np.sin(course), still]))
    _kernels.initialise_motion(other._table, other.cloud, np.zeros(1, np.int64))
    return other
