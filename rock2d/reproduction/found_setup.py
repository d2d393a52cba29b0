"""The hypothesis on set-up and arrivals under which Tables 3 and 4 agree best with the paper's columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rock2d.reproduction import published, summary
from rock2d.reproduction.hypotheses import KnownSetup, Values, table_3
from rock2d.reproduction.likelihood import log_counts, published_counts
from rock2d.reproduction.outcomes import Outcome, probabilistic_outcome
from rock2d.wording import listed

Array = np.ndarray


@dataclass(frozen=True)
class FoundSetup:
    """The best hypothesis.

    Attributes
    ----------
    place : index of the hypothesis
    of : number of hypotheses
    releases : simulated releases of each block
    agrees : model -> (blocks, lines) whether the simulated frequency agrees with the paper's, see `summary.agrees`
    reached : model -> (2, blocks, lines) lowest and highest simulated frequency of all hypotheses, in %
    """

    place: int
    of: int
    releases: int
    agrees: Mapping[str, Array]
    reached: Mapping[str, Array]

    def met(self) -> str:
        """The number of cells of each column that agree, and the names of the others."""
        return "; ".join(f"{model} {met_cells(own)}" for model, own in self.agrees.items())

    def missed(self) -> list[str]:
        """For each cell that does not agree, the range of all hypotheses."""
        return [
            f"{published.BLOCKS[b]} {published.LINES[i]}, {model}: {published.COLUMNS[model][b, i]} % in the paper, "
            f"{self.reached[model][0, b, i]:.0f} to {self.reached[model][1, b, i]:.0f} % over all hypotheses"
            for model, own in self.agrees.items()
            for b, i in np.argwhere(~own)
        ]


def met_cells(agrees: Array) -> str:
    """The number of cells (blocks, lines) of a column that agree, and the names of the others."""
    off = [f"{published.BLOCKS[b]} {published.LINES[i]}" for b, i in np.argwhere(~agrees)]
    return f"{agrees.sum()} of {agrees.size}" + (f" (not {listed(off)})" if off else "")


def found_setup(
    known: KnownSetup, values: Values, with_table_4: list[Outcome], draws: Mapping[str, Array]
) -> FoundSetup:
    """The hypothesis with which most cells of the deterministic column agree. Among equals, the one with most cells of
    the probabilistic column; among equals, the one with the highest likelihood of both.

    `with_table_4`: outcomes of the three blocks under Table 4, from the standard normal `draws`.
    """
    ones = np.ones(len(values["slope_deg"]))
    with_table_3 = [
        probabilistic_outcome(
            known, table_3(values), block, draws[block], published.SLOPE_REDUCTION_DEG[block] * ones
        )
        for block in published.BLOCKS
    ]
    likely, agrees, reached = np.zeros(len(ones)), dict[str, Array](), dict[str, Array]()
    for model, outcomes in (("deterministic", with_table_4), ("probabilistic", with_table_3)):
        column, percent = published.COLUMNS[model], np.stack([100 * o.frequencies for o in outcomes], axis=1)
        agrees[model] = summary.agrees(percent, column)
        reached[model] = np.stack([percent.min(axis=0), percent.max(axis=0)])
        for block, outcome in zip(published.BLOCKS, outcomes, strict=True):
            likely += log_counts(outcome.by_last_line, published_counts(column, block))
    met = {model: own.sum(axis=(1, 2)) for model, own in agrees.items()}
    best = int(np.lexsort((likely, met["probabilistic"], met["deterministic"]))[-1])
    releases = with_table_4[0].crossed.shape[1]
    return FoundSetup(best, len(ones), releases, {model: own[best] for model, own in agrees.items()}, reached)
