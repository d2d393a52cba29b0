"""What follows once the arrivals are known from the paper's own simulations: how well these are met, what the
calibrated law then predicts, and which effect the paper's models lack."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Sample
from rock2d.reproduction import published, summary
from rock2d.reproduction.hypotheses import DETERMINISTIC_SPACE, KnownSetup, Values, table_4
from rock2d.reproduction.missing_effects import missing_effects_table
from rock2d.reproduction.outcomes import Outcome, deterministic_outcome

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

SURE_OF_ERRORS = 2.0  # standard errors by which a candidate must be better than none


@dataclass(frozen=True)
class ArrivalResults:
    """Results with the arrivals of the paper's simulations.

    Attributes
    ----------
    sample : hypotheses of DETERMINISTIC_SPACE
    with_table_4, predicted : outcomes of the three blocks, with the law of Table 4 and with the calibrated law
    paper_column, passing, missing_effects : tables
    """

    sample: Sample
    with_table_4: list[Outcome]
    predicted: list[Outcome]
    paper_column: pd.DataFrame
    passing: pd.DataFrame
    missing_effects: pd.DataFrame

    @property
    def values(self) -> Values:
        """The hypotheses."""
        return DETERMINISTIC_SPACE.values(self.sample.u)

    def errors(self) -> dict[str, float]:
        """RMSE in points against the experiment, and against the paper's column."""
        ours, of_table_4 = summary.mean_percent(self.predicted), summary.mean_percent(self.with_table_4)
        own, validation = "arrivals of the paper's simulations", summary.VALIDATION_ROWS
        return {
            f"deterministic, {own}: validation cells": summary.rmse(ours, validation),
            f"deterministic, {own}: all nine": summary.rmse(ours),
            f"deterministic, {own}, the best hypothesis: all nine": summary.best_hypothesis_rmse(
                self.predicted
            ),
            f"Table 4, {own}: validation cells": summary.rmse(of_table_4, validation),
            f"Table 4, {own}: all nine of the paper's column": float(
                np.sqrt(np.mean((of_table_4 - published.DETERMINISTIC) ** 2))
            ),
        }

    def validation_interval(self) -> tuple[float, float]:
        """95 % interval over hypotheses of the RMSE in points over the validation cells."""
        percent = np.array([100 * o.frequencies for o in self.predicted])[summary.VALIDATION_ROWS]
        off = percent - published.EXPERIMENT[summary.VALIDATION_ROWS][:, None]
        low, high = np.percentile(np.sqrt((off**2).mean(axis=(0, 2))), [2.5, 97.5])
        return float(low), float(high)

    def conclusions(self) -> list[str]:
        """Sentences."""
        low, high = self.validation_interval()
        validation, all_nine, _, _, of_paper = self.errors().values()
        outside = self.paper_column[
            ~self.paper_column["table_4"].between(self.paper_column["low95"], self.paper_column["high95"])
        ]
        cells = ", ".join(f"{row.block} {row.line}" for row in outside.itertuples()) or "none"
        return [
            f"With the arrivals that the paper's deterministic column tells: RMSE {validation:.1f} points over the "
            f"validation cells ({low:.1f} to {high:.1f} over hypotheses), {all_nine:.1f} over all nine.",
            f"The paper's deterministic column, met with Table 4 on these arrivals: RMSE {of_paper:.1f} points; "
            f"cells outside the exact 95 % intervals of 50 releases: {cells}.",
            *(self._missing(model) for model in dict.fromkeys(self.missing_effects["model"])),
        ]

    def _missing(self, model: str) -> str:
        """The candidates that predict angular blocks better than none, in every held-out test together."""
        own = self.missing_effects[self.missing_effects["model"] == model]
        held_out = own[own["calibrated_on"] != "sphere"].groupby("candidate")
        gain, error = (
            held_out["over_none"].sum(),
            held_out["error"].apply(lambda e: float(np.hypot.reduce(e))),
        )
        better = [
            name
            for name in gain.sort_values(ascending=False).index
            if gain[name] > SURE_OF_ERRORS * error[name]
        ]
        listed = ", ".join(f"{name} {gain[name]:+.1f} ± {error[name]:.1f}" for name in better[:3])
        return (
            f"Missing in the {model} model, log-probability of one angular block above that of no effect, calibrated "
            f"on the other: {listed or 'no candidate is better than none'}."
        )


def arrival_results(
    known: KnownSetup,
    sample: Sample,
    candidates: Mapping[str, Mapping[str, Array]],
    draws: Mapping[str, Array],
    seed: int,
) -> ArrivalResults:
    """`candidates`: model -> what `missing_effects` computed; `draws`: standard normal, block -> (n, 6)."""
    values = DETERMINISTIC_SPACE.values(sample.u)
    with_table_4, predicted = (
        [deterministic_outcome(known, own, block, draws[block]) for block in published.BLOCKS]
        for own in (table_4(values), values)
    )
    return ArrivalResults(
        sample, with_table_4, predicted, paper_column_table(with_table_4), predicted_table(predicted),
        missing_effects_table(candidates, seed),
    )  # fmt: skip


def paper_column_table(with_table_4: list[Outcome]) -> pd.DataFrame:
    """The paper's deterministic column, and what Table 4 gives on the arrivals found; one row for each block and line.

    low95, high95: exact 95 % interval of 50 releases of the paper's simulations; table_4_low95, table_4_high95: over
    hypotheses.
    """
    import pandas as pd

    rows = []
    for b, block in enumerate(published.BLOCKS):
        for i, line in enumerate(published.LINES):
            passed = int(published.passed(published.DETERMINISTIC)[b, i])
            low, high = summary.exact_interval(passed)
            own = 100 * with_table_4[b].frequencies[:, i]
            below, above = np.percentile(own, [2.5, 97.5])
            rows.append(
                {
                    "block": block, "line": line, "paper": float(published.DETERMINISTIC[b, i]), "low95": low,
                    "high95": high, "table_4": float(own.mean()), "table_4_low95": below, "table_4_high95": above,
                    "p": summary.predictive_p(passed, with_table_4[b], i),
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def predicted_table(predicted: list[Outcome]) -> pd.DataFrame:
    """The experiment and the calibrated law's predictions; one row for each block and line."""
    import pandas as pd

    rows = []
    for b, block in enumerate(published.BLOCKS):
        for i, line in enumerate(published.LINES):
            own = 100 * predicted[b].frequencies[:, i]
            low, high = np.percentile(own, [2.5, 97.5])
            rows.append(
                {
                    "block": block, "line": line, "experiment": float(published.EXPERIMENT[b, i]),
                    "predicted": float(own.mean()), "low95": low, "high95": high,
                    "p": summary.predictive_p(int(published.passed()[b, i]), predicted[b], i),
                }
            )  # fmt: skip
    return pd.DataFrame(rows)
