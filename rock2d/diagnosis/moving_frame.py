"""A frame that moves differently in each release: a camera that slides or is touched, or ground that gives way.

Over the releases such motions can cancel, so no dependence on measured quantities shows them. But they move all impacts
of a release together. Each release has a motion of its own, whose components are normal with mean 0 and a common
standard deviation. The gain is the log of the marginal likelihood of the releases (Laplace's method at the best motion
of each) over that without motion; the standard deviation is the best one of other releases."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.cross_validation import FOLDS, folds, summed
from rock2d.diagnosis.data import Data, FilmData
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.levers import FRAME, Dependence, Levers
from rock2d.diagnosis.likelihood import LARGEST_CHI_SQUARE, chi_square, impact_weight, log_likelihood
from rock2d.diagnosis.model import state_units
from rock2d.diagnosis.quantities import TIME_S, Basis
from rock2d.records.columns import LINEAR_VELOCITY, N_STATE, POSITION, VX, X

RELEASE = Basis("release", ())  # what such a motion depends on
TRIED_SIZES = np.geomspace(1e-4, 1.0, 17)  # standard deviations, in half block sizes, or these per √(half size / g)
STEPS = 10  # of reweighted least squares for the motions
LARGEST_COMMON_SHARE = 0.5  # share of the gain that one motion of all releases may gain
MOTIONS = 2  # tried: a shift and a slide


def frame_of_each_release(fit: Fit, data: Data) -> Dependence:
    """The gain of a shift or a slide, along x and y, that differs from release to release; the larger of the two.

    It is 0 if one motion of all releases gains half as much: that is a ground at another place; and for an impact table
    and a law that is not fitted.
    The dependence's `width` is the standard deviation that gains most, in the units of `TRIED_SIZES`."""
    if not (fit.free and isinstance(data, FilmData) and len(data.impacts)):
        return Dependence(FRAME, RELEASE, np.zeros(len(data.order)), 0.0)
    levers, found = Levers(fit, data), list[Dependence]()
    units = state_units(levers.world)
    time = levers.impact_quantities[TIME_S][:, None, None]
    for slides in (False, True):
        motion = np.zeros((len(time), N_STATE, 2))
        motion[:, POSITION] = (time * units[VX] if slides else units[X]) * np.eye(2)
        motion[:, LINEAR_VELOCITY] = slides * units[VX] * np.eye(2)
        moved = _Moved.of(fit, data, levers.columns(levers.moved(motion)).impacts)
        gain = np.array([moved.marginal_gain(sd) for sd in TRIED_SIZES])
        total = gain.sum(axis=1)
        differs = moved.common_gain() < LARGEST_COMMON_SHARE * total.max()
        gain = differs * _of_other_releases(gain, folds(data))
        found.append(Dependence(FRAME, RELEASE, gain, float(TRIED_SIZES[total.argmax()])))
    return max(found, key=lambda dependence: dependence.total)


class _Moved(NamedTuple):
    """Impacts that a motion of the frame can change.

    Attributes
    ----------
    r, covariance, columns : (n, d), (n, d, d), (n, d, 2) residuals, their covariances, and derivatives by the motion
    release : (n,)
    releases : their number"""

    r: Array
    covariance: Array
    columns: Array
    release: Array
    releases: int

    @classmethod
    def of(cls, fit: Fit, data: FilmData, columns: Array) -> _Moved:
        """The impacts of a fit that can be simulated."""
        r, covariance = fit.residuals.impacts, fit.covariance()
        own = chi_square(r, covariance) < LARGEST_CHI_SQUARE
        return cls(r[own], covariance[own], columns[own], data.impact_release[own], len(data.order))

    def left(self, motion: Array) -> Array:
        """(n, d) residuals with a motion (releases, 2)."""
        return self.r + np.einsum("nik,nk->ni", self.columns, motion[self.release])

    def motions(self, precision: float) -> tuple[Array, Array]:
        """(releases, 2) most probable motions under a normal prior, by reweighted least squares, and (releases, 2, 2)
        the curvature of the likelihood."""
        motion, curvature = np.zeros((self.releases, 2)), np.zeros((self.releases, 2, 2))
        pulled = np.linalg.solve(self.covariance, self.columns)
        for _ in range(STEPS):
            weight = impact_weight(chi_square(self.left(motion), self.covariance), self.r.shape[1])
            curvature = summed(self.release, np.einsum("n,nik,nil->nkl", weight, self.columns, pulled), self.releases)
            pull = summed(self.release, np.einsum("n,nik,ni->nk", weight, pulled, self.r), self.releases)
            motion = -np.linalg.solve(curvature + precision * np.eye(2), pull[..., None])[..., 0]
        return motion, curvature

    def common_gain(self) -> float:
        """Gain in log likelihood of a motion that all releases share."""
        alone = self._replace(release=np.zeros_like(self.release), releases=1)
        return float(alone.gain(alone.motions(TRIED_SIZES[-1] ** -2.0)[0]).sum())

    def gain(self, motion: Array) -> Array:
        """(releases,) gain in log likelihood of a motion (releases, 2)."""
        before, after = (log_likelihood(r, self.covariance) for r in (self.r, self.left(motion)))
        return summed(self.release, after - before, self.releases)

    def marginal_gain(self, sd: float) -> Array:
        """(releases,) gain in log marginal likelihood of motions with this standard deviation.

        The weights of the likelihood count as constant in its curvature, so the gain is a little too small."""
        motion, curvature = self.motions(sd**-2.0)
        volume = np.linalg.slogdet(np.eye(2) + sd**2 * curvature)[1]
        return np.asarray(self.gain(motion) - 0.5 * (motion**2).sum(axis=1) / sd**2 - 0.5 * volume)


def _of_other_releases(gain: Array, fold: Array) -> Array:
    """(releases,) gain (sizes, releases) at the size that gains most in the other folds; 0 if none gains there."""
    chosen = np.zeros(gain.shape[1])
    for k in range(FOLDS):
        total = gain[:, fold != k].sum(axis=1)
        if total.max(initial=0.0) > 0.0:
            chosen[fold == k] = gain[total.argmax(), fold == k]
    return chosen
