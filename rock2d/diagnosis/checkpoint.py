"""Fits on disk, so that an interrupted diagnosis can continue: plain arrays, one file for each fit."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from rock2d.diagnosis.cross_validation import HeldOut
from rock2d.diagnosis.data import Residuals
from rock2d.diagnosis.derivatives import Slopes
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.model import Model
from rock2d.files.folders import atomic_file

Array = np.ndarray


def save_fit(path: Path, fit: Fit, out: HeldOut) -> None:
    """Write a fit and its held-out residuals; whole or not at all."""
    with atomic_file(path) as partial, open(partial, "wb") as file:
        np.savez(
            file, p=fit.p, p_covariance=fit.p_covariance, scatter=fit.scatter, slope_impacts=fit.slope.impacts,
            slope_flights=fit.slope.flights, slope_scatter=fit.slope.scatter, covariance=fit.slope.covariance,
            impacts=fit.residuals.impacts, flights=fit.residuals.flights, out_impacts=out.residuals.impacts,
            out_flights=out.residuals.flights, score=out.score,
        )  # fmt: skip


def load_fit(path: Path, model: Model) -> tuple[Fit, HeldOut] | None:
    """Read what `save_fit` wrote; None if there is no readable file."""
    try:
        with np.load(path, allow_pickle=False) as found:
            a = dict(found)
    except (OSError, ValueError, zipfile.BadZipFile):
        return None
    slope = Slopes(a["slope_impacts"], a["slope_flights"], a["slope_scatter"], a["covariance"])
    residuals = Residuals(a["impacts"], a["flights"])
    fit = Fit(model, a["p"], a["p_covariance"], a["scatter"], slope, residuals)
    return fit, HeldOut(Residuals(a["out_impacts"], a["out_flights"]), a["score"])
