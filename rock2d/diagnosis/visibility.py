"""Effects that these data can show: those that change some residual by more than a small part of its noise; and fitted
sizes that are no answer, because they are negligible or impossible.

Flights alone do not show impacts, a table of impacts does not show the air, a ball without marks does not show its
spin. Effects that the data cannot show are not tried: they remain possible."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc  # scipy.stats takes over a second to import

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data, FilmData, Residuals
from rock2d.diagnosis.fitting import Fit, some_releases
from rock2d.diagnosis.likelihood import flight_weight, normal_equations, standard_deviations
from rock2d.diagnosis.model import BASE_WIDTH, Model, scatter_positions
from rock2d.effects.changes import POINT_PARAMETERS
from rock2d.effects.effect import Effect
from rock2d.kinematics.film_findings import SCALE_OR_RATE, FilmFindings
from rock2d.records.columns import X, Y

# effect -> the effect from which it differs only in the spin
SPIN_TWINS = {"flight_damping": "air_drag"}
# Effects whose first parameter turns the picture of ground without an embankment. If the sum of the two turns is less
# than this share of the larger one, only gravity is turned.
TURNS, LEAST_TURN = {"camera_tilt", "geometry_error"}, 0.25
# Smooth changes of the picture: they may follow what the form of any learnt change misses, up to `evidence.FORM_SHARE`
# of its gain, and what two other causes do.
DISTORTIONS = {"lens_distortion", "keystone_distortion"}
# A wrong scale or frame rate is none if first flights show less than this share of it, by so many standard errors.
LEAST_FIRST_SHARE, SURE_Z = 0.5, 2.0
LARGEST_UNSEEN_CHANGE = 0.05  # largest change of a residual, in standard deviations, that is not visible
# Sizes as shares of the plausible range on either side. A smaller effect is negligible unless its gain is large; an
# effect at the end of the range does not fit the data.
LEAST_SIZE, LARGEST_SIZE = 0.015, 0.999
BEYOND_Z = 2.0  # standard errors by which data pull a value beyond its range, if it is impossible
# standard errors from which on a small effect counts: of the image or ground, which may be slightly off, and any other
LARGE_GAIN_OF_IMAGE_Z, LARGE_GAIN_Z = 20.0, 8.0


def unseen(base: Fit, data: Data, effects: Mapping[str, Effect], film: FilmFindings | None) -> dict[str, str]:
    """Effect that these data cannot show -> reason. `film`: what the film says of itself."""
    some = some_releases(data)
    part = base.only(some, data)
    some_data = data.only(some).coarse()
    at = base.model.residuals(base.p, some_data)
    sd = standard_deviations(part.covariance())
    reasons = _unseen_without_spin(data, film)
    if not isinstance(data, FilmData) or not data.film.measured[[X, Y]].all():
        reasons["keystone_distortion"] = "only a film of both x and y shows it"
    reasons |= film.unjudged if film is not None else {}
    for name, effect in effects.items():
        if name not in reasons:
            model = replace(base.model, effects=[effect])
            in_flight = data.flown or effect.phase != "flight"
            if not (in_flight and _changes_residuals(model, base.p, some_data, at, sd)):
                reasons[name] = _reason_unseen(data, effect)
    return {name: reason for name, reason in reasons.items() if name in effects}


def _unseen_without_spin(data: Data, film: FilmFindings | None) -> dict[str, str]:
    """Effects that cannot be distinguished from others without a measured spin -> reason."""
    if not isinstance(data, FilmData) or data.film.angle_known.any():
        return {}
    reasons = {name: f"without the spin it cannot be told from {twin}" for name, twin in SPIN_TWINS.items()}
    if film is not None and film.spin_hides:
        reasons |= dict.fromkeys(SCALE_OR_RATE, "without the spin it cannot be told from its lift")
    return reasons


def _reason_unseen(data: Data, effect: Effect) -> str:
    """Reason why an effect does not change the data."""
    if not len(data.impact_release) and effect.phase == "impact":
        return "no impact can be judged"
    if not data.flown and effect.phase == "flight":
        return "no flight was recorded"
    if isinstance(data, FilmData) and not data.film.angle_known.any():
        return "the spin was not measured"
    return "no measured quantity changes with it"


def _changes_residuals(model: Model, p: Array, data: Data, at: Residuals, sd: Array) -> bool:
    """Whether some residual changes between no effect and one at the ends of its plausible range."""
    parameters = model.parameters[0]
    start = np.concatenate([p, model.start()[len(BASE_WIDTH) :]])
    for k, q in enumerate(parameters):
        for value in q.choices or (q.low, q.high):
            amounts = [[value if i == k else v for i, v in enumerate(model.values(start)[0])]]
            changed = model.residuals(start, data, amounts=amounts)
            changes = ((changed.impacts - at.impacts) / sd, changed.flights - at.flights)
            if any(np.abs(c).max(initial=0.0) > LARGEST_UNSEEN_CHANGE or np.isnan(c).any() for c in changes):
                return True
    return False


def only_gravity_is_turned(fit: Fit) -> bool:
    """Whether the turns of camera and ground cancel in the picture. Then only gravity has another direction there. So
    has it under a steady force along x, which is outside the catalogue."""
    model = fit.model
    if not model.positions.keys() >= TURNS or model.setup.cross_section.embankments:
        return False
    values = dict(zip(model.positions, model.values(fit.p), strict=True))
    turns = [values[name][0] for name in TURNS]
    return abs(sum(turns)) < LEAST_TURN * max(map(abs, turns))


def lost_in_first_flights(fit: Fit, data: Data, name: str) -> float:
    """Log likelihood that an effect that changes gravity in all flights alike costs in the first flights of the
    releases, if it is surely not there; else 0. From the change that it makes there and the residuals that are left.
    What acts near the ground, or in a band of the set-up, may look like another gravity in all others."""
    if not isinstance(data, FilmData):
        return 0.0
    neutral, first = fit.p.copy(), data.flights.follows < 0
    neutral[fit.model.positions[name]] = 0.0
    with_it, without = (
        data.observed(fit.model.world(p, data.impact_order)).flights[: data.flown][first] for p in (fit.p, neutral)
    )
    change, r = without - with_it, fit.residuals.flights[: data.flown][first]
    weight = flight_weight(r)
    square = float((weight * change**2).sum())
    shown = square + float((weight * change * r).sum())
    if shown + SURE_Z * np.sqrt(square) >= LEAST_FIRST_SHARE * square:
        return 0.0
    return 0.5 * (square - shown) ** 2 / square


def relative_size(fit: Fit, name: str) -> float:
    """Largest size among the parameters of an effect, see `_sizes`."""
    return float(_sizes(fit, name).max())


def _sizes(fit: Fit, name: str) -> Array:
    """Size of each parameter of an effect, as a share of the plausible range on its side.

    It is 1 for an effect that is a choice. It is 0 for what does not count: the points of the camera, a choice of the
    place where an effect acts, and optional parameters, which only refine an effect."""
    low, high = fit.model.bounds()
    sizes = []
    for k, parameter in enumerate(fit.model.parameters_of(name), fit.model.positions[name].start):
        refines = parameter in POINT_PARAMETERS or parameter.may_be_missing
        room = max(high[k] if fit.p[k] > 0.0 else -low[k], 1e-9)
        sizes.append(0.0 if refines else 1.0 if parameter.must_choose else abs(fit.p[k]) / room)
    return np.array(sizes)


def p_of_size(fit: Fit, name: str) -> float:
    """p value of the fitted size of an effect if there were no effect, from the covariance over releases (Wald's test
    of the parameters that count, see `_sizes`). 0 for a choice, and for a scatter, which has no sign."""
    counts, position = _sizes(fit, name) > 0.0, fit.model.positions[name]
    if position.start in scatter_positions(fit.model) or fit.model.parameters_of(name)[0].must_choose:
        return 0.0
    own = np.arange(position.start, position.stop)[counts]
    if not len(own):
        return 1.0
    square = fit.p[own] @ np.linalg.pinv(fit.p_covariance[np.ix_(own, own)], hermitian=True) @ fit.p[own]
    return float(chdtrc(len(own), square))


def is_negligible(effect: Effect, sizes: Sequence[float], gain_z: float) -> bool:
    """Whether an effect with these sizes, see `relative_size`, and a gain of `gain_z` standard errors is too small to
    matter. One with a large gain may be small, unless it only widens the scatter: any noise that is not modelled does
    so, and closes no gap."""
    large_z = LARGE_GAIN_OF_IMAGE_Z if effect.camera or effect.name in TURNS else LARGE_GAIN_Z
    return min(sizes) < LEAST_SIZE and (effect.scatter or gain_z < large_z)


def is_out_of_range(fit: Fit, name: str) -> bool:
    """Whether a parameter of an effect lies at the end of the plausible range, and the data clearly pull it beyond: by
    BEYOND_Z standard errors. Without a pull the value may well lie inside. A choice has no range, and a scatter counts
    as pulled, because its likelihood has no slope here."""
    at_end, position = _sizes(fit, name) > LARGEST_SIZE, fit.model.positions[name]
    if not at_end.any() or fit.model.parameters_of(name)[0].must_choose:
        return False
    if position.start in scatter_positions(fit.model):
        return True
    _, grad = normal_equations(fit.residuals, fit.jacobian, fit.covariance())
    pull = -grad * np.sign(fit.p) * np.sqrt(np.diag(fit.p_covariance))
    return bool(pull[position][at_end].max() > BEYOND_Z)
