"""Dependences that no effect explains: what acts in a film is found, under its name."""

from __future__ import annotations

import numpy as np
import pytest

from rock2d.diagnosis.discrepancy import _best_gain, discrepancies
from rock2d.diagnosis.features import history_groups, standardised
from rock2d.diagnosis.film_data import FilmData
from rock2d.diagnosis.fitting import Fit, fit
from rock2d.diagnosis.likelihood import IMPACT_STUDENT_DF
from rock2d.diagnosis.model import Model
from rock2d.effects import catalogue
from rock2d.kinematics.flights import load_film
from rock2d.kinematics.setup_world import setup_world
from tests.kinematics.synthetic_films import film, series_order, world

RELEASES = 16


def _fitted(effect: str | None, values: list[float]) -> tuple[Fit, Fit, object]:
    """The base law, and the law with the effect, fitted to a film in which the effect is at work."""
    true = world(series_order(RELEASES))
    known = catalogue()
    if effect is not None:
        true = known[effect].apply(true, values)
    experiment = film(true, RELEASES, seed=4)
    setup = setup_world(experiment)
    data = FilmData.of(load_film(experiment), setup)
    start = np.array([1e4, 6.0, 2.5e3, np.tan(np.pi / 6), 0.025])
    base = fit(Model(setup, start), data)
    if effect is None:
        return base, base, data
    full = Model(setup, start, [known[effect]])
    return base, fit(full, data, np.concatenate([base.p, full.start()[len(base.p) :] + 0.05])), data


@pytest.mark.parametrize(
    ("effect", "values", "name"),
    [("soil_compaction", [0.06, 0.0], "law of series"), ("air_drag", [0.3], "flight of velocity")],
)
def test_a_dependence_is_found_where_it_is_and_gone_once_it_is_modelled(effect, values, name):
    base, full, data = _fitted(effect, values)
    kind = name.split(" of ")[0]
    found = next(d for d in discrepancies(base, data) if d.name.startswith(kind))
    remaining = discrepancies(full, data)[0]
    assert found.name == name
    assert found.total > 3.0 * found.error
    assert remaining.total < 0.1 * found.total


def test_nothing_is_found_in_a_film_of_the_law_itself():
    base, _, data = _fitted(None, [])
    for found in discrepancies(base, data):
        assert found.total < 3.0 * max(found.error, 1.0)


def test_the_gain_is_that_of_the_columns_and_none_of_what_the_model_has_already():
    rng = np.random.default_rng(0)
    n, weight, fold = 400, np.ones(400), np.arange(400) % 4
    own, x = rng.normal(size=(n, 6, 2)), rng.normal(size=(n, 6, 1))
    noise = rng.normal(size=(n, 6))
    heavy = noise / np.sqrt(
        rng.chisquare(IMPACT_STUDENT_DF, (n, 1)) / IMPACT_STUDENT_DF
    )  # as the law of likelihood has it
    z = 0.05 * own[..., 0] + 0.3 * x[..., 0] + heavy
    chance = np.mean([_best_gain(z, own, rng.normal(size=(n, 6, 3)), weight, fold).sum() for _ in range(20)])
    assert _best_gain(z, own, x, weight, fold).sum() > 20.0
    assert abs(chance) < 2.0
    assert abs(_best_gain(z, own, own[..., :1], weight, fold).sum()) < 1.0


def test_features_are_standardised_and_constant_ones_dropped():
    features = np.column_stack([np.arange(10.0), np.full(10, 3.0)])
    kept = standardised(features)
    assert kept.shape == (10, 1)
    assert kept.mean() == pytest.approx(0.0, abs=1e-12) and kept.std() == pytest.approx(1.0)


def test_history_counts_the_impacts_of_each_release_in_time():
    groups = history_groups(np.array([0, 1, 0, 1, 1]), np.zeros(5), np.array([0.3, 0.1, 0.1, 0.2, 0.5]))
    number = groups["history"][:, 0]
    assert np.argsort(number, kind="stable").tolist() == [1, 2, 0, 3, 4]
    assert groups["series"].shape == (5, 0)  # all releases at one place of the series: nothing to depend on
