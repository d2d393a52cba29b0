"""Discrepancies: dependences of the residuals of a model on measured quantities, which effects need not explain.

A regression without mechanics (`residual_regression`) needs many impacts to find a pattern in six channels. Here the
search uses *levers*, a few numbers that change all channels together (`levers`). Each may be a smooth function of a
group of measured quantities (place, orientation, number of the impact, ...). For each pair of lever and group, one
Newton step with free parameters of the model gives the gain on held-out releases.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from rock2d.diagnosis.data import Data
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.levers import FLIGHT, FRAME, LAW, LEVERS, OUTCOME, PROFILE, SLOPE, STATE, Levers
from rock2d.diagnosis.linear_model import LinearModel
from rock2d.diagnosis.quantities import CONSTANT, Basis
from rock2d.diagnosis.significance import SummedGain

Array = np.ndarray

# tried standard deviations of the coefficients, in the natural units of `Levers.units`
WIDTHS = {
    LAW: (0.02, 0.1, 0.4),
    STATE: (0.02, 0.1, 0.4),
    OUTCOME: (0.1, 0.4, 1.6),
    SLOPE: (0.01, 0.05, 0.2),
    PROFILE: (0.01, 0.05, 0.2),
    FRAME: (0.01, 0.05, 0.2),
    FLIGHT: (0.003, 0.03, 0.3),
}


CHANCE_PENALTY = 2.0  # log likelihood for each factor of e in the number of bases of the same name


@dataclass
class Discrepancy(SummedGain):
    """A dependence of a lever on measured quantities, and its gain.

    Attributes
    ----------
    gain : (releases,) log likelihood on held-out releases
    width : standard deviation of its coefficients with the largest gain
    """

    lever: str
    basis: Basis
    gain: Array
    width: float

    @property
    def name(self) -> str:
        return f"{self.lever} of {self.basis.name}"


def discrepancies(
    fit: Fit, data: Data, only: Collection[str] = LEVERS, levers: Levers | None = None
) -> list[Discrepancy]:
    """All tried dependences of the levers `only`, the one with the largest gain first.

    `levers`: those of the fit, if they are used further: their derivatives are then computed once.
    """
    levers, linear = levers or Levers(fit, data), LinearModel(fit, data)
    dependences = []
    for lever, bases in levers.bases.items():
        if lever not in only:
            continue
        bases_of_name = Counter(basis.name for basis in bases)
        for basis in bases:
            if basis.name == CONSTANT and lever in (LAW, OUTCOME):
                # the law is fitted, and impacts on the other side of an edge shift all outcomes to one side
                continue
            columns = levers.columns(levers.response(lever, basis))
            count = columns.impacts.shape[-1]
            best = linear.expected(columns, [np.full(count, width) for width in WIDTHS[lever]])
            # the best of many bases of the same name has a gain by chance
            penalty = CHANCE_PENALTY * np.log(bases_of_name[basis.name]) / len(data.order)
            dependences.append(Discrepancy(lever, basis, best.gain - penalty, WIDTHS[lever][best.choice]))
    return sorted(dependences, key=lambda d: -d.total)
