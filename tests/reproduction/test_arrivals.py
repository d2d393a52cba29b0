"""Arrivals from the paper's own simulations, and the candidates that are judged on them."""

import numpy as np
import pytest

from rock2d.calibration.sequential_monte_carlo import prior_draws
from rock2d.reproduction import calibrations, published
from rock2d.reproduction.arrival_results import comparison_table
from rock2d.reproduction.hypotheses import DETERMINISTIC_SPACE, PROBABILISTIC_SPACE, contact_table, table_4
from rock2d.reproduction.missing_effects import LARGEST_SLOPE_REDUCTION_DEG, SIZES, held_out_score, probabilistic_with
from rock2d.reproduction.outcomes import Outcome


def test_table_4_replaces_the_law_and_nothing_else():
    values = DETERMINISTIC_SPACE.values(prior_draws(8, len(DETERMINISTIC_SPACE.quantities), np.random.default_rng(1)))
    paper = table_4(values)
    assert contact_table(paper)[:, 0, :5] == pytest.approx(
        np.tile([1e4, 6e4, 2.5e3, np.tan(np.radians(30.0)), 0.025], (8, 1))
    )
    changed = {name for name in values if (values[name] != paper[name]).any()}
    assert changed == {"k_l_N_m", "restitution", "k_t_N_m", "friction_angle_deg", "k_r_Nm_rad"}


def test_the_paper_s_column_in_counts():
    assert published.counts_by_last_line(published.DETERMINISTIC, "sphere").tolist() == [0, 1, 28, 21]
    assert published.counts_by_last_line(published.DETERMINISTIC, "cube").tolist() == [0, 27, 22, 1]


def test_every_unknown_moves_and_each_factor_hears_of_its_own():
    for space in (DETERMINISTIC_SPACE, PROBABILISTIC_SPACE, calibrations.CANDIDATE_SPACE):
        groups = [
            calibrations.setup_columns(space),
            calibrations.law_columns(space),
            *(calibrations.arrival_columns(space, b) for b in published.BLOCKS),
        ]
        assert sorted(np.concatenate(groups)) == list(range(len(space.quantities)))
    factors = calibrations.arrival_factors({block: np.zeros((1, 6)) for block in published.BLOCKS})
    law = set(calibrations.law_columns(DETERMINISTIC_SPACE))
    assert [bool(law & set(f.columns)) for f in factors] == [False] * 6 + [True]


def test_a_candidate_is_chosen_by_its_value():
    chosen = calibrations.candidate_indices(
        {"candidate": np.array([calibrations.candidate_value(name) for name in calibrations.CANDIDATES])}
    )
    assert chosen.tolist() == list(range(len(calibrations.CANDIDATES)))


@pytest.mark.parametrize(("block", "out_of_round"), [("sphere", 0.0), ("cube", 1.0), ("parallelepiped", 4.086)])
def test_the_shape_of_a_point_mass_grows_with_how_far_the_block_is_from_round(block, out_of_round):
    """In units of a cube's; a parallelepiped of 3.5 by 1.4 cm: (√(3.5² + 1.4²) / 1.4 - 1) / (√2 - 1) = 4.086."""
    values = PROBABILISTIC_SPACE.values(np.full((1, len(PROBABILISTIC_SPACE.quantities)), 0.5))
    size = np.array([0.2])
    changed, reduction = probabilistic_with("shape", values, published.SETUP_BLOCKS[block], size)
    assert reduction == pytest.approx(out_of_round * 0.2 * LARGEST_SLOPE_REDUCTION_DEG, rel=2e-3)
    assert changed == dict(values)
    _, alike = probabilistic_with("slope_reduction", values, published.SETUP_BLOCKS[block], size)
    assert alike == pytest.approx(0.2 * LARGEST_SLOPE_REDUCTION_DEG * (out_of_round > 0))


def test_the_score_of_a_candidate_is_the_mean_probability_of_what_it_did_not_see():
    """Of two groups of hypotheses the calibration excludes one; what the other predicts is the score."""
    groups = 20
    known, ahead = np.repeat([0.0, -50.0], groups // 2 * SIZES), np.repeat([-1.0, 0.0], groups // 2 * SIZES)
    plain = np.stack([known, np.full_like(known, -3.0), np.zeros_like(known)], axis=-1)
    better = np.stack([known, ahead, np.zeros_like(known)], axis=-1)
    percent = np.zeros((2, groups * SIZES, 3, 3))
    percent[1, : groups // 2 * SIZES] = 40.0
    found = {"log_likelihood": np.stack([plain, better]), "percent": percent}
    score = held_out_score(found, 1, ["sphere"], ["cube"], seed=1)
    assert score.log_score == pytest.approx(-1.0) and score.over_none == pytest.approx(2.0)
    assert score.percent == pytest.approx(np.full((1, 3), 40.0))
    assert score.effective == pytest.approx(groups / 2 * SIZES)
    none = held_out_score(found, 0, ["sphere"], ["cube"], seed=1)
    assert none.over_none == 0.0 and none.error == 0.0


def test_cells_stand_beside_those_of_the_table_that_they_are_for():
    """Of 100 releases of each of two hypotheses all pass line 1 and none the others."""
    crossed = np.zeros((2, 100, 3), bool)
    crossed[:, :, 0] = True
    nothing = np.full((2, 100, 7), np.nan)
    outcome = Outcome(crossed, np.zeros((2, 100), int), nothing[..., 0], nothing, np.ones(2, bool))
    for percent in (published.DETERMINISTIC, published.EXPERIMENT):
        table = comparison_table([outcome] * 3, percent)
        assert table["published"].tolist() == percent.ravel().tolist()
        assert table["predicted"].tolist() == [100.0, 0.0, 0.0] * 3
        assert (table["published"].between(table["published_low95"], table["published_high95"])).all()
    excluded = table.set_index(["block", "line"])["p"]
    assert excluded["sphere", "line_1"] > 0.5 and excluded["sphere", "line_2"] < 1e-3
