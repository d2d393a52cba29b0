"""Discrepancies: dependences in the residuals of a model that no effect of the catalogue may explain.

A regression without mechanics (`residual_regression`) needs many impacts to find a pattern in six channels. Here the
search uses *levers*, a few numbers that move all channels together (`levers`). Each may follow a smooth function of one
group of measured quantities (place, orientation, number of the impact, ...). One Newton step gives for each pair of
lever and group the gain on held-out releases. The model's own parameters stay free in it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from rock2d.diagnosis.data import Data
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.levers import FLIGHT, FRAME, LAW, LEVERS, OUTCOME, SLOPE, STATE, Levers
from rock2d.diagnosis.linear_model import LinearModel
from rock2d.diagnosis.quantities import CONSTANT, Basis
from rock2d.diagnosis.significance import SummedGain

Array = np.ndarray

# standard deviations of the coefficients that are tried, in the natural units of `Levers.units`
WIDTHS = {
    LAW: (0.02, 0.1, 0.4),
    STATE: (0.02, 0.1, 0.4),
    OUTCOME: (0.1, 0.4, 1.6),
    SLOPE: (0.01, 0.05, 0.2),
    FRAME: (0.01, 0.05, 0.2),
    FLIGHT: (0.003, 0.03, 0.3),
}


CHANCE_PENALTY = 2.0  # log likelihood for each factor of e in the number of bases of the same name


@dataclass
class Discrepancy(SummedGain):
    """A dependence of a lever on measured quantities, and what it gains.

    Attributes
    ----------
    gain : (releases,) log likelihood on held-out releases
    width : standard deviation of its coefficients that gains most
    """

    lever: str
    basis: Basis
    gain: Array
    width: float

    @property
    def name(self) -> str:
        return f"{self.lever} of {self.basis.name}"


def discrepancies(fit: Fit, data: Data, only: Collection[str] = LEVERS) -> list[Discrepancy]:
    """Every dependence of these levers that was tried, the one that gains most first."""
    levers, linear = Levers(fit, data), LinearModel(fit, data)
    found = []
    for lever, bases in levers.bases.items():
        if lever not in only:
            continue
        chances = Counter(basis.name for basis in bases)
        for basis in bases:
            if basis.name == CONSTANT and lever in (LAW, OUTCOME):
                # the law is fitted, and impacts on the other side of an edge shift all outcomes to one side
                continue
            columns = levers.columns(levers.response(lever, basis))
            count = columns.impacts.shape[-1]
            best = linear.expected(columns, [np.full(count, width) for width in WIDTHS[lever]])
            # the best of many bases of the same name gains by chance
            penalty = CHANCE_PENALTY * np.log(chances[basis.name]) / len(data.order)
            found.append(Discrepancy(lever, basis, best.gain - penalty, WIDTHS[lever][best.choice]))
    return sorted(found, key=lambda d: -d.total)
