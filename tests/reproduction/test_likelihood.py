"""What the published numbers say, and how likely they are under simulated counts."""

from itertools import product

import numpy as np
import pytest

from rock2d.reproduction import published, summary
from rock2d.reproduction.likelihood import (
    first_impact_log_likelihood,
    highest_log_counts,
    log_counts,
    log_counts_without_line,
)
from rock2d.reproduction.outcomes import DITCH_ID, FACING_ID, Outcome

SIMULATED = np.array([[7, 12, 15, 6], [0, 40, 0, 0]])


def outcome(first, off_normal_deg=0.0, possible=True):
    """One hypothesis' releases by the zone of their first impact."""
    first = np.array([first])
    nothing = np.full((1, first.shape[1], 7), np.nan)
    angle = np.full(first.shape, float(off_normal_deg))
    return Outcome(np.zeros((*first.shape, 3), bool), first, angle, nothing, np.array([possible]))


def test_the_paper_s_errors_are_those_of_its_table():
    assert summary.rmse(published.DETERMINISTIC, summary.VALIDATION_ROWS) == pytest.approx(12.0, abs=0.05)
    assert summary.rmse(published.DETERMINISTIC) == pytest.approx(10.6, abs=0.05)
    assert summary.rmse(published.PROBABILISTIC) == pytest.approx(8.1, abs=0.05)


def test_only_line_1_of_the_angular_blocks_is_a_significant_miss_of_the_paper():
    for theirs in (published.DETERMINISTIC, published.PROBABILISTIC):
        p = [[summary.equal_frequency_p(k, t) for k, t in zip(*row, strict=True)]
             for row in zip(published.passed(published.EXPERIMENT), theirs, strict=True)]  # fmt: skip
        significant = np.argwhere(np.array(p) < 0.05).tolist()
        assert significant == [[1, 0], [2, 0]]
        assert p[1][0] == pytest.approx(0.012, abs=0.001) and p[2][0] == pytest.approx(0.003, abs=0.0005)


def test_releases_by_the_last_line_they_passed():
    assert published.counts_by_last_line(published.EXPERIMENT, "sphere").tolist() == [0, 7, 22, 21]
    assert published.counts_by_last_line(published.EXPERIMENT, "cube").tolist() == [7, 27, 16, 0]
    assert published.counts_by_last_line(published.EXPERIMENT, "parallelepiped").tolist() == [9, 38, 3, 0]


def test_the_probabilities_of_all_counts_add_up_to_one():
    every = [c for c in product(range(6), repeat=4) if sum(c) == 5]
    total = sum(np.exp(log_counts(SIMULATED, np.array(counts))) for counts in every)
    assert total == pytest.approx(1.0)


def test_a_line_left_out_is_the_sum_over_what_it_may_have_been():
    counts = np.array([3, 5, 8, 4])
    for line in range(3):
        both = counts[line] + counts[line + 1]
        total = 0.0
        for first in range(both + 1):
            own = counts.copy()
            own[line], own[line + 1] = first, both - first
            total += np.exp(log_counts(SIMULATED, own))
        assert np.exp(log_counts_without_line(line, SIMULATED, counts)) == pytest.approx(total)


def test_many_simulated_releases_give_the_multinomial():
    share = np.array([0.1, 0.4, 0.3, 0.2])
    counts = np.array([1, 4, 3, 2])
    exact = 12600 * np.prod(share**counts)  # 10! / (1! 4! 3! 2!)
    assert np.exp(log_counts(1e9 * share[None], counts)) == pytest.approx(exact, rel=1e-6)


def test_no_simulated_counts_make_the_filmed_ones_likelier_than_their_own_frequencies():
    for counts in (np.array([1, 4, 3, 2]), np.array([0, 7, 22, 21])):
        assert highest_log_counts(counts) == pytest.approx(log_counts(1e6 * counts[None], counts)[0], abs=1e-3)
        every = np.array([c for c in product(range(0, 41, 2), repeat=4) if sum(c) == 40])
        assert log_counts(every, counts).max() < highest_log_counts(counts)


def test_words_are_fulfilled_or_not():
    ditch, facing = [DITCH_ID] * 40, [FACING_ID] * 40
    some = [FACING_ID] * 8 + [DITCH_ID] * 32
    assert (
        np.exp(first_impact_log_likelihood(outcome(ditch), "sphere"))
        > 0.5
        > np.exp(first_impact_log_likelihood(outcome(some), "sphere"))
    )
    assert (
        np.exp(first_impact_log_likelihood(outcome(some), "cube"))
        > 0.5
        > np.exp(first_impact_log_likelihood(outcome(ditch), "cube"))
    )
    assert np.exp(first_impact_log_likelihood(outcome(facing), "parallelepiped")) > 0.5
    assert np.exp(first_impact_log_likelihood(outcome(some), "parallelepiped")) < 1e-3
    assert (
        first_impact_log_likelihood(outcome(facing, 60.0), "parallelepiped")
        < first_impact_log_likelihood(outcome(facing, 15.0), "parallelepiped") - 7
    )
    assert first_impact_log_likelihood(outcome(ditch, possible=False), "sphere") == -np.inf


def test_the_sampling_floor_is_the_binomial_error():
    """For a true frequency p the error is √(p (1-p) / n), at most 1/2 √(1/50)."""
    mean, bound = summary.sampling_floor(np.s_[:], np.random.default_rng(0))
    p = published.EXPERIMENT / 100
    rough = 100 * np.sqrt((p * (1 - p)).mean() / published.RELEASES)
    assert mean == pytest.approx(rough, rel=0.1) and mean < bound < 7.1


def crossing(shares, releases=20_000):
    """Hypotheses of which these shares of the releases pass every line."""
    passed = np.arange(releases)[None, :] < releases * np.array(shares)[:, None]
    k = len(shares)
    nothing = np.full((k, releases, 7), np.nan)
    return Outcome(np.repeat(passed[..., None], 3, axis=2), np.zeros((k, releases), int), passed * 0.0, nothing,
                   np.ones(k, bool))  # fmt: skip


def test_a_predictive_p_of_one_frequency_is_the_binomial_s():
    from scipy.stats import binom

    assert summary.predictive_p(3, crossing([0.2]), 0) == pytest.approx(2 * binom.cdf(3, 50, 0.2), rel=0.02)
    assert summary.predictive_p(10, crossing([0.2]), 0) > 0.9
    # two hypotheses, of which one excludes the number: half of the other's
    assert summary.predictive_p(3, crossing([0.2, 0.99]), 0) == pytest.approx(binom.cdf(3, 50, 0.2), rel=0.02)


def test_few_simulated_releases_exclude_little():
    assert summary.predictive_p(43, crossing([1.0], 10), 0) > 0.05 > summary.predictive_p(43, crossing([1.0]), 0)


def test_the_likelier_candidate_gets_the_odds_of_its_likelihood():
    """Two hypotheses without a candidate and two with one; the latter pass line 1 as often as was filmed."""
    draw = {"none": 0.1, "adhesion": 0.5}
    values = {"candidate": np.array([draw["none"]] * 2 + [draw["adhesion"]] * 2)}
    cube = crossing([0.2, 0.2, 0.3, 0.3])
    run = summary.HeldOutBlock(values, [cube, cube, cube], "cube")
    table = summary.candidates_table([run]).set_index("candidate")
    ll = run.log_score
    assert table.loc["adhesion", "share"] == 0.5 and table["share_all_cells"].sum() == pytest.approx(1.0)
    odds = np.exp(ll[2] - ll[0]) * table.loc["none", "prior"] / table.loc["adhesion", "prior"]
    assert table.loc["adhesion", "bayes_factor"] == pytest.approx(odds)
    cells = summary.held_out_cells_table([run])
    assert cells["predicted"].tolist() == pytest.approx([20.0] * 3)  # from the hypotheses without a candidate
    assert cells["effective"].tolist() == pytest.approx([2.0] * 3)
