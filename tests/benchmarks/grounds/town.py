"""Our own ground, beside those of others: the simulated roundabout, each held-out vehicle out of sight for 3 s."""

from __future__ import annotations

from dirprim_filter.config import FilterConfig
from dirprim_filter.evaluation.tracking import SMOOTHED_SUFFIX, compared, evaluate_tracking
from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment
from dirprim_filter.recording.tables import read_named
from grounds.findings import STRAIGHT, WITH, WITHOUT, Asked, Findings

NAMES = {"prior": WITH, "place-free": WITHOUT, STRAIGHT: STRAIGHT}


def of_town(asked: Asked) -> list[Findings]:
    """As `dirprim evaluate tracking` measures it, online and smoothed; intervals are over vehicles."""
    tracks = read_named(asked.data / "town03/roundabout.csv").tracks
    if asked.is_smoke:
        tracks = tracks[tracks.vehicle < 40]
    experiment = TrackingExperiment(
        learn=0.9, n_seeds=asked.n_seeds, smooth=True, methods=tuple(NAMES),
        filter=FilterConfig(n_particles=100 if asked.is_smoke else 1000),
    )  # fmt: skip
    table = evaluate_tracking(tracks, experiment)
    found = []
    for suffix in ("", SMOOTHED_SUFFIX):
        of = Findings(f"town, gaps of 3 s, {'smoothed' if suffix else 'online'}: {table.n_gaps} windows, RMSE")
        for method in table.methods:
            name = NAMES.get(method.name.removesuffix(suffix) if method.name.endswith(suffix) else "")
            if name is not None:
                of.rows[name] = {"error": method.mean("hidden_rmse"), "nees": method.mean("hidden_nees")}
        of.settings = [choice for fits in table.settings for choices in fits.values() for choice in choices]
        for name in list(NAMES)[1:]:
            if (gain := compared(table, "prior" + suffix, name + suffix).in_gaps) is not None:
                of.gains[f"{WITH} against {NAMES[name]}, less error"] = gain
        found.append(of)
    return found
