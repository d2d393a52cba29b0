"""A candidate: the base law with one effect, fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.diagnosis.cross_validation import HeldOut
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.significance import OverReleases
from rock2d.effects.effect import Effect

Array = np.ndarray


@dataclass
class Candidate(OverReleases):
    """A fit with an effect and its score on held-out releases.

    Attributes
    ----------
    effect : the effect under test; the fit may contain further ones
    held_out : residuals and scores on held-out releases
    gain : (releases,) log likelihood above that of the base, or of the fit without this effect
    """

    effect: Effect
    fit: Fit
    held_out: HeldOut
    gain: Array
