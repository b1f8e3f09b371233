"""`dirprim evaluate`: tables for people, one object for machines."""

import hashlib
import json
import re
from contextlib import redirect_stderr
from pathlib import Path

import pytest

from cli.commands import Terminal
from dirprim_filter import write_tracks
from dirprim_filter.cli.tables import forecast_text
from dirprim_filter.evaluation import cues, density, forecasting, tracking
from dirprim_filter.evaluation.intervals import Interval


@pytest.fixture
def log(ring, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_tracks(ring[ring.track_id < 8], "few.mcap")
    return Path("few.mcap")


@pytest.fixture(scope="module", autouse=True)
def run_once():
    """What was computed before is not computed again: tests of the library hold that a repeat gives the same."""
    with pytest.MonkeyPatch.context() as patch:
        for module, name in (
            (density, "evaluate_density"), (cues, "evaluate_cues"), (forecasting, "evaluate_forecasts"),
            (tracking, "evaluate_tracking"),
        ):  # fmt: skip
            patch.setattr(module, name, remembered(getattr(module, name)))
        yield


def remembered(evaluation):
    results = {}

    def evaluate_once(tracks, *settings, progress, rng=None, **options):
        drawn = None if rng is None else str(rng.bit_generator.state)
        key = (tracks.position.tobytes(), repr(settings), repr({**options, "rng": drawn}))
        options |= {} if rng is None else {"rng": rng}
        if key not in results:
            results[key] = evaluation(tracks, *settings, progress=progress, **options)
        return results[key]

    return evaluate_once


DENSITY = "density few.mcap --folds 2 --every 1"
CUES = "cues few.mcap --folds 2 --tessellation grid"
FORECAST = "forecast few.mcap --folds 2 --horizon 0.5 --horizon 1 --samples 20 --seed 3"
TRACKING = (
    "tracking few.mcap --gap 0.5 --seeds 2 --method prior --method 'constant velocity' --no-ids --set n_particles=50 "
    "--set miss_rate=0.1 --set false_per_frame=0.5 --set similarity_m=4"
)
SETTINGS = {
    DENSITY: {"split_by", "n_folds", "interval_s", "seed"},
    CUES: {"split_by", "n_folds", "tessellation", "seed"},
    FORECAST: {"split_by", "horizons_s", "n_folds", "n_samples", "seed"},
    TRACKING: {"noise_m", "gap_s", "methods", "filter", "tracking", "seed"},
}


@pytest.fixture
def table_of(said):
    """What machines are shown."""
    return lambda command: json.loads(said(f"evaluate {command} --json").out)


def both(command, said):
    """What people are shown, words set apart by one blank, and what machines are; which says what it follows from."""
    text, table = said(f"evaluate {command}").out, json.loads(said(f"evaluate {command} --json").out)
    assert (table["format"], table["format_version"]) == (f"dirprim evaluate {command.split()[0]}", 2)
    digest = hashlib.sha256(Path("few.mcap").read_bytes()).hexdigest()
    assert table["inputs"] == [{"name": "few.mcap", "sha256": digest}]
    assert table["reading"]["time_source"] == "header"
    assert set(table["experiment"]) >= SETTINGS[command]
    return [" ".join(line.split()) for line in text.splitlines()], table


def shown(interval):
    return f"{interval['value']:.3f} ({interval['low']:.3f} to {interval['high']:.3f})"


@pytest.mark.slow
def test_density_is_the_same_for_people_and_machines(log, said):
    lines, table = both(DENSITY, said)
    assert lines[0].startswith("80 rows held out of 80, 8 vehicles, by vehicle, 2 folds")
    for row in table["methods"]:
        score = row["direction"]
        behind = "" if row is table["methods"][0] else f" {shown(score['behind'])}"
        assert f"{row['name']} {shown(score['mean_log'])}{behind} {score['mean']:.3f}" in lines
    grid_map = next(row for row in table["methods"] if row["name"] == "DGM")
    assert grid_map["speed"] is None
    for fold in grid_map["settings"]:
        assert all(choice["low"] <= choice["chosen"] <= choice["high"] for choice in fold)
    assert any(line.startswith(f"DGM: cell size, m {grid_map['settings'][0][0]['chosen']:.3g}") for line in lines)
    assert lines[-1] == table["conclusion"]


def test_cues_is_the_same_for_people_and_machines(log, said):
    lines, reported = both(CUES, said)
    table = reported["table"]
    assert lines[0] == f"{table['n_steps']} steps from cell to cell, 8 vehicles, held out by vehicle, 2 folds"
    for name in ("cell_before", "own_course"):
        score = table[name]
        figures = [shown(score["posterior"]["mean_log"]), shown(score["log_gain"]), shown(score["over_prior"])]
        assert f"{name.replace('_', ' ')}, posterior {' '.join(figures)} {score['posterior']['mean']:.3f}" in lines


@pytest.mark.slow
def test_tracking_is_the_same_for_people_and_machines_and_can_be_had_again(log, said, table_of):
    lines, table = both(TRACKING, said)
    assert "10% missed, 0.5 false per frame, no ids; map learned from others, held out by vehicle" in lines[0]
    for figure, head in {"gospa": "GOSPA per vehicle, m", "hota": "HOTA", "seen_rmse": "RMSE in sight, m"}.items():
        line = next(line for line in lines if line.startswith(f"{head} "))
        means = [sum(report[figure] for report in row["reports"]) / 2 for row in table["methods"]]
        assert [cell for cell in line.removeprefix(head).split() if "+-" not in cell] == [f"{m:.3f}" for m in means]
    Path("run.json").write_text(json.dumps(table))
    assert table_of("tracking few.mcap --config run.json") == table


def test_an_experiment_file_is_followed(log, table_of):
    own = Path("own.toml")
    own.write_text('n_seeds = 1\ngap_s = 0.0\nmethods = ["constant velocity"]\n[filter]\nmax_gap_s = 2.0\n')
    made = table_of("tracking few.mcap --config own.toml --set noise_m=0.3")["experiment"]
    assert (made["n_seeds"], made["noise_m"], made["filter"]["max_gap_s"]) == (1, 0.3, 2.0)


@pytest.mark.slow
def test_forecast_is_the_same_for_people_and_machines_and_can_be_had_again(log, said, table_of):
    with redirect_stderr(Terminal()) as progress:
        lines, table = both(FORECAST, said)
    assert "8 of 8 fits" in progress.getvalue()
    assert lines[0] == "8 vehicles held out by vehicle, 2 folds; 20 rollouts each"
    names = ["prior", "place-free", "prior, leaders", "one cell", "trajectory memory", "constant velocity"]
    assert [row["name"] for row in table["methods"]] == names
    rows = [line.split() for line in lines if re.match(r"[0-9.]+ s ", line)]
    scores = [score for row in table["methods"] for score in row["horizons"]]
    for line, score in zip(rows, scores, strict=True):
        figures = [f"{score[name]:.2f}" for name in ("energy", "ade", "fde", "coverage_50", "coverage_90")]
        assert line[2:] == [str(score["n_cases"]), *figures]
        assert set(score["gain"]) == {"value", "low", "high", "n_clusters"}
    memory = next(row for row in table["methods"] if row["name"] == "trajectory memory")
    assert all(found["low"] < found["chosen"] < found["high"] for fold in memory["settings"] for found in fold)
    Path("run.json").write_text(json.dumps(table))
    assert table_of("forecast few.mcap --config run.json") == table
    again = table_of("forecast few.mcap --config run.json --seed 0")
    assert again["experiment"] == table["experiment"] | {"seed": 0}
    assert [row["name"] for row in again["methods"]] == names


def test_forecast_concludes_with_what_the_map_takes_off_or_adds():
    def score(horizon_s, *gain):
        return forecasting.HorizonScore(
            horizon_s=horizon_s, n_cases=99, energy=1.0, gain=Interval(*gain, 7), ade=1.0, fde=1.0, coverage_50=0.5,
            coverage_90=0.9,
        )  # fmt: skip

    rows = {
        "prior": [score(h, 0.0, 0.0, 0.0) for h in (0.5, 1.0, 4.0, 8.0)],
        "place-free": [score(h, 0.5, 0.45, 0.55) for h in (0.5, 1.0, 4.0, 8.0)],
        "trajectory memory": [score(h, -0.03, -0.07, 0.1 * (h < 4) - 0.01) for h in (0.5, 1.0, 4.0, 8.0)],
    }
    methods = [forecasting.MethodForecasts(name=n, horizons=tuple(of), settings=()) for n, of in rows.items()]
    table = forecasting.ForecastTable(methods=tuple(methods), split_by="group", n_folds=2, n_samples=20, n_vehicles=9)
    assert forecast_text(table).splitlines()[-5:] == [
        "Energy score of the prior, with 95 % intervals over 7 groups:",
        "  at 1 s   50.0 % (45.0 to 55.0 %) less than the same model without the map",
        "           3.0 % (-9.0 to 7.0 %) more than trajectory memory: not distinguishable",
        "  at 4 s   50.0 % (45.0 to 55.0 %) less than the same model without the map",
        "           3.0 % (1.0 to 7.0 %) more than trajectory memory",
    ]
