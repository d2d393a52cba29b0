"""Impacts far from the model: are there more than the model would make itself?

The likelihood is robust, because a few impacts fall on the other side of an edge. So a cause that changes some impacts
completely, and others not at all, hardly counts in it. In a replicate each impact is simulated again, with drawn noise
of the camera and drawn soil: it shows how many impacts the model itself puts far away. The law of a true cause may have
another form than that of the catalogue. In one impact it then acts as this law with another size, so an impact that is
near the model with a cause of another size is not far."""

from collections.abc import Iterator

import numpy as np
from scipy.special import gammainc

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.derivatives import drawn_impacts, square_roots, times_normal
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.likelihood import chi_square
from rock2d.diagnosis.model import BASE_WIDTH, Model, choice_positions

FAR = 5.0  # root mean square of the residuals, in standard deviations, from which on an impact is far from the model
SIMULATED_REPLICATES = 20
# Factor by which more impacts may be far than in the replicates, and further number of them: the track is not exact.
# Share that the causes may leave of those that they explain: the forms of their laws are not exact, either.
MORE, FURTHER, LEFT_BY_FORMS = 2.0, 1.0, 0.25
OTHER_SIZES = (0.5, 0.7, 1.4, 2.0)  # factors on the size of a cause that stand for other forms of its law


def far_impacts(data: Data, base: Fit, fit: Fit, rng: np.random.Generator) -> tuple[Array, Array, float]:
    """(n,) whether each impact of the data is far from a fitted model; (SIMULATED_REPLICATES,) number of those that are
    in replicates; and the probability that as many are if the model is right, up to MORE, FURTHER and LEFT_BY_FORMS.

    `base`: the base law without causes"""
    covariance, limit = fit.covariance(), FAR**2 * fit.residuals.impacts.shape[1]
    far, far_of_base = (chi_square(own.residuals.impacts, own.covariance()) > limit for own in (fit, base))
    replicates = np.array([(chi_square(r, covariance) > limit).sum() for r in _simulated_again(data, fit, rng)])
    explained = max(float(far_of_base.sum() - far.sum()), 0.0)
    expected = MORE * float(replicates.mean()) + FURTHER + LEFT_BY_FORMS * explained
    for p in _with_other_sizes(fit.model, fit.p):
        if far.any():
            far &= chi_square(fit.model.residuals(p, data).impacts, covariance) > limit
    # share of a Poisson distribution
    return far, replicates, float(gammainc(far.sum(), expected))


def _with_other_sizes(model: Model, p: Array) -> Iterator[Array]:
    """Parameters at which one cause of the motion is smaller or larger, from no effect (0) on the scale of `Model`."""
    low, high = model.bounds()
    for effect in model.effects:
        own = np.zeros(model.size, bool)
        own[model.positions[effect.name]] = not (effect.camera or effect.scatter)
        own[choice_positions(model)] = False
        for factor in OTHER_SIZES if own.any() else ():
            yield np.where(own, np.clip(factor * p, low, high), p)


def _simulated_again(data: Data, fit: Fit, rng: np.random.Generator) -> Iterator[Array]:
    """(n, d) residuals of each replicate: the difference of impacts with drawn noise and soil from those without."""
    first = len(BASE_WIDTH)
    expected = fit.model.residuals(fit.p, data).impacts
    noise_before = square_roots(data.state_noise(fit.model.world(fit.p, data.impact_order)))
    noise_after = square_roots(data.outcome_noise())
    further = fit.jacobian.scatter[..., first:] * fit.scatter[first:]  # of effects that widen the scatter
    for _ in range(SIMULATED_REPLICATES):
        shift = times_normal(noise_before, rng)
        soil = fit.scatter[:first] * rng.normal(size=(len(expected), first))
        again = expected - drawn_impacts(fit.model, fit.p, data, soil, shift) + times_normal(noise_after, rng)
        yield again + times_normal(further, rng)
