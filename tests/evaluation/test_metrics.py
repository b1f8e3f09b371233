"""The field's metrics against its reference implementations."""

from datetime import datetime

import numpy as np
import pytest
from stonesoup.metricgenerator.ospametric import GOSPAMetric
from stonesoup.types.state import State
from trackeval.metrics import CLEAR, HOTA, Identity

from dirprim_filter.evaluation.metrics.clear_mot import clear_mot, identity_f1
from dirprim_filter.evaluation.metrics.comparison import Comparison
from dirprim_filter.evaluation.metrics.gospa import gospa
from dirprim_filter.evaluation.metrics.hota import hota
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.tracks import Tracks

CUTOFF_M = 4.0
SIMILARITY_M = 5.0


def table(kind, rows, group, **columns):
    """Of rows (id, instant, x, y)."""
    ids, times, x, y = zip(*rows, strict=True) if rows else ((),) * 4
    known = {"track_id": np.array(ids, np.str_), "time_ns": np.array(times, np.int64)} | columns
    return kind(**known | ({} if group is None else {"group": group}), position=np.column_stack([x, y]))


def comparison_of(truth, estimated, *, similarity_m=SIMILARITY_M, groups=(None, None)):
    tracks = table(Tracks, truth, groups[0], direction=np.zeros(len(truth)), speed=np.ones(len(truth)))
    return Comparison.of(tracks, table(TrackedRows, estimated, groups[1]), similarity_m=similarity_m)


def traffic(seed, *, n_vehicles=7, n_instants=40, side=25.0):
    """Vehicles that come and go in a small place, and tracks of them that err, lose them, swap and are false."""
    rng = np.random.default_rng(seed)
    truth, estimated = [], []
    wearer = np.arange(n_vehicles)
    begin = rng.integers(0, n_instants // 2, n_vehicles)
    end = begin + rng.integers(n_instants // 4, n_instants, n_vehicles)
    start, velocity = rng.uniform(0, side, (n_vehicles, 2)), rng.normal(0, 0.4, (n_vehicles, 2))
    for k in range(n_instants):
        if rng.random() < 0.15:
            a, b = rng.choice(n_vehicles, 2, replace=False)
            wearer[[a, b]] = wearer[[b, a]]
        if rng.random() < 0.1:
            wearer[rng.integers(n_vehicles)] = 100 + k
        for i in np.flatnonzero((begin <= k) & (k <= end)):
            place = start[i] + k * velocity[i]
            truth.append((f"v{i}", k, *place))
            if rng.random() < 0.85:
                estimated.append((f"t{wearer[i]}", k, *(place + rng.normal(0, 1.2, 2))))
        for j in range(rng.poisson(0.6)):
            estimated.append((f"f{k % 5}{j}", k, *rng.uniform(0, side, 2)))
    return truth, estimated


def for_trackeval(truth, estimated):
    """What TrackEval takes of a sequence."""
    vehicles, tracks = (list(dict.fromkeys(row[0] for row in rows)) for rows in (truth, estimated))
    data = {
        "num_gt_dets": len(truth), "num_tracker_dets": len(estimated), "num_gt_ids": len(vehicles),
        "num_tracker_ids": len(tracks), "gt_ids": [], "tracker_ids": [], "similarity_scores": [],
    }  # fmt: skip
    times = sorted({row[1] for row in truth + estimated})
    for k in times:
        here, there = [r for r in truth if r[1] == k], [r for r in estimated if r[1] == k]
        data["gt_ids"].append(np.array([vehicles.index(r[0]) for r in here], dtype=int))
        data["tracker_ids"].append(np.array([tracks.index(r[0]) for r in there], dtype=int))
        a, b = (np.array([r[2:] for r in rows]).reshape(-1, 2) for rows in (here, there))
        distance = np.linalg.norm(a[:, None] - b[None], axis=-1)
        data["similarity_scores"].append(np.maximum(0.0, 1.0 - distance / SIMILARITY_M))
    return data | {"num_timesteps": len(times)}


def of_trackeval(*scenes):
    """Of scenes (truth, estimates), combined where there are several."""
    found = {}
    for metric in (HOTA(), Identity({"PRINT_CONFIG": False}), CLEAR({"PRINT_CONFIG": False})):
        of_each = [metric.eval_sequence(for_trackeval(*scene)) for scene in scenes]
        found |= metric.combine_sequences(dict(enumerate(of_each))) if len(scenes) > 1 else of_each[0]
    return {name: float(np.mean(found[name])) for name in ("HOTA", "DetA", "AssA", "LocA", "IDF1", "MOTA", "IDSW")}


def of_ours(truth, estimated, **options):
    comparison = comparison_of(truth, estimated, **options)
    accuracy, clear = hota(comparison), clear_mot(comparison)
    return {
        "HOTA": accuracy.hota, "DetA": accuracy.deta, "AssA": accuracy.assa, "LocA": accuracy.loca,
        "IDF1": identity_f1(comparison), "MOTA": clear.mota, "IDSW": clear.switches,
    }  # fmt: skip


@pytest.mark.parametrize("seed", range(10))
def test_scores_are_trackevals(seed):
    truth, estimated = traffic(seed)
    expected = of_trackeval((truth, estimated))
    assert of_ours(truth, estimated) == pytest.approx(expected, abs=1e-9)
    assert expected["IDSW"] >= 3  # scenes that ask something: nothing is perfect, nothing is hopeless
    assert 0.2 < expected["HOTA"] < 0.8
    worse = [(name, k, x + 0.1, y) for name, k, x, y in estimated]
    assert of_ours(truth, worse) != pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("without", ["truth", "estimates"])
def test_of_nothing_scores_are_trackevals(without):
    truth, estimated = traffic(0)
    chosen = ([], estimated) if without == "truth" else (truth, [])
    expected = of_trackeval(chosen)
    if without == "truth":  # TrackEval leaves 0 where it returns early; each estimate is one too many
        expected["MOTA"] = -len(estimated)
    assert of_ours(*chosen) == pytest.approx(expected, abs=1e-12)


def test_groups_are_scenes_however_much_they_lie_on_each_other():
    """Two groups at the same times and places, with the same ids, score as two sequences that TrackEval combines."""
    one, other = traffic(1, side=8.0), traffic(2, side=8.0)
    combined = of_trackeval(one, other)
    groups = tuple(np.repeat([3, 8], [len(one[i]), len(other[i])]) for i in range(2))
    order = np.argsort([row[1] for row in one[0] + other[0]], kind="stable")
    truth = [(one[0] + other[0])[i] for i in order]
    truth = [(f"{g}/{name}", *rest) for g, (name, *rest) in zip(groups[0][order], truth, strict=True)]
    got = of_ours(truth, one[1] + other[1], groups=(groups[0][order], groups[1]))
    assert got == pytest.approx(combined, abs=1e-9)
    overlaid = of_ours(truth, [(f"{g}{r[0]}", *r[1:]) for g, r in zip(groups[1], one[1] + other[1], strict=True)])
    assert overlaid["HOTA"] != pytest.approx(combined["HOTA"], abs=1e-3)


# GOSPA


def points(places, prefix="p", k=0):
    return [(f"{prefix}{i}", k, *place) for i, place in enumerate(places)]


def sets():
    rng = np.random.default_rng(0)
    for n, m in [(0, 0), (0, 3), (2, 0), (1, 1), (3, 3), (2, 5), (5, 3), (4, 4)]:
        for _ in range(5):
            yield rng.uniform(0, 8, (n, 2)), rng.uniform(0, 8, (m, 2))


def test_gospa_and_its_parts_are_stone_soups_and_instants_add_up():
    theirs = GOSPAMetric(p=2, c=CUTOFF_M)
    now = datetime(2026, 1, 1)
    compared, total, truths, found = 0, 0.0, [], []
    for k, (truth, estimated) in enumerate(sets()):
        if len(truth) + len(estimated) == 0:
            continue
        states = [[State(place[:, None], timestamp=now) for place in places] for places in (estimated, truth)]
        expected = theirs.compute_gospa_metric(*states)[0].value
        got = gospa(comparison_of(points(truth), points(estimated), similarity_m=CUTOFF_M))
        for name in ("distance", "localisation", "missed", "false"):
            assert getattr(got, name) == pytest.approx(expected[name], abs=1e-9), name
        off = np.linalg.norm(truth[got.pairs.row] - estimated[got.pairs.column], axis=1)
        assert (off < CUTOFF_M).all()
        assert got.localisation == pytest.approx((off**2).sum())
        compared += 1
        total += expected["distance"] ** 2
        truths, found = truths + points(truth, k=k), found + points(estimated, k=k)
    assert compared == 35
    assert gospa(comparison_of(truths, found, similarity_m=CUTOFF_M)).distance ** 2 == pytest.approx(total)
