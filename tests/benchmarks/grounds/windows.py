"""Windows without measurements, cut into vehicles' tracks: who knows where the vehicle was?

A method gives a mean, a covariance or samples at the hidden instants. One that is silent there is charged as if it had
answered with the last place that was measured. Errors are means over windows, intervals over clusters of them.

Source: Rauch, Tung and Striebel, Maximum likelihood estimates of linear dynamic systems, 1965; Gneiting and Raftery,
Strictly proper scoring rules, 2007 (the energy score).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter import PrimitiveMap
from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.evaluation.intervals import mean_over, paired, reduction_of_mean
from dirprim_filter.evaluation.settings import Axis, Choice, choose
from dirprim_filter.evaluation.tracking_report import coverage, normalised_squared
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker
from dirprim_filter.filtering.smoother import Smoother
from grounds.findings import STRAIGHT, WITH, Findings

N_SAMPLES = 100
GAIN = 0.002
"""Of the log of the energy score: what a rival's setting must gain to be taken."""


class Window(NamedTuple):
    """A vehicle's measurements without those of a gap, and where it was in it.

    Attributes:
        cluster: what intervals are over.
        time_s: (k,) ascending, times of its measurements.
        place: (k, 2) metres.
        hidden_s: (h,) instants in the gap.
        truth: (h, 2) metres.
    """

    cluster: str
    time_s: FloatArray
    place: FloatArray
    hidden_s: FloatArray
    truth: FloatArray

    @property
    def last_seen(self) -> int:
        """The row of the last measurement before the gap."""
        return int(np.searchsorted(self.time_s, self.hidden_s[0])) - 1


class Answer(NamedTuple):
    """What a method says of the hidden instants of all windows, one after the other; NaN where it is silent.

    Attributes:
        mean: (n, 2) metres.
        covariance: (n, 2, 2) square metres; NaN of a line, which states none.
        sample: (n, S, 2).
    """

    mean: FloatArray
    covariance: FloatArray
    sample: FloatArray

    @classmethod
    def gaussian(cls, mean: FloatArray, covariance: FloatArray) -> Answer:
        """Of means and covariances; the samples are the same draws for all."""
        draws = np.random.default_rng(0).standard_normal((N_SAMPLES, 2))
        root = np.linalg.cholesky(np.where(np.isnan(covariance), np.eye(2), covariance) + 1e-9 * np.eye(2))
        return cls(mean, covariance, mean[:, None] + np.einsum("nij,sj->nsi", root, draws))


class Marks(NamedTuple):
    """(n,) of hidden instants: metres off, energy score, squared error in units of the covariance, whether answered."""

    error: FloatArray
    energy: FloatArray
    normalised: FloatArray
    is_answered: BoolArray


def marks(windows: Sequence[Window], answer: Answer) -> Marks:
    """Of an answer beside the truth."""
    truth = np.concatenate([of.truth for of in windows])
    last = np.concatenate([np.tile(of.place[of.last_seen], (of.hidden_s.size, 1)) for of in windows])
    known = np.isfinite(answer.mean).all(axis=1)
    error = np.hypot(*(np.where(known[:, None], answer.mean, last) - truth).T)
    off, half = np.hypot(*np.moveaxis(answer.sample - truth[:, None], -1, 0)), answer.sample.shape[1] // 2
    apart = np.hypot(*np.moveaxis(answer.sample[:, :half] - answer.sample[:, half : 2 * half], -1, 0))
    energy = np.where(known, off.mean(axis=1) - 0.5 * apart.mean(axis=1), error)
    is_stated = known & np.isfinite(answer.covariance).all(axis=(1, 2))
    normalised = np.full(known.size, np.nan)
    normalised[is_stated] = normalised_squared((answer.mean - truth)[is_stated], answer.covariance[is_stated])
    return Marks(error, energy, normalised, known)


def straight(windows: Sequence[Window]) -> Answer:
    """The line between the measurements at both ends."""
    parts = [
        np.column_stack([np.interp(of.hidden_s, of.time_s, of.place[:, axis]) for axis in (0, 1)]) for of in windows
    ]
    mean = np.concatenate(parts)
    return Answer(mean, np.full((len(mean), 2, 2), np.nan), np.repeat(mean[:, None], 2, axis=1))


def textbook(windows: Sequence[Window], density: float, noise_m: float, *, smooth: bool) -> Answer:
    """Constant velocity with white acceleration, m^2/s^3 an axis: Kalman's filter, or Rauch-Tung-Striebel's smoother.

    All windows at once; a short one is padded with rows at the time of its last.
    """
    time, place = _rows(windows)
    slot, dt = np.arange(len(windows)), np.diff(time, axis=1)
    config = FilterConfig(noise_m=noise_m, outlier_probability=0.0)
    model = ConstantVelocityKalman(acceleration_density=density, config=config)
    model.reserve(slot.size)
    model.begin(slot, slot, _measured(place[:, 0]))
    found, expected = [(model.mean.copy(), model.covariance.copy())], []
    for i in range(dt.shape[1]):
        model.predict(slot, dt[:, i])
        expected.append((model.mean.copy(), model.covariance.copy()))
        if (seen := np.flatnonzero(np.isfinite(place[:, i + 1, 0]))).size:
            model.weigh(seen, _measured(place[seen, i + 1]))
        found.append((model.mean.copy(), model.covariance.copy()))
    for i in range(dt.shape[1] - 1, -1, -1) if smooth else ():
        (mean, spread), (ahead, later) = found[i], expected[i]
        back = np.linalg.solve(later, model.transition(dt[:, i]) @ spread).swapaxes(1, 2)
        found[i] = (
            mean + (back @ (found[i + 1][0] - ahead)[..., None])[..., 0],
            spread + back @ (found[i + 1][1] - later) @ back.swapaxes(1, 2),
        )
    means, spreads = (np.stack(column, axis=1) for column in zip(*found, strict=True))
    hidden = [np.searchsorted(row, of.hidden_s) for row, of in zip(time, windows, strict=True)]
    at = np.repeat(slot, [rows.size for rows in hidden]), np.concatenate(hidden)
    return Answer.gaussian(means[at][:, :2], spreads[at][:, :2, :2])


def _measured(place: FloatArray) -> Detections:
    return Detections(track_id=np.full(len(place), ""), time_ns=np.zeros(len(place), np.int64), position=place)


def _rows(windows: Sequence[Window]) -> tuple[FloatArray, FloatArray]:
    """(w, k) times and (w, k, 2) places, NaN where nothing is measured."""
    longest = max(of.time_s.size + of.hidden_s.size for of in windows)
    time, place = np.empty((len(windows), longest)), np.full((len(windows), longest, 2), np.nan)
    for i, of in enumerate(windows):
        own = np.sort(np.concatenate([of.time_s, of.hidden_s]))
        time[i] = np.append(own, np.full(longest - own.size, own[-1]))
        place[i, np.searchsorted(own, of.time_s)] = of.place
    return time, place


def fitted(windows: Sequence[Window], *, smooth: bool, density: float, noise_m: float) -> tuple[Choice, ...]:
    """Acceleration density and noise of the least energy score on training windows."""

    def score(values: tuple[float, ...]) -> float:
        return -float(np.log(marks(windows, textbook(windows, *values, smooth=smooth)).energy.mean()))

    name = "smoothed" if smooth else "online"
    return choose([Axis(f"{name} density", density), Axis(f"{name} noise_m", noise_m)], score, least_gain=GAIN)


def ours(
    windows: Sequence[Window], model: PrimitiveMap, config: FilterConfig, *, seed: int, **options: Any
) -> tuple[Answer, Answer]:
    """The particle filter's answers online, with its particles, and those of its smoother; options of a tracker."""
    found = []
    for i, of in enumerate(windows):
        rng = np.random.default_rng([seed, i])
        smoother = Smoother()
        found.append(_one(of, smoother, smoother.tracker(0, model, config=config, rng=rng, **options), rng))
    online, later = zip(*found, strict=True)
    means, spreads, samples = (np.concatenate(column) for column in zip(*online, strict=True))
    smoothed = Answer.gaussian(*(np.concatenate(column) for column in zip(*later, strict=True)))
    return Answer(means, spreads, samples), smoothed


def _one(
    window: Window, smoother: Smoother, tracker: Tracker, rng: np.random.Generator
) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """Mean, covariance and samples online; mean and covariance smoothed."""
    asked = {time_ns: i for i, time_ns in enumerate(_nanoseconds(window.hidden_s).tolist())}
    online, later = (
        tuple(np.full((len(asked), *shape), np.nan) for shape in ((2,), (2, 2), (N_SAMPLES, 2))) for _ in range(2)
    )

    def keep(frame: TrackedFrame, into: tuple[FloatArray, ...]) -> None:
        i = asked.get(frame.time_ns)
        if i is None or not len(frame.estimates):
            return
        into[0][i], into[1][i] = frame.estimates.position[0], frame.estimates.covariance[0]
        if len(frame.particles):
            cloud = frame.particles.thinned(1).of(0)
            into[2][i] = cloud.position[rng.choice(len(cloud), N_SAMPLES, p=cloud.weight / cloud.weight.sum())]

    smoother.sinks.append(lambda frame: keep(frame, later))
    time_ns = _nanoseconds(window.time_s)
    seen = Detections(track_id=np.full(time_ns.size, "vehicle"), time_ns=time_ns, position=window.place)
    frames = {int(frame.time_ns[0]): frame for frame in seen.frames()}
    with smoother:
        for instant in sorted({*frames, *asked}):
            at = frames.get(instant, Detections.none())
            frame = tracker.track(at, time_ns=instant, is_scan=bool(len(at)))
            smoother.write(frame)
            keep(frame, online)
    return online, later[:2]


def _nanoseconds(time_s: FloatArray) -> IntArray:
    return np.round(time_s * 1e9).astype(np.int64)


def judged(
    windows: Sequence[Window], training: Sequence[Window], by_map: Mapping[str, Callable[[int], tuple[Answer, Answer]]],
    *, about: str, n_seeds: int, density: float, noise_m: float, fair: Sequence[Window] | None = None,
) -> list[Findings]:  # fmt: skip
    """Online and smoothed, every method on the same windows.

    Args:
        windows: that are judged.
        training: that the rivals are fitted to.
        by_map: names of ours, and their answers online and smoothed by the seed.
        about: what is judged.
        n_seeds: of ours; the others have no chance in them.
        density: where the rivals' fit begins, m^2/s^3.
        noise_m: likewise.
        fair: the same windows as rivals see them, where a sensor's bias and latency are known. Left out: as they are.
    """
    runs = {name: [answer(seed) for seed in range(n_seeds)] for name, answer in by_map.items()}
    fair = windows if fair is None else fair
    tables = []
    for smooth, how in enumerate(("online", "smoothed")):
        choices = fitted(training, smooth=bool(smooth), density=density, noise_m=noise_m)
        found = {name: [marks(windows, run[smooth]) for run in of] for name, of in runs.items()}
        found[STRAIGHT] = [marks(windows, textbook(fair, *(of.chosen for of in choices), smooth=bool(smooth)))]
        if smooth:
            found["line between both ends"] = [marks(windows, straight(fair))]
        tables.append(_table(f"{about}, {how}", windows, found))
        tables[-1].settings += choices
    return tables


def _table(about: str, windows: Sequence[Window], found: Mapping[str, Sequence[Marks]]) -> Findings:
    """Each method's figures, means over its runs; and how much nearer the map is."""
    cluster = np.array([of.cluster for of in windows])
    row = np.repeat(np.arange(len(windows)), [of.hidden_s.size for of in windows])
    table = Findings(f"{about}: {len(windows)} windows, {np.unique(cluster).size} clusters")
    means = {}
    for name, of in found.items():
        error, energy, answered = (
            np.mean([np.bincount(row, getattr(run, key)) / np.bincount(row) for run in of], axis=0)
            for key in ("error", "energy", "is_answered")
        )
        means[name] = error
        normalised = np.concatenate([run.normalised[np.isfinite(run.normalised)] for run in of])
        own = mean_over(cluster, error)
        table.rows[name] = {
            "error": own.value,
            "error +-": own.half_width,
            "energy": float(energy.mean()),
            "median error": float(np.median(error)),
            "answered": float(answered.mean()),
        } | ({"in 50 %": coverage(normalised, 0.5), "in 90 %": coverage(normalised, 0.9)} if len(normalised) else {})
    for name in [of for of in found if of != WITH]:
        table.gains[f"{WITH} against {name}, less error"] = paired(cluster, means[WITH], means[name], reduction_of_mean)
    return table
