"""What the calibrations say, as numbers: passing frequencies with intervals and tests, errors, the sampling floor, what
is identified, and what each candidate effect brings on cells it has not seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Quantity, Space
from rock2d.reproduction import published
from rock2d.reproduction.hypotheses import Values
from rock2d.reproduction.likelihood import filmed, log_counts_without, log_lines
from rock2d.reproduction.passing import Outcome
from rock2d.reproduction.stages import CANDIDATES, NONE, candidate_of, prior_of

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

VALIDATION = np.s_[1:]  # rows of Table 2 that the deterministic calibration does not see
FLOOR_DRAWS = 20_000
CHANCE_SD = 3.5  # standard deviations that the largest of some tens of chance correlations reaches


def rmse(simulated: Array, cells: slice = np.s_[:]) -> float:
    """Root mean square difference from Table 2's experiment in points of %, of (blocks, lines) frequencies in %."""
    return float(np.sqrt(np.mean((simulated - published.EXPERIMENT)[cells] ** 2)))


def block_rmse(simulated: Array, block: str) -> float:
    """As `rmse`, of one block's (lines,) frequencies in %."""
    return float(np.sqrt(np.mean((simulated - published.EXPERIMENT[published.BLOCKS.index(block)]) ** 2)))


def sampling_floor(cells: slice, rng: np.random.Generator) -> tuple[float, float]:
    """Mean and 95 % bound of the RMSE of a perfect model against 50 filmed releases a block, in points.

    True frequencies are drawn from what the experiment leaves possible (Jeffreys' prior), the filmed ones from them.
    """
    passed = published.passed()[cells]
    truth = rng.beta(passed + 0.5, published.RELEASES - passed + 0.5, (FLOOR_DRAWS, *passed.shape))
    film = rng.binomial(published.RELEASES, truth) / published.RELEASES
    errors = 100 * np.sqrt(((film - truth) ** 2).mean(axis=(1, 2)))
    return float(errors.mean()), float(np.percentile(errors, 95))


def exact_interval(passed: int) -> tuple[float, float]:
    """Clopper and Pearson's 95 % interval of a passing frequency, in %, of RELEASES."""
    from scipy.stats import binomtest

    interval = binomtest(passed, published.RELEASES).proportion_ci(0.95, method="exact")
    return 100 * interval.low, 100 * interval.high


def same_frequency(passed: int, simulated_percent: float) -> float:
    """Fisher's exact p that RELEASES filmed and as many simulated releases have one passing frequency."""
    from scipy.stats import fisher_exact

    other = round(simulated_percent * published.RELEASES / 100)
    n = published.RELEASES
    return float(fisher_exact([[passed, n - passed], [other, n - other]])[1])


def predictive_p(passed: int, outcome: Outcome, line: int) -> float:
    """Two-sided p of `passed` of RELEASES under an outcome's hypotheses: beta-binomials of their simulated numbers
    (Jeffreys' prior), averaged."""
    from scipy.stats import betabinom

    n = outcome.crossed.shape[1]
    simulated = outcome.crossed[:, :, line].sum(axis=1)
    predicted = betabinom(published.RELEASES, simulated + 0.5, n - simulated + 0.5)
    low, high = predicted.cdf(passed).mean(), predicted.sf(passed - 1).mean()
    return float(min(1.0, 2.0 * min(low, high)))


def passing_table(deterministic: list[Outcome], probabilistic: list[Outcome]) -> pd.DataFrame:
    """Table 2: the experiment, the paper's two models and this project's, one row a block and line; of the latter the
    mean and the 95 % interval over the hypotheses."""
    import pandas as pd

    rows = []
    for b, block in enumerate(published.BLOCKS):
        for i, line in enumerate(published.LINES):
            passed = int(published.passed()[b, i])
            low, high = exact_interval(passed)
            row = {
                "block": block, "line": line, "experiment": float(published.EXPERIMENT[b, i]),
                "experiment_low95": low, "experiment_high95": high,
            }  # fmt: skip
            for name, theirs in (
                ("paper_probabilistic", published.PROBABILISTIC),
                ("paper_deterministic", published.DETERMINISTIC),
            ):
                row[name] = float(theirs[b, i])
                row[f"{name}_p"] = same_frequency(passed, theirs[b, i])
            for name, ours in (("probabilistic", probabilistic[b]), ("deterministic", deterministic[b])):
                own = 100 * ours.frequencies[:, i]
                row[name] = float(own.mean())
                row[f"{name}_low95"], row[f"{name}_high95"] = np.percentile(own, [2.5, 97.5])
                row[f"{name}_p"] = predictive_p(passed, ours, i)
            rows.append(row)
    return pd.DataFrame(rows)


def mean_percent(outcomes: list[Outcome]) -> Array:
    """(blocks, lines) mean frequencies in % over hypotheses."""
    return np.array([100 * o.frequencies.mean(axis=0) for o in outcomes])


def halves_differ(outcomes: list[Outcome]) -> float:
    """Root mean square difference in points between the mean predictions of the two independent halves of the
    hypotheses, over 2: the Monte Carlo error of the mean of both."""
    half = len(outcomes[0].crossed) // 2
    first, second = (mean_percent([o.of(part) for o in outcomes]) for part in (np.s_[:half], np.s_[half:]))
    return 0.5 * float(np.sqrt(np.mean((first - second) ** 2)))


def best_rmse(outcomes: list[Outcome]) -> float:
    """RMSE over all nine cells of the hypothesis for which it is least, chosen by one half of the releases and judged
    by the other: what the model can do at all. NaN without hypotheses."""
    half = outcomes[0].crossed.shape[1] // 2
    first, second = (
        100 * np.stack([o.crossed[:, part].mean(axis=1) for o in outcomes], axis=1)
        for part in (np.s_[:half], np.s_[half:])
    )
    if not len(first):
        return float("nan")
    return rmse(second[int(np.argmin([rmse(one) for one in first]))])


def identified_table(space: Space, u: Array, quantities: tuple[Quantity, ...]) -> pd.DataFrame:
    """Prior range and posterior of each quantity, its posterior over its prior standard deviation (1: as wide as
    before), and the quantity it is most correlated with, if more than by chance."""
    import pandas as pd

    correlation = np.corrcoef(u.T)
    np.fill_diagonal(correlation, 0.0)
    rows = []
    for q in quantities:
        i = space.columns([q.name])[0]
        low, middle, high = np.percentile(q.value(u[:, i]), [2.5, 50.0, 97.5])
        partner = int(np.argmax(np.abs(correlation[i])))
        correlated = abs(correlation[i, partner]) > CHANCE_SD / np.sqrt(len(u))
        rows.append(
            {
                "quantity": q.name, "prior_low": q.low, "prior_high": q.high, "prior_log": q.log,
                "low95": low, "median": middle, "high95": high,
                "sd_over_prior_sd": float(u[:, i].std() * np.sqrt(12.0)),
                "correlated_with": space.quantities[partner].name if correlated else "",
                "correlation": float(correlation[i, partner]) if correlated else np.nan,
                "prior": q.source,
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


@dataclass(frozen=True)
class LeftOut:
    """Hypotheses of CANDIDATE_SPACE that were not told one block's cells, and what they predict of all three blocks."""

    values: Values
    outcomes: list[Outcome]
    block: str

    @property
    def candidate(self) -> Array:
        """(k,) indices into CANDIDATES."""
        return candidate_of(self.values)

    @property
    def outcome(self) -> Outcome:
        """That of the block left out."""
        return self.outcomes[published.BLOCKS.index(self.block)]

    @property
    def plain(self) -> list[Outcome]:
        """Outcomes of the three blocks under the hypotheses without a candidate effect."""
        own = self.candidate == CANDIDATES.index(NONE)
        return [o.of(own) for o in self.outcomes]

    @property
    def log_score(self) -> Array:
        """(k,) log-probability of the filmed cells of the block left out."""
        return log_lines(self.outcome, self.block)


def candidates_table(runs: list[LeftOut]) -> pd.DataFrame:
    """What each candidate effect brings to a block that was left out: one row a candidate and block.

    share: of the run's hypotheses, that is the candidate's posterior probability from the other blocks and the words
    (prior: `prior_of`). Then the passing frequencies predicted in %, their RMSE, the log-probability of the filmed
    numbers; and, once they are told, too: the posterior probability and its odds against none over the prior's. Both
    runs estimate the last two of the same data: their difference is the error of either.
    """
    import pandas as pd

    rows = []
    for run in runs:
        which, likelihood = run.candidate, np.exp(run.log_score)
        plain = likelihood[which == CANDIDATES.index(NONE)].sum()
        for c, name in enumerate(CANDIDATES):
            own = which == c
            row: dict[str, object] = {
                "left_out": run.block, "candidate": name, "prior": prior_of(name), "share": float(own.mean()),
            }  # fmt: skip
            if own.any():
                predicted = 100 * run.outcome.frequencies[own].mean(axis=0)
                row |= dict(zip(published.LINES, predicted.tolist(), strict=True))
                row["rmse"] = block_rmse(predicted, run.block)
                row["log_score"] = float(np.log(likelihood[own].mean()))
            row["share_told_all"] = float(likelihood[own].sum() / likelihood.sum())
            odds = likelihood[own].sum() / plain if plain > 0 else np.nan
            row["bayes_factor"] = float(odds * prior_of(NONE) / prior_of(name))
            rows.append(row)
    return pd.DataFrame(rows)


def plain_rmse(run: LeftOut) -> float:
    """RMSE in points of the mean prediction of the block left out, without candidate effects."""
    frequencies = run.plain[published.BLOCKS.index(run.block)].frequencies
    return block_rmse(100 * frequencies.sum(axis=0) / (len(frequencies) or np.nan), run.block)


def cells_table(runs: list[LeftOut]) -> pd.DataFrame:
    """Every validation cell as predicted (%) by the hypotheses without a candidate effect that were told all others of
    Table 2 (importance weights; `effective`: the number of hypotheses that this rests on)."""
    import pandas as pd

    rows = []
    for run in runs:
        b = published.BLOCKS.index(run.block)
        outcome = run.plain[b]
        for i, line in enumerate(published.LINES):
            weight = np.exp(log_counts_without(i, outcome.levels, filmed(run.block)))
            total = weight.sum() or np.nan
            predicted = float(100 * weight @ outcome.frequencies[:, i] / total)
            effective = float(total**2 / (weight**2).sum()) if len(weight) else 0.0
            rows.append((run.block, line, float(published.EXPERIMENT[b, i]), predicted, effective))
    return pd.DataFrame(rows, columns=["block", "line", "experiment", "predicted", "effective"])
