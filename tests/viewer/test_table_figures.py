"""Tables as charts: each method is there with its number, and one that is hopeless does not flatten the others."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.container import BarContainer

from dirprim_filter.evaluation.cues import CueTable, ObservationScore, StepScore
from dirprim_filter.evaluation.density import DensityScore, DensityTable, MethodScore
from dirprim_filter.evaluation.intervals import Interval
from dirprim_filter.viewer.charts import tracking_chart
from dirprim_filter.viewer.figures import cue_table_figure, density_table_figure


def score(mean: float, mean_log: float) -> DensityScore:
    around = Interval(mean_log, mean_log - 0.05, mean_log + 0.05, 20)
    return DensityScore(mean_log=around, mean=mean, behind=Interval(0.0, 0.0, 0.0, 20))


@pytest.fixture
def table() -> DensityTable:
    ours = MethodScore(
        name="primitive, flat", direction=score(7.0, 1.4), speed=score(0.1, -2.6), joint=score(0.8, -1.2), settings=()
    )
    grid = MethodScore(name="DGM", direction=score(7.1, -27.0), speed=None, joint=None, settings=())
    return DensityTable(
        methods=(ours, grid), split_by="vehicle", n_folds=5, n_rows=1000, n_vehicles=20, n_held_out=1000
    )


def test_every_method_is_named_and_its_numbers_stand_at_their_place(table: DensityTable) -> None:
    figure = density_table_figure(table)
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["primitive, flat", "DGM"]
    log_direction, _, log_joint, direction, speed, joint = figure.axes  # log densities lead
    assert [text.get_text() for text in direction.texts] == ["7.00", "7.10"]
    assert [text.get_text() for text in speed.texts] == ["0.1"]  # a method without speeds has none
    assert [text.get_text() for text in log_joint.texts] == ["-1.20"]
    assert direction.get_ylim()[0] > direction.get_ylim()[1]  # first on top, as in the table
    assert all("[" in axes.get_xlabel() for axes in figure.axes)
    assert joint.get_xlim()[0] <= 0.0
    assert "-27.00" in [text.get_text() for text in log_direction.texts]
    assert log_direction.get_xlim()[0] > -5.0


def test_whiskers_are_intervals_and_without_one_there_is_a_dot(table: DensityTable) -> None:
    figure = density_table_figure(table)
    (whisker,) = figure.axes[2].collections
    np.testing.assert_allclose(whisker.get_segments()[0][:, 0], [-1.25, -1.15])
    alone = replace(table.methods[0].direction, mean_log=Interval(1.4, float("nan"), float("nan"), 1))
    figure = density_table_figure(replace(table, n_folds=1, methods=(replace(table.methods[0], direction=alone),)))
    figure.draw_without_rendering()
    assert "in 1 fold;" in figure.get_suptitle()


def test_cue_bars_are_mean_log_densities_with_what_the_prior_adds() -> None:
    def of(value: float) -> Interval:
        return Interval(value, value - 0.1, value + 0.1, 9)

    seen = ObservationScore(
        concentration=9.0, log_gain=of(0.4), over_prior=of(0.2), observation=StepScore(of(1.0), 3.0),
        posterior=StepScore(of(1.4), 5.0),
    )  # fmt: skip
    table = CueTable(
        prior=StepScore(of(1.2), 4.0), cell_before=seen, own_course=seen, n_steps=50, n_vehicles=9,
        split_by="vehicle", n_folds=5,
    )  # fmt: skip
    panel = cue_table_figure(table).axes[0]
    (bars,) = [c for c in panel.containers if isinstance(c, BarContainer)]
    np.testing.assert_allclose([bar.get_height() for bar in bars], [1.2, 1.0, 1.4])
    assert panel.get_ylabel() == "mean log density of the truth [nat]"
    assert "the prior adds +0.40 nat (0.30 to 0.50) a step" in panel.get_title(loc="left")


def test_a_chart_of_tracking_has_a_bar_for_each_figure_and_none_for_what_was_not_measured() -> None:
    """No gaps, so nothing in them: an empty bar without a number, and no warning."""
    reported = {"prior": 0.5, "place-free": 2.0}
    methods = [
        SimpleNamespace(
            name=name, mean=lambda figure, v=v: float("nan") if "hidden" in figure else v, std=lambda _: float("nan")
        )
        for name, v in reported.items()
    ]
    figure = tracking_chart(SimpleNamespace(methods=methods))
    figure.draw_without_rendering()
    rmse, *_, switches = figure.axes
    assert [text.get_text() for text in rmse.get_yticklabels()] == list(reported)
    widths = [bar.get_width() for bar in rmse.patches]
    assert widths[:4] == 2 * list(reported.values())  # of all, and of those in sight
    assert np.isnan(widths[4:]).all()
    assert {text.get_text() for text in rmse.texts} == {"0.50", "2.00", ""}
    assert all(text.get_path_effects() and text.get_zorder() > 3 for text in rmse.texts)  # legible over whiskers
    assert switches.get_xlim()[0] == 0.0
