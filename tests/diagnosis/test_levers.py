"""Dependences that no effect explains: what acts in a film is found, under its name."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.diagnosis.data import Residuals
from rock2d.diagnosis.fitting import Fit, fit
from rock2d.diagnosis.learnt import LEAST_GAIN
from rock2d.diagnosis.levers import find_dependences
from rock2d.diagnosis.linear_model import LinearModel
from rock2d.diagnosis.model import Model
from rock2d.diagnosis.quantities import HISTORY, IMPACT_DEPENDENCES, bases, history_quantities
from tests.kinematics.synthetic_films import START, base_fit, effects, film, series_order, with_causes, world

RELEASES = 16


def _fitted(effect: str | None, values: list[float]) -> tuple[Fit, Fit, object]:
    """The base law, and the law with the effect, fitted to a film in which the effect is at work."""
    causes = {effect: values} if effect else {}
    data, base = base_fit(film(with_causes(world(series_order(RELEASES)), causes), RELEASES, seed=4))
    full = Model(base.model.setup, START, list(effects(*causes).values()))
    start = np.concatenate([base.p, full.start()[len(base.p) :] + 0.05])
    return base, fit(full, data, start) if effect else base, data


@pytest.mark.parametrize(
    ("effect", "values", "name", "errors"),
    # compaction in films of other seeds: always found first, at 1.5 to 3.9 standard errors
    [("soil_compaction", [0.15, 0.0, 0.0], "law of series", 1.0), ("air_drag", [0.3], "flight of velocity", 3.0)],
)
def test_a_dependence_is_found_where_it_is_and_gone_once_it_is_modelled(effect, values, name, errors):
    base, full, data = _fitted(effect, values)
    kind = name.split(" of ")[0]
    found = next(d for d in find_dependences(base, data) if d.name.startswith(kind))
    remaining = find_dependences(full, data)[0]
    assert found.name == name
    assert found.total > max(errors * found.error, LEAST_GAIN)
    assert remaining.total < max(0.1 * found.total, LEAST_GAIN)  # nothing that would be learnt


def test_nothing_is_found_in_a_film_of_the_law_itself():
    base, _, data = _fitted(None, [])
    for found in find_dependences(base, data):
        assert found.total < 3.0 * max(found.error, 1.0)


def test_columns_that_the_model_has_already_gain_nothing_and_chance_gains_nothing():
    base, _, data = _fitted(None, [])
    linear, rng = LinearModel(base, data), np.random.default_rng(0)
    own = Residuals(base.jacobian.impacts[..., :1], base.jacobian.flights[..., :1])
    assert abs(linear.best_gain(own)[0].sum()) < 1.0
    spread = base.residuals.impacts.std(axis=0)
    none = np.zeros((*base.residuals.flights.shape, 3))
    shape = (*base.residuals.impacts.shape, 3)
    by_chance = [Residuals(spread[:, None] * rng.normal(size=shape), none) for _ in range(20)]
    assert np.mean([linear.best_gain(columns, [0.1])[0].sum() for columns in by_chance]) < 1.0


def test_a_parameter_that_few_impacts_determine_does_not_change_what_chance_gains():
    """A law can be nearly discontinuous for a few impacts: a pull may just hold a block."""
    base, _, data = _fitted(None, [])
    rng, impacts = np.random.default_rng(5), base.jacobian.impacts.copy()
    impacts[3:5, :, 0] *= 1e4
    steep = replace(base, jacobian=replace(base.jacobian, impacts=impacts))
    spread, none = base.residuals.impacts.std(axis=0), np.zeros((*base.residuals.flights.shape, 2))
    column = Residuals(spread[:, None] * rng.normal(size=(*base.residuals.impacts.shape, 2)), none)
    of_base, of_steep = (np.quantile(LinearModel(own, data).chance_gains(column), [0.1, 0.99]) for own in (base, steep))
    assert np.abs(of_base - of_steep).max() < 1.0  # log likelihood
    assert of_steep[1] < 6.0


def test_history_counts_the_impacts_of_each_release_in_time():
    found = history_quantities(np.array([0, 1, 0, 1, 1]), np.zeros(5), np.array([0.3, 0.1, 0.1, 0.2, 0.5]))
    assert found[HISTORY].tolist() == [1, 0, 0, 1, 2]
    # all releases at one place of the series
    assert "series" not in bases(IMPACT_DEPENDENCES, _quantities(found))


def _quantities(known: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    names = {quantity for parts in IMPACT_DEPENDENCES.values() for quantity, _ in parts}
    return dict.fromkeys(names, np.zeros(5)) | known
