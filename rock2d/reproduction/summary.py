"""Statistics of the calibrations: passing frequencies with intervals and tests, errors, the sampling floor, identified
quantities, and predictions of held-out cells with each candidate."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import betaincinv  # scipy.stats takes over a second to import

from rock2d.arrays import Array
from rock2d.calibration.sequential_monte_carlo import Quantity, Space
from rock2d.reproduction import published
from rock2d.reproduction.calibrations import CANDIDATES, NO_CANDIDATE, candidate_indices, candidate_prior
from rock2d.reproduction.hypotheses import Values
from rock2d.reproduction.likelihood import log_counts_without_line, passing_log_likelihood
from rock2d.reproduction.outcomes import Outcome

VALIDATION_ROWS = np.s_[1:]  # rows of Table 2 that are not used for the deterministic calibration
SAMPLING_FLOOR_DRAWS = 20_000
# of the largest of some tens of random correlations, in standard deviations
LARGEST_CHANCE_CORRELATION_SD = 3.5


def rms(values: object) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, float)))))


def rmse(simulated: Array, cells: slice = np.s_[:]) -> float:
    """Root mean square difference of frequencies (blocks, lines) in % from the experiment (Table 2), in percentage
    points."""
    return rms((simulated - published.EXPERIMENT)[cells])


def block_rmse(simulated: Array, block: str) -> float:
    """As `rmse`, for the frequencies (lines,) in % of one block."""
    return rms(simulated - published.EXPERIMENT[published.BLOCKS.index(block)])


def sampling_floor(cells: slice, rng: np.random.Generator) -> tuple[float, float]:
    """Mean and 95th percentile of the RMSE of a perfect model against 50 filmed releases of each block, in points.

    True frequencies are drawn from their posterior given the experiment (Jeffreys' prior), filmed numbers from these.
    """
    passed = published.passed(published.EXPERIMENT)[cells]
    truth = rng.beta(passed + 0.5, published.RELEASES - passed + 0.5, (SAMPLING_FLOOR_DRAWS, *passed.shape))
    film = rng.binomial(published.RELEASES, truth) / published.RELEASES
    errors = 100 * np.sqrt(((film - truth) ** 2).mean(axis=(1, 2)))
    return float(errors.mean()), float(np.percentile(errors, 95))


def clopper_pearson_interval(passed: int, releases: int = published.RELEASES) -> tuple[float, float]:
    """The 95 % interval of Clopper and Pearson (1934) of a passing frequency, in %."""
    low = betaincinv(passed, releases - passed + 1, 0.025) if passed > 0 else 0.0
    high = betaincinv(passed + 1, releases - passed, 0.975) if passed < releases else 1.0
    return float(100 * low), float(100 * high)


def agrees(simulated: Array, percent: Array) -> Array:
    """Whether `simulated` frequencies (..., blocks, lines) in % lie in the exact 95 % intervals, for RELEASES, of a
    table `percent` (blocks, lines) of Table 2."""
    bounds = [clopper_pearson_interval(int(passed)) for passed in published.passed(percent).ravel()]
    low, high = np.array(bounds).T.reshape(2, *np.shape(percent))
    return np.asarray((low <= simulated) & (simulated <= high))


def equal_frequency_p(passed: int, simulated_percent: float) -> float:
    """p-value of Fisher's exact test that RELEASES filmed and as many simulated releases have the same passing
    frequency."""
    from scipy.stats import fisher_exact

    other = round(simulated_percent * published.RELEASES / 100)
    n = published.RELEASES
    return float(fisher_exact([[passed, n - passed], [other, n - other]])[1])


def predictive_p(passed: int, outcome: Outcome, line: int) -> float:
    """Two-sided p-value of `passed` of RELEASES under the hypotheses of an outcome: the mean of their beta-binomial
    distributions (Jeffreys' prior)."""
    from scipy.stats import betabinom

    n = outcome.crossed.shape[1]
    simulated = outcome.crossed[:, :, line].sum(axis=1)
    predicted = betabinom(published.RELEASES, simulated + 0.5, n - simulated + 0.5)
    low, high = predicted.cdf(passed).mean(), predicted.sf(passed - 1).mean()
    return float(min(1.0, 2.0 * min(low, high)))


def passing_table(deterministic: list[Outcome], probabilistic: list[Outcome]) -> pd.DataFrame:
    """Table 2: the experiment, the paper's two models and those of this project (mean and 95 % interval over the
    hypotheses); one row for each block and line."""
    rows = []
    for b, block in enumerate(published.BLOCKS):
        for i, line in enumerate(published.LINES):
            passed = int(published.passed(published.EXPERIMENT)[b, i])
            low, high = clopper_pearson_interval(passed)
            row = {
                "block": block, "line": line, "experiment": float(published.EXPERIMENT[b, i]),
                "experiment_low95": low, "experiment_high95": high,
            }  # fmt: skip
            for name, paper in (
                ("paper_probabilistic", published.PROBABILISTIC),
                ("paper_deterministic", published.DETERMINISTIC),
            ):
                row[name] = float(paper[b, i])
                row[f"{name}_p"] = equal_frequency_p(passed, paper[b, i])
            for name, outcome in (("probabilistic", probabilistic[b]), ("deterministic", deterministic[b])):
                own = 100 * outcome.frequencies[:, i]
                row[name] = float(own.mean())
                row[f"{name}_low95"], row[f"{name}_high95"] = np.percentile(own, [2.5, 97.5])
                row[f"{name}_p"] = predictive_p(passed, outcome, i)
            rows.append(row)
    return pd.DataFrame(rows)


def mean_percent(outcomes: list[Outcome]) -> Array:
    """(blocks, lines) mean frequencies in % over hypotheses."""
    return np.array([100 * o.frequencies.mean(axis=0) for o in outcomes])


def monte_carlo_error(outcomes: list[Outcome]) -> float:
    """Root mean square difference in points between the mean predictions of the two independent halves of the
    hypotheses, over 2: the Monte Carlo error of the mean of both."""
    half = len(outcomes[0].crossed) // 2
    first, second = (mean_percent([o.of_hypotheses(part) for o in outcomes]) for part in (np.s_[:half], np.s_[half:]))
    return 0.5 * rms(first - second)


def best_hypothesis_rmse(outcomes: list[Outcome]) -> float:
    """RMSE over all nine cells of the best hypothesis, a limit of the model. NaN without hypotheses.

    The hypothesis is chosen with one half of the releases, its RMSE is computed with the other half."""
    half = outcomes[0].crossed.shape[1] // 2
    first, second = (
        100 * np.stack([o.crossed[:, part].mean(axis=1) for o in outcomes], axis=1)
        for part in (np.s_[:half], np.s_[half:])
    )
    if not len(first):
        return float("nan")
    return rmse(second[int(np.argmin([rmse(one) for one in first]))])


def identified_table(space: Space, u: Array, quantities: tuple[Quantity, ...]) -> pd.DataFrame:
    """Prior range and posterior of each quantity, and the ratio of the standard deviations of posterior and prior.

    `correlated_with` is the quantity with the largest correlation, if it is larger than random correlations."""
    correlation = np.corrcoef(u.T)
    np.fill_diagonal(correlation, 0.0)
    rows = []
    for q in quantities:
        i = space.columns([q.name])[0]
        low, middle, high = np.percentile(q.value(u[:, i]), [2.5, 50.0, 97.5])
        partner = int(np.argmax(np.abs(correlation[i])))
        correlated = abs(correlation[i, partner]) > LARGEST_CHANCE_CORRELATION_SD / np.sqrt(len(u))
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
class HeldOutBlock:
    """Hypotheses of CANDIDATE_SPACE, fitted without the cells of `block`, and their predictions of all blocks."""

    values: Values
    outcomes: list[Outcome]
    block: str

    @property
    def candidate(self) -> Array:
        """(k,) indices into CANDIDATES."""
        return candidate_indices(self.values)

    @property
    def outcome(self) -> Outcome:
        """Prediction of the held-out block."""
        return self.outcomes[published.BLOCKS.index(self.block)]

    @property
    def without_candidate(self) -> list[Outcome]:
        """Outcomes of the three blocks under the hypotheses without a candidate effect."""
        own = self.candidate == CANDIDATES.index(NO_CANDIDATE)
        return [o.of_hypotheses(own) for o in self.outcomes]

    @property
    def log_score(self) -> Array:
        """(k,) log-probability of the filmed cells of the held-out block."""
        return passing_log_likelihood(self.outcome, self.block)


def candidates_table(runs: list[HeldOutBlock]) -> pd.DataFrame:
    """Predictions of the held-out blocks with each candidate effect; one row for each candidate and block.

    share: posterior probability of the candidate from the other blocks and the statements on first impacts.
    line_1 to line_3, rmse, log_score: predicted passing frequencies in %, their RMSE, log-probability of the filmed
    numbers. share_all_cells: posterior probability with the held-out cells included. bayes_factor: ratio of its
    posterior and prior odds against no candidate. Both held-out blocks estimate the last two from the same data; the
    difference shows the error."""
    rows = []
    for run in runs:
        which, likelihood = run.candidate, np.exp(run.log_score)
        plain = likelihood[which == CANDIDATES.index(NO_CANDIDATE)].sum()
        for c, name in enumerate(CANDIDATES):
            own = which == c
            row: dict[str, object] = {
                "held_out": run.block, "candidate": name, "prior": candidate_prior(name), "share": float(own.mean()),
            }  # fmt: skip
            if own.any():
                predicted = 100 * run.outcome.frequencies[own].mean(axis=0)
                row |= dict(zip(published.LINES, predicted.tolist(), strict=True))
                row["rmse"] = block_rmse(predicted, run.block)
                row["log_score"] = float(np.log(likelihood[own].mean()))
            row["share_all_cells"] = float(likelihood[own].sum() / likelihood.sum())
            odds = likelihood[own].sum() / plain if plain > 0 else np.nan
            row["bayes_factor"] = float(odds * candidate_prior(NO_CANDIDATE) / candidate_prior(name))
            rows.append(row)
    return pd.DataFrame(rows)


def rmse_without_candidate(run: HeldOutBlock) -> float:
    """RMSE in points of the mean prediction of the held-out block, without candidate effects."""
    frequencies = run.without_candidate[published.BLOCKS.index(run.block)].frequencies
    return block_rmse(100 * frequencies.sum(axis=0) / (len(frequencies) or np.nan), run.block)


def held_out_cells_table(runs: list[HeldOutBlock]) -> pd.DataFrame:
    """The prediction (%) of each validation cell by hypotheses without a candidate effect, fitted to all other cells.

    The hypotheses have importance weights; `effective` is their effective number."""
    rows = []
    for run in runs:
        b = published.BLOCKS.index(run.block)
        outcome, filmed = (run.without_candidate[b], published.counts_by_last_line(published.EXPERIMENT, run.block))
        for i, line in enumerate(published.LINES):
            weight = np.exp(log_counts_without_line(i, outcome.by_last_line, filmed))
            total = weight.sum() or np.nan
            predicted = float(100 * weight @ outcome.frequencies[:, i] / total)
            effective = float(total**2 / (weight**2).sum()) if len(weight) else 0.0
            rows.append((run.block, line, float(published.EXPERIMENT[b, i]), predicted, effective))
    return pd.DataFrame(rows, columns=["block", "line", "experiment", "predicted", "effective"])
