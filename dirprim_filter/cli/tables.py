"""Results of experiments and scores as text: tables for a terminal, in Markdown and in LaTeX."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from dirprim_filter.cli.texts import UNKNOWN, columns, counted, number

if TYPE_CHECKING:
    from dirprim_filter.evaluation.cues import CueTable
    from dirprim_filter.evaluation.density import DensityTable
    from dirprim_filter.evaluation.forecasting import ForecastTable
    from dirprim_filter.evaluation.intervals import Interval
    from dirprim_filter.evaluation.scores import ScoreTable
    from dirprim_filter.evaluation.tracking import MethodResult, TrackingTable

FIGURES = {
    "rmse": "RMSE, m", "seen_rmse": "RMSE in sight, m", "hidden_rmse": "RMSE in gaps, m",
    "direction_rmse": "RMSE of course, rad", "speed_rmse": "RMSE of speed, m/s",
    "nees": "NEES", "seen_nees": "NEES in sight", "hidden_nees": "NEES in gaps",
    "coverage_90": "truth in 90 %", "hidden_coverage_90": "in 90 %, in gaps",
    "reported": "reported", "interpolated": "truth interpolated", "hota": "HOTA", "deta": "DetA", "assa": "AssA",
    "loca": "LocA", "idf1": "IDF1", "mota": "MOTA", "switches": "identity switches",
    "gospa": "GOSPA per vehicle, m",
    "localisation": "  localisation, m2", "missed": "  missed, m2", "false": "  false, m2",
}  # fmt: skip
"""The figures of a `TrackingReport`, and what tables call them."""
FORECAST_FIGURES = {
    "energy": "energy, m", "ade": "ADE, m", "fde": "FDE, m", "coverage_50": "in 50 %", "coverage_90": "in 90 %",
}  # fmt: skip
"""Those of a forecast's score."""
SAID = {"place-free": "the same model without the map", "one cell": "one cell for all places"}
"""What the conclusion calls methods."""
MAIN_FIGURES = {
    True: ("seen_rmse", "hidden_rmse", "seen_nees", "hidden_nees", "reported"),
    False: ("hota", "assa", "idf1", "switches", "gospa"),
}
"""With ids and without: those of `--markdown` and `--latex`."""
GAINS = {
    True: {"in_sight": "the first is nearer in sight, %", "in_gaps": "in gaps, %"},
    False: {"hota": "HOTA of the first more"},
}
"""And what the first method gains on the row's, beside them."""


def figure_lines(names: Sequence[str], cell: Callable[[int, str], str]) -> list[str]:
    """The lines of all figures; `cell`: of a column, by its number, and a figure."""
    return columns([["", *names], *([head, *(cell(i, of) for i in range(len(names)))] for of, head in FIGURES.items())])


def markdown(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows, the first of them heads, as a table of Markdown."""
    head, *others = [[cell.replace("\\", "\\\\").replace("|", "\\|") for cell in row] for row in rows]
    return [f"| {' | '.join(row)} |" for row in (head, ["---", *["---:"] * (len(head) - 1)], *others)]


LATEX = str.maketrans({
    **{sign: f"\\{sign}" for sign in "%_&#${}"}, "\\": r"\textbackslash{}", "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}", "±": r"$\pm$",
})  # fmt: skip
"""Signs that LaTeX takes for its own, and how they are typed."""


def latex(rows: Sequence[Sequence[str]]) -> list[str]:
    """The same as a tabular of LaTeX, which needs no package."""
    head, *others = [" & ".join(cell.translate(LATEX) for cell in row) + r" \\" for row in rows]
    begin, end = rf"\begin{{tabular}}{{l{'r' * (len(rows[0]) - 1)}}}", r"\end{tabular}"
    return [begin, r"\hline", head, r"\hline", *others, r"\hline", end]


def density_text(table: DensityTable) -> str:
    """Table I as text, a block for each quantity, and what follows from it."""
    from dirprim_filter.evaluation.density import clusters, conclusion

    blocks = {"direction, per rad": "direction", "speed, per m/s": "speed", "direction and speed": "joint"}
    lines = [
        f"{counted(table.n_held_out, 'row')} held out of {table.n_rows}, {counted(table.n_vehicles, 'vehicle')}, "
        f"by {table.split_by}, {counted(table.n_folds, 'fold')}; 95 % intervals over {clusters(table)}"
    ]
    for title, quantity in blocks.items():
        rows = [[title, "mean log density, nat", "behind the first by", "mean density"]]
        for row in table.methods:
            if (score := getattr(row, quantity)) is not None:
                behind = "" if row is table.methods[0] else interval_text(score.behind)
                rows.append([row.name, interval_text(score.mean_log), behind, f"{score.mean:.3f}"])
        lines += ["", *columns(rows)]
    rivals = [row for row in table.methods if row.settings]
    lines += ["", "chosen by held-out training vehicles, fold by fold:"] if rivals else []
    for row in rivals:  # of all folds: the values chosen, and the range that was searched
        chosen = "; ".join(
            f"{of_folds[0].name} {', '.join(f'{choice.chosen:.3g}' for choice in of_folds)} "
            f"(of {min(choice.low for choice in of_folds):.3g} to {max(choice.high for choice in of_folds):.3g})"
            for of_folds in zip(*row.settings, strict=True)
        )
        lines.append(f"{row.name}: {chosen}")
    return "\n".join([*lines, "", conclusion(table)])


def interval_text(found: Interval) -> str:
    """A figure with its interval."""
    return f"{found.value:.3f} ({found.low:.3f} to {found.high:.3f})"


def cues_text(table: CueTable) -> str:
    """Table II as text."""
    rows = [
        ["", "mean log density, nat", "prior adds, nat", "adds to the prior, nat", "mean density"],
        ["prior", interval_text(table.prior.mean_log), "", "", f"{table.prior.mean:.3f}"],
    ]
    for name, score in (("cell before", table.cell_before), ("own course", table.own_course)):
        alone, both = score.observation, score.posterior
        gains = [interval_text(score.log_gain), interval_text(score.over_prior)]
        rows.append([name, interval_text(alone.mean_log), "", "", f"{alone.mean:.3f}"])
        rows.append([f"{name}, posterior", interval_text(both.mean_log), *gains, f"{both.mean:.3f}"])
    return "\n".join([
        f"{table.n_steps} steps from cell to cell, {counted(table.n_vehicles, 'vehicle')}, "
        f"held out by {table.split_by}, {counted(table.n_folds, 'fold')}",
        "", *columns(rows), "",
        "no figure is the paper's +54 %: that is of sums of densities, by an observation of unstated concentration",
    ])  # fmt: skip


def forecast_text(table: ForecastTable) -> str:
    """The table as text: a block for each method, a line for each horizon; then what the first gains."""
    lines = [
        f"{counted(table.n_vehicles, 'vehicle')} held out by {table.split_by}, {counted(table.n_folds, 'fold')}; "
        f"{counted(table.n_samples, 'rollout')} each"
    ]
    first, *others = table.methods
    for row in table.methods:
        rows = [[row.name, "cases", *FORECAST_FIGURES.values()]]
        for score in row.horizons:
            figures = [f"{getattr(score, name):.2f}".replace("nan", UNKNOWN) for name in FORECAST_FIGURES]
            rows.append([f"{score.horizon_s:g} s", str(score.n_cases), *figures])
        lines += ["", *columns(rows)]
    horizons = [score.horizon_s for score in first.horizons]
    n = first.horizons[0].gain.n_clusters
    lines += ["", f"Energy score of the {first.name}, with 95 % intervals over {counted(n, table.split_by)}:"]
    for i in sorted({min(range(len(horizons)), key=lambda h: abs(horizons[h] - at)) for at in (1.0, 5.0)}):
        heads = [f"  at {horizons[i]:g} s", *[""] * len(others)]
        for head, row in zip(heads, others, strict=False):
            lines.append(f"{head:<11}{_off_energy(row.horizons[i].gain, row.name)}")
    return "\n".join(lines)


def _off_energy(found: Interval, name: str) -> str:
    """What the first method takes off the energy of another, or adds to it."""
    percent, word = (100.0, "less") if found.value >= 0 else (-100.0, "more")
    chance = "" if found.is_apart else ": not distinguishable"
    of = SAID.get(name, name)
    return f"{percent * found.value:.1f} % ({found.ends('.1f', percent, ' %')}) {word} than {of}{chance}"


def tracking_text(table: TrackingTable) -> str:
    """The table as text: means over the seeds, then what the first method gains over each other."""
    from dirprim_filter.evaluation.tracking import comparisons

    experiment = table.experiment
    ids = "ids" if experiment.with_ids else "no ids"
    where = f"map learned from others, held out by {table.split_by}" if table.split_by else "map given"
    has_groups = table.n_groups > experiment.n_seeds
    groups = f" in {counted(table.n_groups, 'group')}, each by itself," if has_groups else ""
    lines = [
        f"{counted(table.n_vehicles, 'vehicle')}{groups} tracked in {counted(experiment.n_seeds, 'run')}, "
        f"{counted(table.n_gaps, 'gap')} of {experiment.gap_s:g} s, noise {experiment.noise_m:g} m, "
        f"{experiment.miss_rate:.0%} missed, {experiment.false_per_frame:g} false per frame, {ids}; {where}",
        *["means over the runs, +- deviations from run to run"] * (experiment.n_seeds > 1),
        "",
    ]
    names = [method.name for method in table.methods]
    lines += figure_lines(names, lambda i, figure: _cell(table.methods[i], figure, " +-"))
    lines += ["", *(found.sentence for found in comparisons(table) if found.sentence)]
    return "\n".join(lines).rstrip()


def _cell(method: MethodResult, figure: str, between: str) -> str:
    """The mean over the runs and, where there are several, their deviation."""
    spread = [method.std(figure)] if len(method.reports) > 1 else []
    return between.join(map(number, [method.mean(figure), *spread]))


def main_rows(table: TrackingTable) -> list[list[str]]:
    """The main figures, a row for each method under a row of heads, and what the first gains, with 95 % intervals."""
    from dirprim_filter.evaluation.tracking import comparisons

    figures, gains = MAIN_FIGURES[table.experiment.with_ids], GAINS[table.experiment.with_ids]
    beside = {found.other: found for found in comparisons(table)}
    rows = [["method", *(FIGURES[figure] for figure in figures), *gains.values()]]
    for method in table.methods:
        own = [_gain(getattr(beside.get(method.name), gain, None), gain) for gain in gains]
        rows.append([method.name, *(_cell(method, figure, " ± ") for figure in figures), *own])
    return rows


def _gain(found: Interval | None, gain: str) -> str:
    if found is None:
        return ""
    value, low, high = (f"{of:+.3f}" if gain == "hota" else f"{100 * of:.0f}" for of in found[:3])
    return f"{value} [{low}, {high}]"


def score_text(table: ScoreTable, truth: str) -> str:
    """A line for each figure, a column for each file."""
    matched = "vehicles by their ids" if table.with_ids else "vehicles by their places"
    groups = f" in {counted(table.n_groups, 'group')}, each by itself" if table.n_groups > 1 else ""
    names = [found.name for found in table.scores]
    judged = f"judged at the truth's {counted(table.n_instants, 'instant')}"
    apart = f"between rows of a vehicle at most {table.longest_gap_s:g} s apart"
    between = f"; {table.n_interpolated} of the truth's rows are interpolated, {apart}"
    judged += between if table.n_interpolated else ", row by row"
    return "\n".join([
        f"{truth}: {counted(table.n_vehicles, 'vehicle')}{groups}, {counted(table.n_rows, 'row')}; errors of "
        f"{matched}; similarity is 0 from {table.similarity_m:g} m, GOSPA's cut-off",
        judged, "", *figure_lines(names, lambda i, figure: number(getattr(table.scores[i].report, figure))), "",
        *(
            f"{found.name}: {counted(found.n_tracks, 'track')}, {counted(found.n_rows, 'row')} at "
            f"{counted(found.n_instants, 'instant')}, {found.n_interpolated} of them interpolated"
            for found in table.scores
        ),
    ])  # fmt: skip
