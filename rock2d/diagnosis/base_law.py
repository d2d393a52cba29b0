"""The base law: the paper's law with its own parameters refitted, and the image in which the film is divided for it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data, FilmData
from rock2d.diagnosis.exploring import REFIT_GAIN, grid_starts
from rock2d.diagnosis.fitting import FEW_ROUNDS, Convergence, Fit, extended, fit, some_releases
from rock2d.diagnosis.model import BASE_WIDTH, Model
from rock2d.diagnosis.workload import BASE
from rock2d.effects import catalogue
from rock2d.laws.contact import ROLLING_IN_INDENTATION
from rock2d.processes import Processes
from rock2d.progress import Bar, Bars
from rock2d.scene.world import World

# effects whose fit to all flights, impacts and rests locates the ground: in a turned and scaled image, or as built
# (gravity in flights tells which); and effects that imitate them in flights and at rest
REGISTERED = (("camera_tilt", "scale_error"), ("geometry_error",))
IMITATES_REGISTERED = ("flight_damping", "angle_offset")
MOST_REGISTRATIONS = 2
REGISTERED_Z = 5.0  # standard errors that one of their parameters must have
LEAST_CHANGED_FLIGHTS = 0.02  # relative change of the number of flights that they must cause
# gain in log likelihood of a step below which a fit that locates the ground has converged
REGISTERED_GAIN = 3.0
NOISE_RENEWALS = 2  # the noise depends on the soil's scatter, which depends on the noise
SAME_FIT = 3.0  # standard errors within which a fit from a grid leads back to the known one


def fit_base(setup: World, start: Array, data: Data, registered: World | None = None, bars: Bars | None = None) -> Fit:
    """The paper's law with its own parameters refitted: the base law.

    The fit explores a coarse grid around `start` on some releases and then fits all of them. Both readings of the
    rolling resistance are tried (`ContactParameters.rolling_in_indentation`); the better one stays in the set-up.

    If the film was segmented in another world than the stated one (`registered`), the law is fitted there and used
    without a further fit on the stated set-up, where blocks would fall into the ground. The gains of effects over such
    a base do not measure their size."""
    bars = bars or Bars(False)
    if not len(data.impact_release):  # the data do not show the law: it stays as stated
        flown = [name for b, name in enumerate(setup.blocks) if b in data.flight_block]
        return fit(Model(setup, start, flown=flown), data)
    with bars.stage(BASE, 3, "fits") as bar:
        best = fit_from_grid(Model(registered or setup, start), data, Processes(1, (data,)), bar)
        assert best is not None
    if registered is None:
        return best
    stated = Model(replace(setup, contact=best.model.setup.contact), start)
    return replace(fit(stated, data, best.p, convergence=Convergence(np.inf)), free=False)


def fit_from_grid(
    model: Model, data: Data, processes: Processes, bar: Bar | None = None, known: Fit | None = None
) -> Fit | None:
    """The best fit of a model whose law starts from the points of a grid, with either reading of the rolling
    resistance.

    `known`: a fit of the model, whose effects are the start. The result is None if the grid leads back to it; the noise
    of the known fit is sufficient to see that."""
    fits_of_reading = dict[int, list[Fit]]()
    jobs = [(model, reading, known) for reading in (0.0, 1.0)]
    for k, fits in processes.as_finished(_fits_from_grid, jobs):
        fits_of_reading[k] = fits
        if bar is not None:
            bar.step("some releases")
    best = max((fitted for k in sorted(fits_of_reading) for fitted in fits_of_reading[k]), key=Fit.total)
    if known is not None:
        convergence = Convergence(rival_total=known.total() + REFIT_GAIN)
        best = fit(best.model, data, best.p, old=known, convergence=convergence)
        if ends_at(best, known, SAME_FIT):
            return None
    best = fit(best.model, data, best.p)
    if bar is not None:
        bar.step("all releases")
    for _ in range(NOISE_RENEWALS):
        best = fit(best.model, data, best.p, old=best, renew_noise=True, residuals=best.residuals)
    return best


def _fits_from_grid(data: Data, model: Model, reading: float, known: Fit | None) -> list[Fit]:
    """Short fits to some releases from the best points of a grid, with one reading of the rolling resistance."""
    keep = some_releases(data)
    some, effect_start = data.only(keep), np.empty(0)
    if known is not None:
        effect_start = known.p[len(BASE_WIDTH) :]
        known = known.only(keep, data)
    rows = model.setup.contact.copy()
    rows[..., ROLLING_IN_INDENTATION] = reading
    model = replace(model, setup=replace(model.setup, contact=rows))
    starts = grid_starts(model, some, [effect_start])
    return [fit(model, some, p, old=known, convergence=FEW_ROUNDS) for p in starts]


def register_by_fit(base: Fit, data: FilmData) -> tuple[FilmData, World] | None:
    """Segment the film again in an image that is turned and scaled to fit its flights and impacts, or over a ground
    that is built to fit them: the one that fits better.

    Returns the film and the world with this image or ground, or None if the number of flights hardly changes. If the
    stated ground is not where the blocks strike it, some impacts are missed, and flights are cut short."""
    registered, setup = None, base.model.setup
    noise_of: Fit | None = base
    models = [_registered_model(base, names) for names in REGISTERED]
    starts = [extended(base, model) for model in models]
    for _ in range(MOST_REGISTRATIONS):
        convergence = Convergence(REGISTERED_GAIN)
        fits = [fit(model, data, p, noise_of, convergence) for model, p in zip(models, starts, strict=True)]
        best = int(np.argmax([fitted.total() for fitted in fits]))
        found, names = fits[best], REGISTERED[best]
        own = slice(len(BASE_WIDTH), found.model.positions[names[-1]].stop)
        if (np.abs(found.p) / np.sqrt(np.diag(found.p_covariance)))[own].max() < REGISTERED_Z:
            break
        world = setup
        for effect, values in zip(found.model.effects[: len(names)], found.model.values(found.p), strict=False):
            world = effect.apply(world, values)
        again = FilmData.of(replace(data.film), world)
        more = abs(len(again.flight_release) - len(data.flight_release))
        converged = more < LEAST_CHANGED_FLIGHTS * len(data.flight_release)
        if not converged or registered is not None:  # the last fit knows the most impacts
            registered = again, world
        if converged:
            break
        data, starts, noise_of = again, [fitted.p for fitted in fits], None
    return registered


def _registered_model(base: Fit, names: Sequence[str]) -> Model:
    # different scales along x and y would take up what the law of impacts misses
    effects = [catalogue()[name].without_refinement() for name in (*names, *IMITATES_REGISTERED)]
    return Model(base.model.setup, base.model.base, effects)


def ends_at(found: Fit, known: Fit, errors: float = 1.0) -> bool:
    """Whether a fit ended where a known one did: within its standard `errors`, and with hardly more likelihood."""
    near = np.abs(found.p - known.p) < errors * np.sqrt(np.diag(known.p_covariance))
    return bool(near.all()) and found.total() < known.total() + 0.5 * REFIT_GAIN
