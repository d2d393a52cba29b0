"""Likelihood, posterior and forecasts of a field test: closed forms, and a soil that is known."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from rock2d.errors import InputError
from rock2d.field_tests import candidates, command, likelihood, study
from rock2d.field_tests.command import predict_releases, run_field_test
from rock2d.field_tests.descents import Descents
from rock2d.field_tests.forecasts import QUANTILE_NAMES, Forecast, PartForecast, naive_forecast, score_table
from rock2d.field_tests.study import FOLDS, Effort, fold_indices
from rock2d.files.field_releases import FieldReleases
from rock2d.files.scenario_reading import load_scenario
from tests.field_tests.small_field import TRUE_RESTITUTION, write_field

EFFORT = Effort(prior=24, refined=8, copies=1, draws=16)
LEAST = Effort(prior=8, refined=2, copies=1, draws=8)  # for forecasts that nobody judges
FEW_SEEDS = 2  # with 16 draws a forecast has 32 distances
FEW_SOILS = 8  # with which shapes are compared
# If 90 % intervals hold each of these releases with probability 0.5 only, the share inside is above 0.7 in 4 of 100
# cases.
RELEASES = 16


def test_the_density_is_one_in_all():
    x = np.linspace(-100.0, likelihood.UNEXPLAINED_REACH_M, 60_001)
    density = np.exp(likelihood.log_density(x, np.array([60.0, 90.0, np.nan]), 5.0, 0.2))
    even = density[0]  # what nothing explains lies between 0 and UNEXPLAINED_REACH_M
    assert np.trapezoid(density - even, x) + even * likelihood.UNEXPLAINED_REACH_M == pytest.approx(1.0, abs=1e-3)


def test_a_block_that_is_caught_stops_anywhere_on_its_way():
    found = Forecast(np.full((1, 20_000), 80.0), np.full((1, 20_000), 0.1), np.full((1, 20_000), 0.3))
    draws = found.draws_m(np.random.default_rng(1))[0]
    early = draws[draws < 79.0]
    assert len(early) / len(draws) == pytest.approx(0.3 * 79 / 80, abs=0.01)
    assert stats.kstest(early, stats.uniform(0.0, 79.0).cdf).pvalue > 1e-3


def test_the_posterior_is_that_of_the_smooth_likelihood():
    """Noisy values of a normal log-likelihood of ten releases, in one of two unknowns: the draws have its mean and its
    spread."""
    rng = np.random.default_rng(3)
    u = stats.qmc.Sobol(2, seed=1).random_base2(6)
    exact = -0.5 * ((u[:, 0] - 0.4) / 0.1) ** 2
    each = np.tile((exact + rng.normal(0, 0.5, len(u)))[:, None] / 10, 10)
    drawn = likelihood.drawn_posterior(likelihood.SimulatedSoils(u, each), np.arange(10), rng, 400)
    assert drawn[:, 0].mean() == pytest.approx(0.4, abs=0.04)
    assert drawn[:, 0].std() == pytest.approx(0.1, rel=0.35)
    assert stats.kstest(drawn[:, 1], "uniform").statistic < 0.2


def releases_of(distances: np.ndarray) -> FieldReleases:
    n = len(distances)
    stops = np.column_stack([distances, np.zeros(n)])
    return FieldReleases(tuple(map(str, range(n))), ("a", "b") * (n // 2), np.zeros((n, 2)), stops)


def test_a_true_forecast_covers_what_it_says():
    rng = np.random.default_rng(5)
    n = 1000
    centre = rng.uniform(50, 150, n)
    releases = releases_of(centre + rng.normal(0, 6, n))
    true = Forecast(np.tile(centre[:, None], (1, 200)), np.full((n, 200), 6.0), np.zeros((n, 200)))
    table = score_table(releases, {"true": PartForecast(np.arange(n), true)}, np.arange(60.0, 150, 10), rng)
    whole = table[table["block"] == "all"].iloc[0]
    assert whole["inside80"] == pytest.approx(0.8, abs=0.04)
    assert whole["inside90"] == pytest.approx(0.9, abs=0.03)
    assert whole["log_score"] == pytest.approx(-0.5 - np.log(6 * np.sqrt(2 * np.pi)), abs=0.08)
    assert whole["passing_rmse"] < 3 * whole["rmse_floor"]


def test_every_release_is_in_one_fold_and_folds_share_the_blocks():
    releases = releases_of(np.arange(40.0))
    parts = fold_indices(releases, 1)
    assert len(parts) == FOLDS and sorted(np.concatenate(parts)) == list(range(40))
    assert all(sum(releases.blocks[i] == "a" for i in part) == 4 for part in parts)


def test_the_naive_forecast_has_the_spread_of_what_it_repeats():
    measured = np.random.default_rng(2).normal(100, 8, 60)
    draws = naive_forecast(measured, 50).draws_m(np.random.default_rng(3)).ravel()
    middle = draws[draws > 60]
    assert np.median(middle) == pytest.approx(100, abs=2.5) and 6 < middle.std() < 12


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """Stops that the engine gives with a known soil, other seeds than any that are used below."""
    root = tmp_path_factory.mktemp("field")
    file = write_field(root, {"cube": [60.0] * 12 + [61.0], "box": [60.0] * 12 + [61.0]})
    scenario = load_scenario(file, root)
    starts = np.zeros((RELEASES, 2))
    names = tuple(map(str, range(RELEASES)))
    asked = FieldReleases(names, ("cube", "box") * (RELEASES // 2), starts, starts)
    metres = Descents(scenario, asked, 1, 99).simulated(scenario).metres[:, 0]
    started = np.isfinite(metres)
    assert started.mean() > 0.8
    of = {block: list(metres[asked.of_blocks(block) & started]) for block in ("cube", "box")}
    return write_field(root, of)


@pytest.fixture(scope="module")
def studied(field):
    said: list[str] = []
    scenario = load_scenario(field, field.parent)
    with pytest.MonkeyPatch.context() as own:
        own.setenv("XDG_CACHE_HOME", str(field.parent / "cache"))
        own.setattr(study, "FORECAST_SEEDS", FEW_SEEDS)
        own.setattr(command, "SHAPE_SOILS", FEW_SOILS)
        own.setattr(candidates, "CHANGES", dict(list(candidates.CHANGES.items())[:1]))
        tables = run_field_test(scenario, field.parent / "out", progress=False, effort=EFFORT, report=said.append)
    return field.parent / "out", tables, said


def test_a_study_finds_the_soil_and_predicts_the_other_block(studied):
    folder, tables, said = studied
    restitution = tables["posterior"]["model.soils.slope.restitution"]
    assert restitution.quantile(0.02) < TRUE_RESTITUTION < restitution.quantile(0.98)
    scores = tables["scores"].set_index(["forecast", "block"])
    assert scores.loc[("blocks, held out", "all"), "inside90"] > 0.7
    assert abs(scores.loc[("blocks, from cube", "box"), "median_error_m"]) < 15.0
    names = {path.name for path in folder.iterdir()}
    assert names == {
        *(f"{name}.csv" for name in tables), "field_test.json", "stops.png", "passing.png", "rock2d_result.json",
    }  # fmt: skip
    assert "effect of shape" in said[0] and not list(folder.parent.glob(".*"))


def test_a_change_of_the_model_gives_a_scenario_if_there_is_something_to_change(field):
    scenario = load_scenario(field, field.parent)
    changed = {name: candidates._changed(scenario, change) for name, change in candidates.CHANGES.items()}
    assert not changed["smooth ground"].roughness and set(changed["one soil"].terrain.zones) == {"slope"}
    assert changed["level ground beyond the stops"].field_test.beyond_deg == 0.0
    assert changed["discs instead of boulders"] is changed["sections a third less high"] is None  # the cube


def test_a_study_does_not_replace_another_unasked(studied, field):
    with pytest.raises(InputError, match="earlier run"):
        run_field_test(load_scenario(field, field.parent), studied[0], progress=False, effort=EFFORT)


def test_releases_without_stops_are_predicted_the_same_each_time(field, tmp_path, monkeypatch):
    """With soils that are simulated twice, and then with those that are kept."""
    scenario = load_scenario(field, field.parent)
    table = tmp_path / "asked.csv"
    table.write_text("release,block_id,release_x_m,release_y_m\nn1,1,0,0\nn2,2,0.5,1\n")
    found = []
    simulated = []
    monkeypatch.setattr(study, "FORECAST_SEEDS", FEW_SEEDS)
    monkeypatch.setattr(study, "simulate_soils", lambda *own: simulated.append(1) or likelihood.simulate_soils(*own))
    for name, cache in (("one.csv", "first"), ("two.csv", "second"), ("three.csv", "first")):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / cache))
        predict_releases(scenario, table, tmp_path / name, progress=False, effort=LEAST)
        found.append((tmp_path / name).read_text())
    assert found[0] == found[1] == found[2]
    assert len(simulated) == 2 * (1 + len(likelihood.ROUND_POWERS))
    predicted = pd.read_csv(tmp_path / "one.csv")
    assert list(predicted.columns) == ["release", *QUANTILE_NAMES] and list(predicted["release"]) == ["n1", "n2"]
    quantiles = predicted[list(QUANTILE_NAMES)].to_numpy()
    assert (np.diff(quantiles, axis=1) >= 0).all() and (quantiles > 0).all()
    with pytest.raises(InputError, match="exists; --overwrite replaces it"):
        predict_releases(scenario, table, tmp_path / "one.csv", progress=False, effort=LEAST)
    with pytest.raises(InputError, match="writes a table"):
        predict_releases(scenario, table, tmp_path / "out", progress=False, effort=LEAST)
