"""Tracking experiments: what is hidden, what is held out, what a report says, and how to have it again."""

import json
from dataclasses import asdict, fields

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.evaluation.experiment import (
    MethodResult,
    TrackingExperiment,
    evaluate_tracking,
    gaps,
    held_out,
    honest_tracking,
)
from dirprim_filter.evaluation.scoring import TrackingReport
from dirprim_filter.simulation.sensor import detect
from situations import ring_traffic

QUICK = {
    "n_seeds": 2, "gap_s": 2.0, "methods": ("prior", "constant velocity", "interacting models"),
    "filter": FilterConfig(n_particles=100),
}  # fmt: skip


@pytest.fixture(scope="module")
def traffic():
    return ring_traffic(np.random.default_rng(8), n_vehicles=4, n_rows=80)


@pytest.fixture(scope="module")
def table(traffic, ring_map):
    return evaluate_tracking(traffic, TrackingExperiment(**QUICK), sensor=detect, primitive_map=ring_map)


def test_every_vehicle_is_hidden_once_for_the_gap_and_not_near_its_ends(traffic):
    hidden = gaps(traffic, gap_s=2.0, rng=np.random.default_rng(0))
    for name in np.unique(traffic.track_id):
        own = hidden[traffic.track_id == name]
        rows = np.flatnonzero(own)
        assert rows.size in (19, 20, 21)
        assert (np.diff(rows) == 1).all()
        assert rows[0] >= 20
        assert rows[-1] <= 60
    assert not gaps(traffic, gap_s=0.0, rng=np.random.default_rng(0)).any()
    assert not gaps(traffic, gap_s=5.0, rng=np.random.default_rng(0)).any()  # 8 s are too short for it


def test_vehicles_learned_from_are_not_tracked(traffic):
    train, test = held_out(traffic, share=0.5, rng=np.random.default_rng(0))
    assert train.n_tracks == test.n_tracks == 2
    assert not set(train.track_id) & set(test.track_id)
    with pytest.raises(ValueError, match="at least two vehicles, got 1: give a map"):
        held_out(traffic[traffic.track_id == 0], share=0.5, rng=np.random.default_rng(0))


def test_all_methods_track_the_same_and_tell_of_gaps(table):
    assert [m.name for m in table.methods] == list(QUICK["methods"])
    assert (table.n_vehicles, table.n_gaps, table.map_learned) == (8, 8, False)
    for method in table.methods:
        assert len(method.reports) == 2
        for found in method.reports:
            assert found.reported == 1.0
            assert 0.05 < found.seen_rmse < 1.5
            assert found.hidden_rmse > found.seen_rmse
            assert found.gospa**2 == pytest.approx(found.localisation + found.missed + found.false)
            assert 0.3 < found.coverage_50 < found.coverage_90 <= 1.0


def test_the_same_experiment_gives_the_same_figures_and_another_seed_others(table, traffic, ring_map):
    told = json.loads(json.dumps(asdict(table.experiment)))
    told["methods"], told["n_seeds"] = ["prior"], 1
    again = evaluate_tracking(traffic, TrackingExperiment.of(told), sensor=detect, primitive_map=ring_map)
    first = table.methods[0].reports[0]
    assert again.methods[0].reports[0].switches == first.switches
    other = evaluate_tracking(traffic, TrackingExperiment.of(told | {"seed": 1}), sensor=detect, primitive_map=ring_map)
    assert other.methods[0].reports[0] != again.methods[0].reports[0]
    once_more = evaluate_tracking(traffic, TrackingExperiment.of(told), sensor=detect, primitive_map=ring_map)
    assert once_more.methods[0].reports == again.methods[0].reports


def test_without_ids_errors_are_those_of_the_vehicles_that_estimates_are_given_to(traffic, ring_map):
    experiment = TrackingExperiment(
        n_seeds=1, gap_s=0.0, with_ids=False, miss_rate=0.1, methods=("prior",), filter=FilterConfig(n_particles=200)
    )
    found = evaluate_tracking(traffic, experiment, sensor=detect, primitive_map=ring_map).methods[0].reports[0]
    assert found.reported > 0.8
    assert found.seen_rmse < 1.0
    assert np.isnan(found.hidden_rmse)


def test_association_is_told_the_truth_of_the_sensor(traffic):
    experiment = TrackingExperiment(miss_rate=0.2, false_per_frame=10.0)
    area = np.prod(np.ptp(traffic.position, axis=0))
    told = honest_tracking(traffic, experiment)
    assert told.detection_probability == pytest.approx(0.8)
    assert told.clutter_density == pytest.approx(10.0 / area)


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"noise": 1.0}, "experiment: noise: expected one of noise_m, miss_rate"),
        ({"filter": {"particles": 3}}, "filter: particles: expected one of n_particles"),
        ({"tracking": 3}, "tracking: expected a table of names and values, got 3"),
        ({"noise_m": "much"}, "experiment: noise_m: expected a value of type float, got 'much'"),
        ({"noise_m": -1.0}, "noise_m: expected a positive number"),
        ({"methods": ["luck"]}, "methods: expected some of prior, place-free"),
        ({"learn": 1.0}, "learn: expected a share between 0 and 1"),
        ({"miss_rate": 1}, "miss_rate: expected a probability below 1"),
        ({"gap_s": -1}, "gap_s: expected at least 0"),
    ],
)
def test_a_wrong_experiment_is_named(told, message):
    with pytest.raises(ValueError, match=message):
        TrackingExperiment.of(told)


def test_a_file_may_set_the_filters_knobs():
    made = TrackingExperiment.of({"noise_m": 0.7, "filter": {"n_particles": 9}, "tracking": {"gate": 9.0}})
    assert made.filter == FilterConfig(n_particles=9, noise_m=0.7)
    assert made.tracking == TrackingConfig(gate=9.0)


def test_a_seed_without_gaps_tells_nothing_of_gaps():
    nan = float("nan")
    figures = dict.fromkeys((field.name for field in fields(TrackingReport)), 1.0)
    reports = tuple(TrackingReport(**(figures | {"hidden_rmse": of_gaps})) for of_gaps in (2.0, nan, 4.0))
    result = MethodResult(name="prior", reports=reports)
    assert result.mean("hidden_rmse") == 3.0
    assert result.std("hidden_rmse") == pytest.approx(np.sqrt(2.0))
    assert np.isnan(MethodResult(name="prior", reports=reports[1:2]).mean("hidden_rmse"))
