"""How a sensor errs: what was measured, and the model of it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dirprim_filter.arrays import FloatArray
from dirprim_filter.evaluation.calibration import Calibration
from dirprim_filter.evaluation.calibration.gauss_markov import autocorrelation
from dirprim_filter.sensor import AxisError
from dirprim_filter.viewer.figures.page import DOTS_PER_INCH

AXES = {"along": "#0072B2", "across": "#D55E00"}
MOST_POINTS = 4000
LAGS_S = np.arange(0.0, 3.01, 0.1)


def sensor_figure(measured: Calibration) -> Figure:
    """Errors over speed, their distribution, their correlation over time, and how often vehicles are reported."""
    figure = Figure(figsize=(13.0, 3.4), dpi=DOTS_PER_INCH, layout="constrained")
    over_speed, spread, correlation, rates = figure.subplots(1, 4)
    _draw_speed(over_speed, measured)
    for name, color in AXES.items():
        axis: AxisError = getattr(measured.sensor, name)
        _draw_spread(spread, name, getattr(measured.errors, name), axis, color)
        _draw_correlation(correlation, name, measured, axis, color)
    _draw_rates(rates, measured)
    for axes in (over_speed, spread, correlation, rates):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_speed(axes: Axes, measured: Calibration) -> None:
    """Errors as they stand to the speed, the latency put back: its slope."""
    errors, sensor = measured.errors, measured.sensor
    shown = slice(None, None, max(errors.speed.size // MOST_POINTS, 1))
    late = errors.along - sensor.latency_s * errors.speed
    axes.plot(errors.speed[shown], late[shown], ".", color=AXES["along"], markersize=2, alpha=0.4)
    ends = np.array([0.0, errors.speed.max()])
    axes.plot(
        ends, sensor.along.bias_m - sensor.latency_s * ends, color="black", linewidth=1.0,
        label=f"{sensor.along.bias_m:+.2f} m - {sensor.latency_s:.2f} s · speed",
    )  # fmt: skip
    axes.set(title="bias and latency", xlabel="speed, m/s", ylabel="error along the way, m")
    axes.legend(fontsize=7, frameon=False)


def _draw_spread(axes: Axes, name: str, error: FloatArray, axis: AxisError, color: str) -> None:
    """A histogram, and the model's Gaussian."""
    reach = np.linspace(float(np.quantile(error, 0.001)), float(np.quantile(error, 0.999)), 41)
    axes.hist(error, bins=reach.tolist(), density=True, color=color, alpha=0.4)
    density = np.exp(-0.5 * ((reach - axis.bias_m) / axis.spread_m) ** 2) / (axis.spread_m * np.sqrt(2.0 * np.pi))
    axes.plot(reach, density, color=color, linewidth=1.2, label=f"{name}: {axis.bias_m:+.2f} ± {axis.spread_m:.2f} m")
    axes.set(title="errors", xlabel="m", ylabel="density, 1/m")
    axes.legend(fontsize=7, frameon=False)


def _draw_correlation(axes: Axes, name: str, measured: Calibration, axis: AxisError, color: str) -> None:
    """Of errors some time apart, and the model's."""
    errors = measured.errors
    error = getattr(errors, name)
    correlation = autocorrelation(error - error.mean(), errors.time_s, errors.is_first, LAGS_S)
    axes.plot(LAGS_S, correlation, ".", color=color, markersize=4)
    after = np.linspace(1e-3, LAGS_S[-1], 100)
    label = (
        f"{name}: {axis.correlated_share:.0%}, {axis.correlation_s:.2g} s" if axis.correlated_share else f"{name}: 0"
    )
    model = axis.correlated_share * np.exp(-after / axis.correlation_s)
    axes.plot(after, model, color=color, linewidth=1.2, label=label)
    axes.set(title="correlation", xlabel="seconds apart", ylim=(-0.3, 1.05))
    axes.legend(fontsize=7, frameon=False)


def _draw_rates(axes: Axes, measured: Calibration) -> None:
    """Shares that are known, with their intervals."""
    sensor = measured.sensor
    known = {
        name: value for name in ("detection_probability", "outlier_share")
        if (value := sensor.numbers()[name]) is not None
    }  # fmt: skip
    widths = [sensor.uncertainty.get(name, 0.0) for name in known]
    axes.barh(list(known), list(known.values()), xerr=widths, color="#999999", height=0.4)
    axes.set_yticks(range(len(known)), [name.replace("_", "\n") for name in known])
    false = sensor.clutter_density
    axes.set(
        title="reports",
        xlim=(0.0, 1.05),
        xlabel="false ones " + ("not known" if false is None else f"{false:.2g} per m² and frame"),
    )
