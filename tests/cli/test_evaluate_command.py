"""`dirprim evaluate`: tables for people, one object for machines."""

import hashlib
import json
import re

import pytest

from dirprim_filter import write_tracks
from dirprim_filter.cli.evaluate.forecast import forecast_text
from dirprim_filter.cli.main import run
from dirprim_filter.evaluation import cues, density, experiment, forecasting
from dirprim_filter.evaluation.intervals import Interval

DONE, FAILED, USAGE = 0, 1, 2
FORECASTS = ["prior", "place-free", "prior, leaders", "one cell", "trajectory memory", "constant velocity"]


@pytest.fixture(scope="module")
def log(ring, tmp_path_factory):
    path = tmp_path_factory.mktemp("evaluate") / "few.mcap"
    write_tracks(ring[ring.track_id < 8], path)
    return path


@pytest.fixture(scope="module", autouse=True)
def run_once():
    """What was computed before is not computed again: tests of the library hold that a repeat gives the same."""
    with pytest.MonkeyPatch.context() as patch:
        for module, name in (
            (density, "evaluate_density"), (cues, "evaluate_cues"), (forecasting, "evaluate_forecasts"),
            (experiment, "evaluate_tracking"),
        ):  # fmt: skip
            patch.setattr(module, name, remembered(getattr(module, name)))
        yield


def remembered(evaluation):
    results = {}

    def evaluate_once(tracks, *settings, progress, sinks=(), rng=None, **options):
        drawn = None if rng is None else str(rng.bit_generator.state)
        key = (tracks.position.tobytes(), repr(settings), repr({**options, "rng": drawn}))
        if sinks:
            options["sinks"] = sinks
        if rng is not None:
            options["rng"] = rng
        if key not in results or sinks:
            results[key] = evaluation(tracks, *settings, progress=progress, **options)
        return results[key]

    return evaluate_once


ENVELOPE = {"format", "format_version", "version", "inputs", "reading", "experiment"}


DENSITY = ("--folds", 2, "--every", 1.0)
FORECAST = ("--folds", 2, "--horizon", 0.5, "--horizon", 1, "--samples", 20, "--seed", 3)
TRACKING = (
    "--gap", 0.5, "--seeds", 2, "--set", "n_particles=50", "--method", "prior", "--method", "constant velocity",
    "--no-ids", "--set", "miss_rate=0.1", "--set", "false_per_frame=0.5", "--set", "cutoff_m=4",
)  # fmt: skip


def evaluate(*arguments):
    return run(["evaluate", *map(str, arguments)])


def test_density_tells_people_and_machines_the_same(log, capsys):
    options = ("density", log, *DENSITY)
    assert evaluate(*options) == DONE
    text = capsys.readouterr().out
    assert evaluate(*options, "--json") == DONE
    table = json.loads(capsys.readouterr().out)
    assert table["split_by"] == "vehicle"
    assert table["n_held_out"] == table["n_rows"] == 80
    assert text.startswith("80 rows held out of 80, 8 vehicles, by vehicle, 2 folds")
    for row in table["methods"]:
        line = next(line for line in text.splitlines() if line.startswith(f"{row['name']}  "))
        score = row["direction"]
        behind = "" if row is table["methods"][0] else f" {shown(score['behind'])}"
        assert " ".join(line.split()) == f"{row['name']} {shown(score['mean_log'])}{behind} {score['mean']:.3f}"
    grid_map = next(row for row in table["methods"] if row["name"] == "DGM")
    assert grid_map["speed"] is None
    for fold in grid_map["settings"]:
        assert [list(choice) for choice in fold] == 3 * [["name", "low", "chosen", "high"]]
        assert all(choice["low"] <= choice["chosen"] <= choice["high"] for choice in fold)
    assert f"DGM: cell size, m {grid_map['settings'][0][0]['chosen']:.3g}" in text
    assert text.splitlines()[-1] == table["conclusion"]


def shown(interval):
    return f"{interval['value']:.3f} ({interval['low']:.3f} to {interval['high']:.3f})"


def test_one_fold_of_random_rows_has_its_interval_over_vehicles(log, capsys, monkeypatch):
    first, *_ = density.all_methods(max_speed=20.0)
    monkeypatch.setattr(density, "all_methods", lambda **_: [first])
    assert evaluate("density", log, "--split", "random", "--folds", 1, "--every", 2.0, "--json") == DONE
    table = json.loads(capsys.readouterr().out)
    assert table["n_held_out"] == 4
    assert 2 <= table["methods"][0]["direction"]["mean_log"]["n_clusters"] <= 4
    assert table["conclusion"].startswith("the map gives held-out motion nothing that is compared")


def test_cues_tells_people_and_machines_the_same(log, capsys):
    assert evaluate("cues", log, "--folds", 2, "--tessellation", "grid") == DONE
    text = capsys.readouterr().out
    assert evaluate("cues", log, "--folds", 2, "--tessellation", "grid", "--json") == DONE
    reported = json.loads(capsys.readouterr().out)
    assert set(reported) == {*ENVELOPE, "table", "turn_signal"}
    assert f"{reported['table']['n_steps']} steps from cell to cell, 8 vehicles, held out by vehicle, 2 folds" in text
    for name in ("cell_before", "own_course"):
        score = reported["table"][name]
        figures = [shown(score["posterior"]["mean_log"]), shown(score["log_gain"]), shown(score["over_prior"])]
        words = f"{name.replace('_', ' ')}, posterior {' '.join(figures)} {score['posterior']['mean']:.3f}"
        assert words in " ".join(text.split())


def test_what_cannot_be_held_out_is_one_line(log, capsys):
    assert evaluate("density", log, "--split", "group") == FAILED
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "at least two to split by group, got 1" in error
    assert evaluate("cues", log, "--split", "random") == USAGE
    assert evaluate("density", log, "--folds", 0) == USAGE


def test_tracking_tells_people_and_machines_the_same_and_can_be_had_again(log, capsys, tmp_path):
    from dirprim_filter import read_estimates

    out, chart = tmp_path / "out.mcap", tmp_path / "chart.png"
    options = ("tracking", log, *TRACKING)
    assert evaluate(*options, "-o", out, "--plot", chart) == DONE
    text = capsys.readouterr().out
    assert "10% missed, 0.5 false per frame, no ids; map learned from others, held out by vehicle" in text
    assert evaluate(*options, "--json") == DONE
    first = capsys.readouterr().out
    table = json.loads(first)
    heads = {"gospa": "GOSPA per vehicle, m", "hota": "HOTA", "seen_rmse": "RMSE in sight, m"}
    for figure, head in heads.items():
        line = next(line for line in text.splitlines() if line.startswith(f"{head}  "))
        means = [sum(report[figure] for report in row["reports"]) / 2 for row in table["methods"]]
        assert [cell for cell in line.removeprefix(head).split() if "+-" not in cell] == [f"{m:.3f}" for m in means]
    assert chart.stat().st_size > 1000
    assert len(read_estimates(out)) > 0
    (tmp_path / "run.json").write_text(first)
    for config in (out, tmp_path / "run.json"):
        assert evaluate("tracking", log, "--config", config, "--json") == DONE
        assert capsys.readouterr().out == first


def test_an_experiment_file_is_followed_and_a_wrong_one_is_one_line(log, capsys, tmp_path):
    config = tmp_path / "experiment.toml"
    config.write_text('n_seeds = 1\ngap_s = 0.0\nmethods = ["constant velocity"]\n[filter]\nmax_gap_s = 2.0\n')
    assert evaluate("tracking", log, "--config", config, "--set", "noise_m=0.3", "--json") == DONE
    reported = json.loads(capsys.readouterr().out)["experiment"]
    assert (reported["n_seeds"], reported["noise_m"], reported["filter"]["max_gap_s"]) == (1, 0.3, 2.0)
    model = tmp_path / "sensor.toml"
    model.write_text("latency_s = 0.1\n[along]\nspread_m = 0.4\n[across]\nspread_m = 0.2\n")
    assert evaluate("tracking", log, "--config", config, "--sensor", model, "--json") == DONE
    again = tmp_path / "again.json"
    again.write_text(first := capsys.readouterr().out)
    assert json.loads(first)["experiment"]["sensor"]["latency_s"] == 0.1
    assert evaluate("tracking", log, "--config", again, "--json") == DONE
    assert capsys.readouterr().out == first
    assert evaluate("tracking", log, "--config", again, "--set", "noise_m=0.3") == USAGE
    model.write_text("latency_s = -1\n[along]\nspread_m = 0.4\n[across]\nspread_m = 0.2\n")
    capsys.readouterr()
    assert evaluate("tracking", log, "--sensor", model) == FAILED
    error = capsys.readouterr().err
    assert error == f"error: {model}: latency_s: expected 0 to 5 seconds, got -1\n"
    for text, message in (
        ("noise = 1", "noise: expected one of noise_m"),
        ("noise_m = ", "expected an experiment in TOML"),
    ):
        config.write_text(text)
        assert evaluate("tracking", log, "--config", config) == FAILED
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert message in error


def test_forecast_tells_people_and_machines_the_same_and_draws(log, capsys, tmp_path):
    options = ("forecast", log, *FORECAST)
    assert evaluate(*options, "--plot", tmp_path / "f.png") == DONE
    text = capsys.readouterr().out
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")
    assert evaluate(*options, "--json") == DONE
    table = json.loads(capsys.readouterr().out)
    assert text.startswith("8 vehicles held out by vehicle, 2 folds, 1 seed; 20 futures each")
    assert [row["name"] for row in table["methods"]] == FORECASTS
    lines = [line.split() for line in text.splitlines() if re.match("[0-9.]+ s ", line)]
    scores = [score for row in table["methods"] for score in row["horizons"]]
    for line, score in zip(lines, scores, strict=True):
        figures = [f"{score[name]:.2f}" for name in ("energy", "ade", "fde", "coverage_50", "coverage_90")]
        assert line[2:] == [str(score["n_cases"]), *figures]
    assert all(set(score["gain"]) == {"value", "low", "high", "n_clusters"} for score in scores)
    memory = next(row for row in table["methods"] if row["name"] == "trajectory memory")
    for found in (found for fold in memory["settings"] for found in fold):
        assert found["low"] < found["chosen"] < found["high"]


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
    table = forecasting.ForecastTable(
        methods=tuple(methods), split_by="group", n_folds=2, n_seeds=1, n_samples=20, n_vehicles=9
    )
    assert forecast_text(table).splitlines()[-5:] == [
        "Energy score of the prior, with 95 % intervals over 7 groups:",
        "  at 1 s   50.0 % (45.0 to 55.0 %) less than the same model without the map",
        "           3.0 % (-9.0 to 7.0 %) more than trajectory memory: not distinguishable",
        "  at 4 s   50.0 % (45.0 to 55.0 %) less than the same model without the map",
        "           3.0 % (1.0 to 7.0 %) more than trajectory memory",
    ]


def test_a_configuration_that_is_none_is_reported_as_such(log, capsys, tmp_path):
    (tmp_path / "notes.txt").write_text("noise: a lot")
    assert evaluate("tracking", log, "--config", tmp_path / "notes.txt") == FAILED
    assert "notes.txt: expected an experiment in TOML, or the JSON or MCAP of" in capsys.readouterr().err


def test_every_object_says_what_it_follows_from(log, capsys):
    commands = {
        "density": (DENSITY, {"split_by", "n_folds", "interval_s", "min_speed", "seed"}),
        "forecast": (FORECAST, {"split_by", "horizons_s", "n_folds", "n_seeds", "n_samples", "seed"}),
        "tracking": (TRACKING, {"noise_m", "gap_s", "methods", "filter", "tracking", "seed"}),
    }  # fmt: skip
    for command, (options, names) in commands.items():
        assert evaluate(command, log, *options, "--start", 0, "--json") == DONE
        reported = json.loads(capsys.readouterr().out)
        assert set(reported) > ENVELOPE
        assert (reported["format"], reported["format_version"]) == (f"dirprim evaluate {command}", 2)
        assert reported["inputs"] == [{"name": "few.mcap", "sha256": hashlib.sha256(log.read_bytes()).hexdigest()}]
        assert reported["reading"]["start"] == "0"
        assert set(reported["experiment"]) >= names


def test_forecasts_can_be_had_again_from_what_was_reported(log, capsys, tmp_path):
    assert evaluate("forecast", log, *FORECAST, "--json") == DONE
    first = capsys.readouterr().out
    names = [row["name"] for row in json.loads(first)["methods"]]
    assert names == FORECASTS
    (tmp_path / "run.json").write_text(first)
    assert evaluate("forecast", log, "--config", tmp_path / "run.json", "--json") == DONE
    assert capsys.readouterr().out == first
    others = ("--seed", 0, "--set", "interaction=none")
    assert evaluate("forecast", log, "--config", tmp_path / "run.json", *others, "--json") == DONE
    again = json.loads(capsys.readouterr().out)
    assert again["experiment"] == json.loads(first)["experiment"] | {"seed": 0, "interaction": "none"}
    assert [row["name"] for row in again["methods"]] == [name for name in FORECASTS if name != "prior, leaders"]
    (tmp_path / "wrong.toml").write_text("n_fold = 2")
    assert evaluate("forecast", log, "--config", tmp_path / "wrong.toml") == FAILED
    assert "experiment: n_fold: expected one of split_by" in capsys.readouterr().err


def test_former_options_are_taken_with_a_warning_and_not_shown(log, capsys):
    options = ("--gap", 0, "--seeds", 1, "--method", "constant velocity", "--json")
    assert evaluate("tracking", log, "--set", "miss_rate=0.3", "--set", "smooth=true", *options) == DONE
    reported = capsys.readouterr()
    assert "warning" not in reported.err
    assert evaluate("tracking", log, "--miss-rate=0.3", "--smooth", *options) == DONE
    formerly = capsys.readouterr()
    assert formerly.out == reported.out
    assert "warning: --miss-rate is now --set miss_rate=...; the next release removes --miss-rate" in formerly.err
    assert "warning: --smooth is now --set smooth=true;" in formerly.err
    assert evaluate("tracking", "--help") == DONE
    assert "--miss-rate" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "said"),
    [("miss_rate", "expected NAME=VALUE"), ("mis_rate=1", "mis_rate: expected one of"), ("group=x", "group: expected")],
)
def test_a_setting_that_is_none_is_usage(log, capsys, given, said):
    assert evaluate("tracking", log, "--set", given) == USAGE
    assert said in " ".join(capsys.readouterr().err.split())
