"""The share of the gap that a diagnosis truly closes, measured on films that it did not see.

The base law and the model with all causes and learnt changes predict the held-out releases of a case. The gap
of a perfect model is known from the null twin, the same releases without the hidden causes: the base law, fitted to the
other twin, has there only the errors of noise, soil and form of the law. The gap is measured as in the diagnosis.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rock2d.blind.case_files import HELDOUT, TWIN, TWIN_FIT
from rock2d.diagnosis.base_law import fit_base
from rock2d.diagnosis.budget import ResidualSizes
from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.diagnose import Diagnosis, check_and_segment
from rock2d.diagnosis.learnt import residuals_on
from rock2d.files.experiment import load_experiment
from rock2d.kinematics.sanity import Sanity
from rock2d.kinematics.setup_world import base_start, setup_world
from rock2d.scene.world import World

Array = np.ndarray

# smallest ratio of the gap of the base law to the floor for which the share is computed
LEAST_GAP_RATIO = 1.03


def true_closure(case: Path, result: Diagnosis) -> float | None:
    """The share of the gap that is truly closed; None if there is no gap, the case has no twin, or one of its films
    cannot be segmented."""
    attribution = result.found
    if not (case / TWIN).is_dir():
        return None
    (setup, start, sanity, data), (*_, held), (*_, twin) = (
        _read(case / n) for n in (TWIN_FIT, HELDOUT, TWIN)
    )
    if attribution is None or data is None or held is None or twin is None:
        return None
    null = fit_base(setup, start, data, sanity.registered)
    variance = np.median(np.diagonal(attribution.final.fit.covariance(), axis1=1, axis2=2), axis=0)
    base = _gap(held, attribution.base.model.residuals(attribution.base.p, held), variance)
    closed = _gap(held, residuals_on(held, attribution.learnt), variance)
    floor = _gap(twin, null.model.residuals(null.p, twin), variance)
    return (base - closed) / (base - floor) if base > LEAST_GAP_RATIO * floor else None


def _gap(data: Data, residuals: Residuals, variance: Array) -> float:
    """Gap of residuals; `variance` (d,) of the channels of impacts."""
    sizes = ResidualSizes(data, np.diag(variance) * np.ones((len(data.impact_release), 1, 1)))
    return float(np.exp(sizes.of(residuals).sum() / sizes.count.sum()))


def _read(folder: Path) -> tuple[World, Array, Sanity, Data | None]:
    """The stated world of a film, its base law, and the result of `check_and_segment`."""
    experiment = load_experiment(folder)
    setup = setup_world(experiment)
    return setup, base_start(experiment), *check_and_segment(experiment, setup)
