"""Results with the arrivals inferred from the paper's simulations: agreement with these simulations, predictions of the
calibrated law, and the effects that the paper's models lack."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.calibration.sequential_monte_carlo import Sample
from rock2d.reproduction import published, summary
from rock2d.reproduction.hypotheses import DETERMINISTIC_SPACE, Values, table_4
from rock2d.reproduction.missing_effects import missing_effects_table
from rock2d.reproduction.outcomes import Outcome, deterministic_outcome
from rock2d.reproduction.paper_setup import FoundSetup, found_setup
from rock2d.reproduction.table_3_readings import readings_table

SIGNIFICANT_ERRORS = 2.0  # a candidate must be better than none by this many standard errors
CELL_COLUMNS = (
    "block", "line", "published", "published_low95", "published_high95", "predicted", "low95", "high95", "p",
)  # fmt: skip


@dataclass(frozen=True)
class ArrivalStages:
    """Arrays computed with the arrivals of the paper's simulations.

    Attributes
    ----------
    sample : hypotheses of DETERMINISTIC_SPACE
    candidates : model -> arrays of `missing_effects`
    readings : arrays of `table_3_readings`"""

    sample: Sample
    candidates: Mapping[str, Mapping[str, Array]]
    readings: Mapping[str, Array]


@dataclass(frozen=True)
class ArrivalResults:
    """Results with the arrivals of the paper's simulations.

    Attributes
    ----------
    values : hypotheses of DETERMINISTIC_SPACE
    with_table_4, predicted : outcomes of the three blocks, with the law of Table 4 and with the calibrated law
    found : the hypothesis with the best agreement with both columns of the paper
    paper_column, passing, missing_effects, table_3_readings : tables"""

    values: Values
    with_table_4: list[Outcome]
    predicted: list[Outcome]
    found: FoundSetup
    paper_column: pd.DataFrame
    passing: pd.DataFrame
    missing_effects: pd.DataFrame
    table_3_readings: pd.DataFrame

    def errors(self) -> dict[str, float]:
        """RMSE in points from the experiment and from the paper's column."""
        ours, of_table_4 = summary.mean_percent(self.predicted), summary.mean_percent(self.with_table_4)
        own, validation = "arrivals of the paper's simulations", summary.VALIDATION_ROWS
        return {
            f"deterministic, {own}: validation cells": summary.rmse(ours, validation),
            f"deterministic, {own}: all nine": summary.rmse(ours),
            f"deterministic, {own}, the best hypothesis: all nine": summary.best_hypothesis_rmse(self.predicted),
            f"Table 4, {own}: validation cells": summary.rmse(of_table_4, validation),
            f"Table 4, {own}: all nine of the paper's column": summary.rms(of_table_4 - published.DETERMINISTIC),
        }

    def validation_interval(self) -> tuple[float, float]:
        """95 % interval over hypotheses of the RMSE in points over the validation cells."""
        percent = np.array([100 * o.frequencies for o in self.predicted])[summary.VALIDATION_ROWS]
        off = percent - published.EXPERIMENT[summary.VALIDATION_ROWS][:, None]
        low, high = np.percentile(np.sqrt((off**2).mean(axis=(0, 2))), [2.5, 97.5])
        return float(low), float(high)

    def conclusions(self) -> list[str]:
        """The conclusions, one sentence or two each."""
        low, high = self.validation_interval()
        validation, all_nine, _, _, of_paper = self.errors().values()
        column = self.paper_column
        outside = column[~column["predicted"].between(column["published_low95"], column["published_high95"])]
        cells = ", ".join(f"{row.block} {row.line}" for row in outside.itertuples()) or "none"
        return [
            f"With the arrivals that the paper's deterministic column tells: RMSE {validation:.1f} points over the "
            f"validation cells ({low:.1f} to {high:.1f} over hypotheses), {all_nine:.1f} over all nine.",
            f"The paper's deterministic column, met with Table 4 on these arrivals: RMSE {of_paper:.1f} points; "
            f"cells outside the exact 95 % intervals of 50 releases: {cells}.",
            f"Cells that Tables 3 and 4 meet on the set-up and arrivals of paper_setup.yaml: {self.found.met()}.",
            self._readings_sentence(),
            *(self._missing_effects_sentence(model) for model in dict.fromkeys(self.missing_effects["model"])),
        ]

    def _readings_sentence(self) -> str:
        """A sentence on the readings of Table 3 that reproduce the sphere's row of the paper's probabilistic column."""
        excluded = dict(zip(*(self.table_3_readings[c] for c in ("reading", "excluded")), strict=True))
        met = ", ".join(name for name, lines in excluded.items() if lines == "none")
        missed = ", ".join(f"{name} ({lines} excluded)" for name, lines in excluded.items() if lines != "none")
        return (
            "The sphere's row of the paper's probabilistic column, from Table 3: possible with "
            f"{met or 'no reading'}; impossible (p < 0.05) with {missed or 'no reading'}."
        )

    def _missing_effects_sentence(self, model: str) -> str:
        """A sentence on the candidates that predict angular blocks better than none, over all held-out tests."""
        own = self.missing_effects[self.missing_effects["model"] == model]
        held_out = own[own["calibrated_on"] != "sphere"].groupby("candidate")
        gain = held_out["over_none"].sum()
        error = held_out["error"].apply(lambda e: float(np.hypot.reduce(e)))
        better = [
            name for name in gain.sort_values(ascending=False).index if gain[name] > SIGNIFICANT_ERRORS * error[name]
        ]
        listed = ", ".join(f"{name} {gain[name]:+z.1f} ± {error[name]:.1f}" for name in better[:3])
        return (
            f"Missing in the {model} model, log-probability of one angular block above that of no effect, calibrated "
            f"on the other: {listed or 'no candidate is better than none'}. The errors are of this run; another seed "
            "may order the candidates otherwise."
        )


def arrival_results(found: ArrivalStages, draws: Mapping[str, Array], seed: int) -> ArrivalResults:
    """Evaluate the arrays with the standard normal `draws`, block -> (n, 6)."""
    values = DETERMINISTIC_SPACE.values(found.sample.u)
    with_table_4, predicted = (
        [deterministic_outcome(own, block, draws[block]) for block in published.BLOCKS]
        for own in (table_4(values), values)
    )
    return ArrivalResults(
        values, with_table_4, predicted, found_setup(values, with_table_4, draws),
        comparison_table(with_table_4, published.DETERMINISTIC),
        comparison_table(predicted, published.EXPERIMENT),
        missing_effects_table(found.candidates, seed), readings_table(found.readings),
    )  # fmt: skip


def comparison_table(outcomes: list[Outcome], percent: Array) -> pd.DataFrame:
    """A table `percent` (blocks, lines) of Table 2 and its prediction in %; one row for each block and line.

    published_low95, published_high95: exact 95 % interval of 50 releases; low95, high95: interval over hypotheses;
    p: two-sided p-value of the published number under the hypotheses."""
    rows = []
    for b, block in enumerate(published.BLOCKS):
        for i, line in enumerate(published.LINES):
            passed = int(published.passed(percent)[b, i])
            own = 100 * outcomes[b].frequencies[:, i]
            rows.append(
                (
                    block, line, float(percent[b, i]), *summary.clopper_pearson_interval(passed), float(own.mean()),
                    *np.percentile(own, [2.5, 97.5]), summary.predictive_p(passed, outcomes[b], i),
                )
            )  # fmt: skip
    return pd.DataFrame(rows, columns=CELL_COLUMNS)
