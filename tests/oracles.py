"""Slow and obvious twins of what the package computes fast."""

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from scipy import linalg, sparse, stats
from scipy.interpolate import CubicHermiteSpline
from scipy.special import logsumexp

from dirprim_filter.primitives.motion import COURSE_RATE


def circular_distance(a, b):
    """Absolute turn between angles, by the cosine."""
    return np.arccos(np.clip(np.cos(np.asarray(a) - np.asarray(b)), -1.0, 1.0))


def von_mises_mixture_density(direction, weight, mean, concentration):
    """Eq. 1 term by term, by scipy."""
    return sum(w * stats.vonmises.pdf(direction, k, loc=m) for w, m, k in zip(weight, mean, concentration, strict=True))


def sample_by_rejection(log_target, proposal, *, log_envelope, n, rng):
    """The paper's sampler of Eq. 4: those of n proposals that stand under the target, which k proposal covers."""
    theta, _ = proposal.sample(n_samples=n, rng=rng)
    log_ratio = log_target(theta) - log_envelope - proposal.log_density(theta)
    assert (log_ratio <= 1e-9).all()
    return theta[np.log(rng.random(n)) < log_ratio]


def kuiper_p_value(uniform):
    """Kuiper's test (1960) that numbers are even on a circle of length one, wherever it is cut; Stephens (1970)."""
    u, n = np.sort(np.mod(uniform, 1.0)), len(uniform)
    statistic = (np.arange(1, n + 1) / n - u).max() + (u - np.arange(n) / n).max()
    x = (np.sqrt(n) + 0.155 + 0.24 / np.sqrt(n)) * statistic
    j = np.arange(1, 100)
    return float(np.clip(2 * ((4 * (j * x) ** 2 - 1) * np.exp(-2 * (j * x) ** 2)).sum(), 0.0, 1.0)) if x > 0.4 else 1.0


def map_log_densities(learned, position, direction, speed):
    """Log densities of direction, of speed and of both: every mode of `primitive_at`, by numpy and scipy."""
    own = learned.primitive_at(position)
    with np.errstate(divide="ignore"):
        log_weight = np.log(own.direction.weight)
    of_direction = own.direction.mode_log_density(direction) - log_weight.clip(min=-1e300)
    of_speed = own.speed.log_density(np.asarray(speed, dtype=float)[..., None])
    return tuple(logsumexp(log_weight + part, axis=-1) for part in (of_direction, of_speed, of_direction + of_speed))


def pieces(track_id, time_ns, max_gap_s):
    """Rows of each vehicle in order of time, cut where a gap is longer."""
    for vehicle in set(track_id.tolist()):
        rows = np.array(sorted(np.flatnonzero(track_id == vehicle), key=lambda j: time_ns[j]))
        yield from np.split(rows, 1 + np.flatnonzero(np.diff(time_ns[rows]) > max_gap_s * 1e9))


def central_differences(track_id, time_ns, position, *, half_window_s, max_gap_s):
    """Central differences row by row, as the definition says it: (n, 2) metres and (n,) seconds."""
    moved, span_s = np.zeros((len(time_ns), 2)), np.zeros(len(time_ns))
    for rows in pieces(track_id, time_ns, max_gap_s):
        for at, i in enumerate(rows):
            near = np.flatnonzero(np.abs(time_ns[rows] - time_ns[i]) <= half_window_s * 1e9)
            low, high = rows[min(near[0], max(at - 1, 0))], rows[max(near[-1], min(at + 1, len(rows) - 1))]
            span_s[i], moved[i] = (time_ns[high] - time_ns[low]) * 1e-9, position[high] - position[low]
    return moved, span_s


def between_rows(time_s, position, direction, speed, at_s):
    """Where a vehicle is between its rows, its course and its speed: by scipy's splines."""
    velocity = speed[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    course = np.interp(at_s, time_s, np.unwrap(direction))
    return CubicHermiteSpline(time_s, position, velocity)(at_s), course, np.interp(at_s, time_s, speed)


def nearest_moving(track_id, time_ns, moves, *, max_gap_s):
    """(n,) the row nearest in time that moves, of the same vehicle and with no longer gap between; -1 where none is."""
    nearest = np.full(len(time_ns), -1)
    for rows in pieces(track_id, time_ns, max_gap_s):
        for i in rows:
            nearest[i] = min(rows[moves[rows]], key=lambda j, i=i: abs(time_ns[j] - time_ns[i]), default=-1)
    return nearest


def noise_of_neighbours(track_id, time_ns, position, moves, *, max_span_s):
    """The robust spread of what no parabola explains in four neighbours' positions: by the null space of parabolas."""
    off = []
    for rows in pieces(track_id, time_ns, np.inf):
        for four in np.lib.stride_tricks.sliding_window_view(rows, 4) if len(rows) > 3 else ():
            t = (time_ns[four] - time_ns[four[0]]) * 1e-9
            if t[-1] <= max_span_s and moves[four[1]]:
                off += (linalg.null_space(np.vander(t / t[-1], 3).T)[:, 0] @ position[four]).tolist()
    return np.median(np.abs(off)) / stats.norm.ppf(0.75) if off else 0.0


def filterpy_constant_velocity(place, time_s, *, density, noise_m, first_speed_std):
    """filterpy's filter and smoother of constant velocity, each as means (n, 4) and covariances (n, 4, 4).

    Begins at the first place; rows whose place is NaN are not measured.
    """
    kalman, steps_s = KalmanFilter(dim_x=4, dim_z=2), np.diff(time_s)
    kalman.H, kalman.R = np.eye(2, 4), noise_m**2 * np.eye(2)
    kalman.x, kalman.P = np.append(place[0], [0.0, 0.0]), np.diag(2 * [noise_m**2] + 2 * [first_speed_std**2])
    moves = [np.eye(4) + h * np.eye(4, k=2) for h in steps_s]
    added = [np.kron(Q_continuous_white_noise(2, h, density), np.eye(2)) for h in steps_s]
    seen, first = [None if np.isnan(z).any() else z for z in place[1:]], (kalman.x, kalman.P)
    later = kalman.batch_filter(seen, Fs=moves, Qs=added)[:2]
    filtered = tuple(np.concatenate([[start], of]) for start, of in zip(first, later, strict=True))
    return filtered, kalman.rts_smoother(*filtered, [np.eye(4), *moves], [np.eye(4), *added])[:2]


def forward_backward(first, fits, ahead, back):
    """Filtered and smoothed beliefs over bins: by a prior, likelihoods, the transition and its transpose."""
    filtered, smoothed, later = [], [], np.ones_like(first)
    for k, fits_now in enumerate(fits):
        belief = (ahead(filtered[-1]) if k else first) * fits_now
        filtered.append(belief / belief.sum())
    for belief, fits_now in zip(filtered[::-1], fits[::-1], strict=True):
        smoothed.append(belief * later / (belief * later).sum())
        later = back(later * fits_now)
        later /= later.max()
    return filtered, smoothed[::-1]


def split_between_bins(arc, speed):
    """Sparse moves of mass to (n, m, k) places in bins, split between the two nearest of either axis; arcs close."""
    n, m, n_pushes = arc.shape
    i, j = np.floor(arc).astype(np.int64), np.floor(speed.clip(0, m - 1.001)).astype(np.int64)
    f, g = arc - i, speed.clip(0, m - 1.001) - j
    corners = [(0, 0, (1 - f) * (1 - g)), (0, 1, (1 - f) * g), (1, 0, f * (1 - g)), (1, 1, f * g)]
    to = [(((i + a) % n * m + j + b) * n_pushes + np.arange(n_pushes)).ravel() for a, b, _ in corners]
    share = np.concatenate([part.ravel() for _, _, part in corners])
    return sparse.csr_array((share, (np.concatenate(to), np.tile(np.arange(arc.size), 4))), shape=(arc.size, arc.size))


def ring_forward_backward(
    seen, dt_s, *, radius, acceleration, push, push_rate, first_speed, noise_m, bin_m, speeds, steps=5, coins=4
):
    """A histogram Bayes filter and forward-backward of a vehicle on a ring road, over arc, speed and push.

    The push, an Ornstein-Uhlenbeck process, is that of fair coins which are turned: half before, half after the vehicle
    moves. Mass that lands between two bins is split, on average a drift of bin_m^2 / (6 dt_s) m^2/s.

    Args:
        seen: (n, 2) measured positions, NaN where there is none.
        dt_s: seconds from one to the next.
        radius: metres, of the ring around the origin, driven counter-clockwise.
        acceleration: m/s^2, of arc and speed.
        push: m/s^2, its standard deviation.
        push_rate: 1/s.
        first_speed: prior density.
        noise_m: metres, of a measured position in each axis.
        bin_m: metres, about the size of a bin.
        speeds: (m,) m/s, evenly spaced.
        steps: of dt_s, in which the law is integrated.
        coins: so many.

    Returns:
        Filtered and smoothed (n, 4): mean angle and standard deviation of the arc, mean and deviation of the speed.
    """
    n, heads = round(2 * np.pi * radius / bin_m), np.arange(coins + 1)
    angle = 2 * np.pi / n * np.arange(n)
    arc, v, a = np.meshgrid(radius * angle, speeds, push * (2 * heads - coins) / np.sqrt(coins), indexing="ij")
    shape, h = arc.shape, dt_s / steps
    for _ in range(steps):
        later = v + h * (acceleration(arc, v) + a)
        arc, v = arc + h * (v + later) / 2, later
    moves = split_between_bins(arc / (radius * angle[1]), (v - speeds[0]) / (speeds[1] - speeds[0]))
    turned = (1 - np.exp(-push_rate * dt_s / 2)) / 2
    kept, new = ([stats.binom.pmf(np.arange(k + 1), k, p) for k in heads] for p in (1 - turned, turned))
    turns = np.array([np.convolve(kept[k], new[coins - k]) for k in heads])
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    off = ((seen[:, None] - ring) ** 2).sum(axis=2) / noise_m**2
    beliefs = forward_backward(
        np.ones(shape) * first_speed(speeds)[:, None] * stats.binom.pmf(heads, coins, 0.5),
        np.nan_to_num(np.exp(-0.5 * off), nan=1.0)[..., None, None],
        lambda belief: (moves @ (belief @ turns).ravel()).reshape(shape) @ turns,
        lambda later: (moves.T @ (later @ turns.T).ravel()).reshape(shape) @ turns.T,
    )
    return [on_average(np.array(of), angle, radius, speeds) for of in beliefs]


def on_average(belief, angle, radius, speeds):
    """(k, 4) mean angle and standard deviation of the arc, mean and deviation of the speed, of (k, n, m, pushes)."""
    of_angle, of_speed = belief.sum(axis=(2, 3)), belief.sum(axis=(1, 3))
    mean = np.angle(of_angle @ np.exp(1j * angle))
    away = np.angle(np.exp(1j * (angle - mean[:, None])))
    arc_std, mean_speed = radius * np.sqrt((of_angle * away**2).sum(axis=1)), of_speed @ speeds
    return np.column_stack([mean, arc_std, mean_speed, np.sqrt(of_speed @ speeds**2 - mean_speed**2)])


def fit(motion, z, center, extent, place, direction, speed):  # noqa: PLR0917
    """How well a vehicle fits manoeuvre z: Student's t of three numbers, 5 degrees of freedom, by e^-2."""
    offset = np.clip(np.asarray(place) - center, -extent, extent)
    off_course = np.angle(np.exp(1j * (direction - motion.course[z] - motion.bend[z] @ offset)))
    off_pace = np.log(speed + 0.3) - motion.log_pace[z] - motion.gain[z] @ offset
    c, s = np.cos(motion.path_direction[z]), np.sin(motion.path_direction[z])
    u, across = np.array([[c, s], [-s, c]]) @ offset
    off_path = across - np.polyval(motion.path[z][::-1], u)
    spread = np.array([motion.course_spread[z] + 0.02, motion.log_pace_spread[z] + 0.03, motion.path_spread[z] + 0.1])
    sigmas = np.array([min(speed, 1.0) * off_course, off_pace, off_path]) / spread
    # Without the constant that all manoeuvres share: of the density at 0 of a t of three standard numbers.
    t = stats.multivariate_t(shape=np.eye(3), df=5)
    slowed = 1.0 if speed < 0.1 else min(speed, 1.0)  # who stands has no course to fit
    return slowed * t.pdf(sigmas) / t.pdf(np.zeros(3)) / spread.prod() / np.exp(-2.0)


def manoeuvre_weights(motion, cell, center, extent, place, direction, speed, *, by_time):  # noqa: PLR0917
    """Of each of a cell's manoeuvres: how often it is driven times how well it fits, against no place at all."""
    amount = motion.seconds if by_time else motion.visits
    return np.array([
        amount[z] * fit(motion, z, center, extent, place, direction, speed)
        * ((motion.start_rate[z] > 0) == (speed < 0.1))
        for z in np.flatnonzero(motion.cell == cell)
    ])  # fmt: skip


def moved_without_noise(motion, z, center, extent, place, direction, speed, push, h):  # noqa: PLR0917
    """Place, direction, speed and push after one short step of manoeuvre z that nothing disturbs."""
    offset = np.clip(np.asarray(place) - center, -extent, extent)
    gained = motion.acceleration[z] @ [1.0, *offset, speed] + motion.push[z] * push
    later = max(speed + h * gained, 0.0)
    way = h * (speed + later) / 2 * (1 + motion.stretch[z])
    heading = np.array([np.cos(direction), np.sin(direction)])
    turn = (motion.bend[z] @ heading + motion.curvature[z]) * way
    if motion.cell[z] >= 0 and motion.start_rate[z] == 0:
        off = np.angle(np.exp(1j * (direction - motion.course[z] - motion.bend[z] @ offset)))
        turn -= (1 - np.exp(-COURSE_RATE * h)) * off
    left = np.array([-heading[1], heading[0]])
    place = place + way * ((1 - turn**2 / 8) * heading + turn / 2 * left)  # to the middle direction, to second order
    return place, np.angle(np.exp(1j * (direction + turn))), later, push * np.exp(-0.5 * h)


def dp_means(feature, order, opens_at, most):
    """DP-means by its definition: every mean anew from its members, whenever a visit is looked at."""
    label, n_groups = np.full(len(feature), -1), 0
    for number in range(8):
        before = label.copy()
        for i in order:
            distance = np.full(n_groups, np.inf)
            for k in range(n_groups):
                members = feature[label == k]
                known = ~np.isnan(members).all(axis=0) if len(members) else np.zeros(feature.shape[1], bool)
                both = known & ~np.isnan(feature[i])
                if both.any():
                    distance[k] = np.mean((feature[i, both] - np.nanmean(members[:, both], axis=0)) ** 2)
            near = distance.min(initial=np.inf)
            alone = not np.isfinite(near) or (near > opens_at and number < 2)
            if alone and n_groups < most:
                label[i], n_groups = n_groups, n_groups + 1
            else:
                label[i] = distance.argmin() if np.isfinite(near) else 0
        if (label == before).all():
            break
    return label


def leader_of(i, others, curvature):
    """Gap, speed along the course and row of the nearest vehicle ahead on an arc, by looking at one after the other."""
    x, y, course, _ = others[i]
    nearest = (np.inf, 0.0, -1)
    for j, (east, north, heading, speed) in enumerate(others):
        turned = np.exp(-1j * course) * complex(east - x, north - y)
        ahead, left = turned.real, turned.imag
        same = np.cos(heading - course - curvature * ahead)
        on_arc = abs(left - curvature * ahead**2 / 2) <= 1.75
        if j != i and 0.5 <= ahead < min(60.0, nearest[0]) and on_arc and same > 0.5:
            nearest = (ahead, same * speed, j)
    return nearest


def leader_features(speed, gap, leader):
    """What a driver goes by behind a leader."""
    free = max(gap - 7.0, 0.0)
    safe = -0.75 + np.sqrt(0.75**2 + leader**2 + 2 * 0.75 * free)
    room, closing = np.clip(safe - speed, -12, 12), np.clip(leader - speed, -12, 12)
    reported = [1, room, max(room, 0), max(room - 4, 0), speed, closing, room * speed, closing * speed, speed**2]
    return np.array([*reported, min(free, 40.0)])
