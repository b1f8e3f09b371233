"""Tracking experiments: what is hidden, what is held out, what a report says, and how to have it again."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig, from_table
from dirprim_filter.evaluation.scenes import gaps
from dirprim_filter.evaluation.splits import held_out
from dirprim_filter.evaluation.tracking import comparisons, evaluate_tracking
from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment
from dirprim_filter.tracks import Tracks
from situations import ring_traffic

QUICK = {
    "n_seeds": 2, "gap_s": 2.0, "methods": ("prior", "constant velocity", "place-free"),
    "filter": FilterConfig(n_particles=100),
}  # fmt: skip


@pytest.fixture(scope="module")
def traffic():
    return ring_traffic(np.random.default_rng(8), n_vehicles=4, n_rows=80)


@pytest.fixture(scope="module")
def table(traffic, ring_map):
    return evaluate_tracking(traffic, TrackingExperiment(**QUICK), primitive_map=ring_map)


def test_every_vehicle_is_hidden_once_for_the_gap_and_not_near_its_ends(traffic):
    hidden = gaps(traffic, gap_s=2.0, rng=np.random.default_rng(0))
    for name in np.unique(traffic.track_id):
        own = hidden[traffic.track_id == name]
        rows = np.flatnonzero(own)
        assert rows.size in (19, 20, 21)
        assert (np.diff(rows) == 1).all()
        assert 20 <= rows[0] < rows[-1] <= 60
    for gap_s in (0.0, 5.0):  # 8 s are too short for the latter
        assert not gaps(traffic, gap_s=gap_s, rng=np.random.default_rng(0)).any()


def test_all_methods_track_the_same_and_tell_of_gaps(table):
    assert [m.name for m in table.methods] == list(QUICK["methods"])
    assert (table.n_vehicles, table.n_gaps, table.split_by) == (8, 8, "")
    for method in table.methods:
        assert len(method.reports) == 2
        for found in method.reports:
            assert found.reported == 1.0
            assert 0.05 < found.seen_rmse < 1.5
            assert method.name == "prior" or found.hidden_rmse > found.seen_rmse
    for of_seed in table.settings:
        assert set(of_seed) == {"constant velocity"}
        assert all(found.low < found.chosen < found.high for settings in of_seed.values() for found in settings)


def test_the_same_experiment_gives_the_same_figures_and_another_seed_others(table, traffic, ring_map):
    reported = json.loads(json.dumps(asdict(table.experiment)))
    reported["methods"], reported["n_seeds"] = ["prior"], 1
    again, once_more, other = (
        evaluate_tracking(traffic, from_table(TrackingExperiment, reported | seed), primitive_map=ring_map)
        for seed in ({}, {}, {"seed": 1})
    )
    assert once_more == again
    assert other.methods[0].reports[0] != again.methods[0].reports[0]
    known = table.methods[0].reports[0]  # of more methods, whose seeds are drawn after the first's
    assert (again.methods[0].name, again.methods[0].reports) == ("prior", (known,))


def test_methods_are_compared_row_by_row_where_both_have_an_estimate(table):
    (velocity, without) = comparisons(table)
    assert (velocity.first, velocity.other, without.other) == ("prior", "constant velocity", "place-free")
    prior, other = (next(m for m in table.methods if m.name == name) for name in ("prior", "constant velocity"))
    squared = []
    for a, b in zip(prior.errors, other.errors, strict=True):
        both = np.isfinite(a.squared) & np.isfinite(b.squared) & a.is_hidden
        squared.append((a.squared[both], b.squared[both]))
    mine, theirs = (np.sqrt(np.concatenate(part).mean()) for part in zip(*squared, strict=True))
    assert velocity.in_gaps.value == pytest.approx(1.0 - mine / theirs)
    assert velocity.in_gaps.n_clusters == 4  # the same vehicles in both seeds
    assert velocity.hota is None
    assert "the map against constant velocity: error in gaps" in velocity.sentence


def test_without_ids_hota_is_compared_and_of_one_group_run_by_run(traffic, ring_map):
    experiment = TrackingExperiment(
        n_seeds=3, gap_s=0.0, with_ids=False, methods=("constant velocity", "prior"), filter=QUICK["filter"]
    )
    table = evaluate_tracking(traffic[traffic.time_ns < 4e9], experiment, primitive_map=ring_map)
    (found,) = comparisons(table)
    hotas = [[report.hota for report in method.reports] for method in table.methods]
    assert found.in_sight is None
    assert found.hota.n_clusters == 3
    assert found.hota.value == pytest.approx(np.subtract(*hotas).mean())
    assert found.sentence.startswith("constant velocity against the map: HOTA ")


def in_groups(n_groups):
    """Other traffic in each group, under the same ids."""
    rings = [ring_traffic(np.random.default_rng(81 + i), n_vehicles=4, n_rows=80) for i in range(n_groups)]
    return Tracks.concatenate([replace(ring, group=np.full(len(ring), 1 + i)) for i, ring in enumerate(rings)])


def test_pooled_figures_count_every_row_and_frame_alike(ring_map):
    experiment = TrackingExperiment(n_seeds=1, gap_s=2.0, with_ids=False, methods=("constant velocity",))
    (found,) = evaluate_tracking(in_groups(3), experiment, primitive_map=ring_map).methods
    (pooled,), (groups,) = found.reports, found.by_group
    assert pooled.gospa**2 == pytest.approx(np.mean([of.gospa**2 for of in groups]))  # 320 rows each
    assert pooled.switches == sum(of.switches for of in groups)
    assert pooled.reported == pytest.approx(np.mean([of.reported for of in groups]))
    assert min(of.seen_rmse for of in groups) < pooled.seen_rmse < max(of.seen_rmse for of in groups)
    assert np.isnan(found.std("seen_rmse"))
    (errors,) = found.errors
    assert sorted(set(errors.cluster)) == ["1", "2", "3"]
    known = np.isfinite(errors.squared)
    for hidden, rmse in ((False, pooled.seen_rmse), (True, pooled.hidden_rmse)):
        assert np.sqrt(errors.squared[known & (errors.is_hidden == hidden)].mean()) == pytest.approx(rmse)


def test_a_gap_longer_than_beliefs_last_is_judged_to_its_end(ring_map):
    """A belief ends 5 s after it was last seen by default."""
    traffic = ring_traffic(np.random.default_rng(8), n_vehicles=4, n_rows=160)
    experiment = TrackingExperiment(n_seeds=1, gap_s=9.0, methods=("constant velocity",))
    assert experiment.filter.max_gap_s > 9.0 > FilterConfig().max_gap_s
    (found,) = evaluate_tracking(traffic, experiment, primitive_map=ring_map).methods
    assert found.reports[0].reported == 1.0
    assert TrackingExperiment(gap_s=0.0, filter=FilterConfig(max_gap_s=2.0)).filter.max_gap_s == 2.0


def test_whole_groups_are_held_out_where_there_are_some_else_whole_vehicles(traffic):
    for tracks, column in ((in_groups(3), "group"), (traffic, "track_id")):
        parts = held_out(tracks, share=0.5, rng=np.random.default_rng(0))
        assert sum(map(len, parts)) == len(tracks)
        assert [len(set(getattr(part, column))) for part in parts] == [2, len(set(getattr(tracks, column))) - 2]
        assert not set(getattr(parts[0], column)) & set(getattr(parts[1], column))
    with pytest.raises(ValueError, match="at least two vehicles, got 1: give a map"):
        held_out(traffic[traffic.track_id == 0], share=0.5, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"noise": 1.0}, "noise: expected one of noise_m, miss_rate"),
        ({"filter": {"particles": 3}}, "filter: particles: expected one of n_particles"),
        ({"tracking": 3}, "tracking: expected a table of names and values, got 3"),
        ({"noise_m": "much"}, "noise_m: expected a value of type float, got 'much'"),
        ({"noise_m": -1.0}, "noise_m: expected a positive number"),
        ({"methods": ["chance"]}, "methods: expected some of prior, place-free"),
        ({"learn": 1.0}, "learn: expected a share below 1"),
        ({"miss_rate": 1}, "miss_rate: expected a share below 1"),
        ({"gap_s": -1}, "gap_s: expected at least 0"),
    ],
)
def test_a_wrong_experiment_is_named(config, message):
    with pytest.raises(ValueError, match=message):
        from_table(TrackingExperiment, config)


def test_smoothers_stand_beside_their_filters_and_know_more(traffic, ring_map):
    reported = QUICK | {"n_seeds": 1, "methods": ("prior", "constant velocity", "one cell"), "smooth": True}
    table = evaluate_tracking(traffic, TrackingExperiment(**reported), primitive_map=ring_map)
    of = {result.name: result for result in table.methods}
    smoothed = ("prior smoothed", "constant velocity smoothed")
    assert list(of) == ["prior", smoothed[0], "constant velocity", smoothed[1], "one cell"]
    for name in ("prior", "constant velocity"):
        for figure in ("seen_rmse", "hidden_rmse"):
            assert of[f"{name} smoothed"].mean(figure) < of[name].mean(figure)
    plain = replace(TrackingExperiment(**reported), smooth=False, methods=("prior",))
    again = evaluate_tracking(traffic, plain, primitive_map=ring_map)
    assert again.methods[0].mean("rmse") == of["prior"].mean("rmse")  # to be smoothed changes no filter
