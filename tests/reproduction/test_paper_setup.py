"""Which hypothesis becomes the shipped set-up, and what this set-up gives."""

import numpy as np
import pytest

from rock2d.files.scenario import scenario_file
from rock2d.files.scenario_reading import load_scenario
from rock2d.reproduction import paper_setup as module
from rock2d.reproduction import published, summary
from rock2d.reproduction.outcomes import Outcome
from rock2d.reproduction.paper_setup import found_setup, met_cells, side_by_side


def outcome(percents):
    """Of 100 releases of each hypothesis these percentages (k, lines) pass each line."""
    crossed = np.arange(100)[None, :, None] < np.asarray(percents)[:, None, :]
    k = len(crossed)
    nothing = np.full((k, 100, 7), np.nan)
    return Outcome(crossed, np.zeros((k, 100), int), nothing[..., 0], nothing, np.ones(k, bool))


def test_the_deterministic_column_comes_first_then_the_probabilistic_one_then_their_probability(monkeypatch):
    """Hypothesis 0 misses a deterministic cell, 1 three probabilistic ones, 2 and 3 meet all, 3 more closely."""
    det = np.repeat(published.DETERMINISTIC[None], 4, axis=0)
    pro = np.repeat(published.PROBABILISTIC[None], 4, axis=0)
    det[0, 0, 2], pro[1, 0], pro[2, 1, 1] = 90, (100, 100, 100), 44
    under_table_3 = dict(zip(published.BLOCKS, (outcome(pro[:, b]) for b in range(3)), strict=True))
    monkeypatch.setattr(module, "probabilistic_outcome", lambda values, block, *more: under_table_3[block])
    draws = {block: np.zeros((100, 6)) for block in published.BLOCKS}
    found = found_setup({"slope_deg": np.ones(4)}, [outcome(det[:, b]) for b in range(3)], draws)
    assert (found.place, found.of, found.releases) == (3, 4, 100)
    assert found.met() == "deterministic 9 of 9; probabilistic 9 of 9"


def test_missed_cells_are_named():
    agrees = np.ones((3, 3), bool)
    agrees[0, 1] = agrees[0, 2] = False
    assert met_cells(agrees) == "7 of 9 (not sphere line 2 and sphere line 3)"


def test_exact_intervals_are_those_of_the_binomial_test():
    from scipy.stats import binomtest

    for passed, releases in ((0, 50), (1, 50), (23, 50), (50, 50), (960, 2000)):
        own = binomtest(passed, releases).proportion_ci(0.95, method="exact")
        assert summary.clopper_pearson_interval(passed, releases) == pytest.approx((100 * own.low, 100 * own.high))


def test_the_shipped_set_up_meets_the_cells_that_it_says():
    scenario = load_scenario(scenario_file("paper_setup.yaml"))
    table = side_by_side(scenario)
    for model in published.COLUMNS:
        agrees = table[f"{model}_agrees"].to_numpy(bool).reshape(3, 3)
        assert f"{model} {met_cells(agrees)}" in scenario.assumed[1]
    assert table["deterministic_agrees"].all()


def test_a_cell_agrees_where_the_number_lies_in_the_interval_of_the_published_one():
    scenario = load_scenario(scenario_file("paper_setup.yaml"))
    table = side_by_side(scenario, releases=40)
    for model, column in published.COLUMNS.items():
        paper = table[f"paper_{model}"]
        assert paper.tolist() == column.ravel().tolist()
        inside = table[model].between(table[f"paper_{model}_low95"], table[f"paper_{model}_high95"])
        assert (inside == table[f"{model}_agrees"]).all()
        assert table[model].between(table[f"{model}_low95"], table[f"{model}_high95"]).all()
        assert np.allclose((table[model] * 40 / 100) % 1, 0)
    assert table["experiment"].tolist() == published.EXPERIMENT.ravel().tolist()
