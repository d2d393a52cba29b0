"""Predictive checks: a true model passes as often as stated, and what is wrong is named."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.diagnosis import checks
from rock2d.diagnosis.checks import FALSE_ALARMS, far_impacts, predictive_checks
from rock2d.diagnosis.cross_validation import Validated, held_out_gain
from rock2d.diagnosis.data import FilmData, Residuals
from rock2d.diagnosis.fitting import Convergence, Fit, extended, fit
from rock2d.diagnosis.likelihood import fit_scatter, normal_equations
from rock2d.diagnosis.model import Model, to_scale
from rock2d.diagnosis.report.sections import checks_sentence
from rock2d.effects import catalogue
from rock2d.kinematics.setup_world import base_law_start
from tests.kinematics.synthetic_films import base_fit, data_of, film, series_order, with_causes, world

RELEASES = 20  # per block
FILMS = 60  # draws of residuals; would miss false alarms at twice the stated rate


@pytest.fixture(scope="module")
def fitted() -> tuple[FilmData, Fit]:
    """A film of the base law, and the base law fitted to it."""
    experiment = film(world(series_order(RELEASES)), RELEASES, seed=3, fps=500.0)
    return base_fit(experiment, base_law_start(experiment))


def drawn(own: tuple[FilmData, Fit], seed: int, **shifts: np.ndarray) -> Fit:
    """The fit as a true model would have it: residuals drawn from it, plus shifts in standard deviations, after what
    its parameters absorb."""
    _, found = own
    rng = np.random.default_rng(seed)
    covariance = found.covariance()
    (n, d), shape = found.residuals.impacts.shape, found.residuals.flights.shape
    heavy = np.sqrt(rng.chisquare(4.0, (n, 1)) / 4.0)
    impacts = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(size=(n, d)) / heavy)
    if "spin" in shifts:
        impacts[:, 5] += shifts["spin"] * np.sqrt(covariance[:, 5, 5])
    impacts *= shifts.get("factor", np.ones(n))[:, None]
    flights = rng.normal(size=shape)
    if "bend" in shifts:
        flights[: own[0].flown, 1, 0] += shifts["bend"]
    scatter = found.scatter
    for _ in range(4):
        residuals = Residuals(impacts, flights)
        scatter = fit_scatter(impacts, found.jacobian, np.maximum(scatter, 3e-3))
        left = replace(found, residuals=residuals, scatter=scatter)
        curve, grad = normal_equations(residuals, found.jacobian, left.covariance())
        step = np.linalg.solve(curve + 1e-9 * np.diag(np.diag(curve)), grad)
        impacts, flights = impacts - found.jacobian.impacts @ step, flights - found.jacobian.flights @ step
    return replace(found, residuals=Residuals(impacts, flights), scatter=scatter)


def failed(own: tuple[FilmData, Fit], left: Fit) -> dict[str, str]:
    """Name of each check that fails -> the largest pattern."""
    return {c.name: c.largest for c in predictive_checks(own[0], own[1], left, 0).all if c.fails}


def test_true_model_fails_as_often_as_stated(fitted, monkeypatch):
    monkeypatch.setattr(checks, "REPLICATES", 500)
    found = [predictive_checks(fitted[0], fitted[1], drawn(fitted, seed), seed) for seed in range(FILMS)]
    for p in (np.array([own.p for own in found]), np.array([min(c.p_of_all for c in own.spreads) for own in found])):
        assert (p < FALSE_ALARMS).mean() < 0.12
        assert 0.3 < np.median(p) < 0.7


@pytest.fixture(scope="module")
def soiled(fitted) -> tuple[FilmData, Fit, Fit]:
    """The film with slow errors of the track that are three times the noise of its states, and its fit without and
    with one and a half such errors that all releases share."""
    film_data, _ = fitted
    slow = np.where((film_data.flights.follows >= 0)[:, None], 3.0, 0.0) * np.ones(3)
    data = replace(film_data, slow=slow)
    found = fit(Model(fitted[1].model.setup, fitted[1].model.base), data)
    shift = data.slow_outcomes() @ [0.0, 1.5, 0.0, 0.0, -1.5, 0.0]
    return data, found, replace(found, residuals=Residuals(found.residuals.impacts + shift, found.residuals.flights))


def test_a_slow_error_that_all_releases_share_fails_no_check(soiled):
    data, found, shifted = soiled
    assert not any(c.fails for c in predictive_checks(data, found, shifted, 0).means)
    sure = replace(data, slow=np.zeros_like(data.slow))
    assert any(c.fails for c in predictive_checks(sure, found, shifted, 0).means)


def test_a_gain_that_a_shared_slow_error_makes_is_not_significant(soiled):
    data, found, shifted = soiled
    model, reference = (Validated.of(own, data) for own in (found, shifted))
    gain = held_out_gain(data, model, reference)
    assert gain.total > 10.0 and not gain.significant
    assert held_out_gain(replace(data, slow=np.zeros_like(data.slow)), model, reference).significant


def test_an_impact_that_cannot_be_simulated_adds_nothing_to_what_slow_errors_make(soiled):
    """Where a block begins inside the stated ground, nothing is compared: a turned picture gained thousands, ± more."""
    data, found, shifted = soiled
    model, reference = (Validated.of(own, data) for own in (found, shifted))
    lost = np.arange(len(data.impacts)) % 2 == 0
    reference.held_out.residuals.impacts[lost] = np.nan
    error = held_out_gain(data, model, reference).shared_error
    model.held_out.residuals.impacts[lost] += 1e3
    assert 0.0 < held_out_gain(data, model, reference).shared_error == error


def test_shift_in_one_zone_is_named(fitted):
    zones = fitted[0].impact_zone
    out = failed(fitted, drawn(fitted, 1, spin=np.where(zones == np.bincount(zones).argmax(), 1.0, -1.0)))
    assert out["impacts by zone and place"].startswith("spin")


def test_flights_that_bend_are_named(fitted):
    data, _ = fitted
    out = failed(fitted, drawn(fitted, 2, bend=0.8 * data.unit_bends()))
    assert out["bend of flights"].startswith("y")
    assert not [name for name in out if name.startswith("spread")]


def test_block_that_scatters_more_is_named(fitted):
    out = failed(fitted, drawn(fitted, 3, factor=np.where(fitted[0].impact_block == 1, 3.0, 1.0)))
    assert set(out) == {"spread by zone and block"}


def test_few_impacts_are_far_from_a_true_law_and_as_many_as_it_says_itself(fitted):
    data, own = fitted
    far, replicates, p = far_impacts(data, own, own, np.random.default_rng(1))
    assert p > 0.05
    assert abs(far.sum() - replicates.mean()) < 4.0 * np.sqrt(replicates.mean() + 1.0)


def test_replicates_of_rough_ground_are_simulated(fitted):
    """A slope of 3° makes another corner strike first, far beyond what its derivatives say; a normal distribution with
    them has no impact at five standard deviations."""
    data, own = fitted
    model = Model(own.model.setup, own.model.base, [catalogue()["surface_roughness"]])
    found = fit(model, data, extended(own, model), convergence=Convergence(rounds=1))
    sd_rad, at = 0.05, model.positions["surface_roughness"].start
    p, scatter = found.p.copy(), found.scatter.copy()
    p[at] = scatter[-1] = to_scale(model.parameters[0][0], sd_rad)
    far = far_impacts(data, own, replace(found, p=p, scatter=scatter), np.random.default_rng(0))[1]
    assert far.min() > 5


def test_an_impact_that_another_size_of_a_cause_explains_is_not_far():
    """Edges rounded 1.4 times as much as the model says: that may be another form of its law. Without the effect in the
    model the same impacts are far."""
    experiment = film(
        with_causes(world(), {"rounded_edges": [0.3]}), 12, seed=8, fps=500.0, noise_m=3e-5, noise_rad=2e-3
    )
    setup, data = data_of(experiment)
    found = fit(Model(setup, base_law_start(experiment), [catalogue()["rounded_edges"]]), data)
    count = {}
    for share in (1.0, 1.0 / 1.4, 0.0):
        p = np.where(np.arange(len(found.p)) == found.model.positions["rounded_edges"].start, share * found.p, found.p)
        smaller = replace(found, p=p, residuals=found.model.residuals(p, data))
        count[share] = far_impacts(data, found, smaller, np.random.default_rng(0))[0].sum()
    assert count[1.0] <= count[1.0 / 1.4] <= 1 < 5 < count[0.0]


def test_an_unknown_cause_that_changes_few_impacts_completely_is_named(fitted):
    """No mean shows it: a robust mean leaves such impacts out, and they differ in sign."""
    data, own = fitted
    zones = data.impact_zone
    zone = int(np.bincount(zones).argmax())
    hit = np.flatnonzero(zones == zone)[::6]
    impacts = own.residuals.impacts.copy()
    impacts[hit, 5] += 30.0 * np.sqrt(own.covariance()[hit, 5, 5]) * np.resize([1.0, -1.0], len(hit))
    left = replace(own, residuals=Residuals(impacts, own.residuals.flights))
    found = predictive_checks(data, own, left, 0)
    out = {c.name: c.largest for c in found.all if c.fails}
    name = own.model.setup.cross_section.zone_names[zone]
    assert out["far impacts"] == f"{len(hit)} of {len(zones)}, most in {name}"
    assert found.p_outside > 0.9 and not [name for name in out if name in checks.IMPACT_MEANS]
    none = predictive_checks(data, own, own, 0)
    assert none.p_outside < 0.3


def test_same_seed_gives_the_same_checks_and_the_sentence_names_what_fails(fitted):
    left = drawn(fitted, 2, bend=0.8 * fitted[0].unit_bends())
    first, second = (predictive_checks(fitted[0], fitted[1], left, 5) for _ in range(2))
    assert first.content() == second.content()
    assert all(len(c["replicates"]) == 3 and 0.0 < c["p"] <= 1.0 for c in first.content())
    assert "bend of flights (y" in checks_sentence(first)
    passing = checks_sentence(predictive_checks(fitted[0], fitted[1], drawn(fitted, 4), 5))
    assert passing.endswith("as the model would make them")
