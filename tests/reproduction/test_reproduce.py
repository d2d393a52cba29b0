"""`rock2d reproduce`, small: everything is there, the same for the same seed; an interruption costs little."""

import json

import numpy as np
import pandas as pd
import pytest
from rock2d_figures.command import reproduce
from ruamel.yaml import YAML

from rock2d.files.scenario import scenario_file
from rock2d.files.scenario_reading import load_scenario
from rock2d.progress import Bars
from rock2d.reproduction import calibrations, published
from rock2d.reproduction.calibrations import Effort
from rock2d.reproduction.computation import FinishedStages
from rock2d.runs.run import run

# few hypotheses, but enough for the sphere's cells to come within 25 points of what they are fitted to
SMALL = Effort(hypotheses=16, releases=8, moves=1)
FILES = {
    "table_2.csv", "table_3.csv", "table_4.csv", "assumptions.csv", "candidates.csv", "cells.csv",
    "paper_setup.yaml",
    "figure_1.png", "figure_2.png", "figure_3.png", "passing.png", "identified.png", "report.md", "reproduction.json",
    "paper_column.csv", "predicted_with_arrivals.csv", "missing_effects.csv", "table_3_readings.csv",
    "arrivals.png",
}  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduce") / "out"
    reproduce(out, seed=3, effort=SMALL, candidates=True, progress=False, report=lambda line: None)
    return out


def test_every_table_and_figure_is_written(made):
    assert {path.name for path in (made).iterdir()} >= FILES
    assert [path.name for path in made.parent.iterdir()] == ["out"]
    table = pd.read_csv(made / "table_2.csv")
    assert len(table) == 9
    inside = table[["deterministic", "probabilistic"]].to_numpy()
    assert (inside >= 0).all() and (inside <= 100).all()
    assert (table["deterministic_low95"] <= table["deterministic_high95"]).all()
    sphere = table[table["block"] == "sphere"]  # what it was calibrated on
    assert (sphere["deterministic"] - sphere["experiment"]).abs().max() < 25
    errors = json.loads((made / "reproduction.json").read_text())["rmse_points"]
    assert errors["paper, deterministic: validation cells"] == pytest.approx(12.0, abs=0.05)
    assert (made / "report.md").read_text().count("Assumptions") == 1


def test_the_shipped_set_up_has_the_form_of_the_written_one(made):
    written, shipped = made / "paper_setup.yaml", scenario_file("paper_setup.yaml")
    scenario = load_scenario(written)
    assert scenario.seed == 3 and "`rock2d reproduce --seed 3`" in scenario.assumed[0]
    assert len(run(scenario, engine="point_mass", releases=1, workers=1).tracks) == 3
    assert outline(written) == outline(shipped)


def outline(path):
    """The keys of a YAML file and how long its lists are."""

    def keys(value):
        if isinstance(value, dict):
            return {key: keys(own) for key, own in value.items()}
        return [keys(own) for own in value] if isinstance(value, list) else None

    return keys(YAML(typ="safe").load(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("calibrate", "effort", "seed"),
    [
        (calibrations.calibrate_deterministic, SMALL, 3),
        (calibrations.calibrate_with_arrivals, Effort(hypotheses=32, releases=10, moves=1), 2),
    ],
    ids=["first impacts", "arrivals"],
)
def test_a_calibration_has_the_same_bits_for_the_same_seed_and_learns_nothing_from_the_validation(
    monkeypatch, calibrate, effort, seed
):

    def calibrated():
        return calibrate(effort, np.random.SeedSequence(seed), lambda share: None).u

    first = calibrated()
    monkeypatch.setattr(published, "EXPERIMENT", np.array([[100, 86, 42], [50, 50, 50], [4, 2, 2]]))
    assert (calibrated() == first).all()


def test_slope_reductions_are_those_of_their_own_block(monkeypatch):
    """Of likelihoods that peak at one α a block, that α is drawn; the sphere has none."""
    peaks = {"cube": 12.0, "parallelepiped": 42.0}
    asked = []

    def outcome(values, block, draws, alpha):
        asked.append(alpha)
        return alpha

    monkeypatch.setattr(calibrations, "probabilistic_outcome", outcome)
    monkeypatch.setattr(calibrations, "passing_log_likelihood", lambda alpha, block: -((alpha - peaks[block]) ** 2))
    u = np.full((5, len(calibrations.PROBABILISTIC_SPACE.quantities)), 0.5)
    found = calibrations.calibrate_slope_reductions(u, SMALL, np.random.SeedSequence(1), lambda share: None)
    assert found["sphere"].tolist() == [0.0] * 5
    assert all((found[block] == peak).all() for block, peak in peaks.items())
    assert len(asked) == 2 * len(calibrations.SLOPE_REDUCTIONS_DEG)


def test_what_was_finished_before_an_interruption_is_not_asked_again(tmp_path):
    def pressed(on_progress):
        raise KeyboardInterrupt

    work = FinishedStages(tmp_path / "kept", {"seed": 1}, Bars(False))
    assert work.arrays("one", lambda on_progress: {"a": np.arange(3)})["a"].tolist() == [0, 1, 2]
    with pytest.raises(KeyboardInterrupt):
        work.arrays("two", pressed)
    again = FinishedStages(tmp_path / "kept", {"seed": 1}, Bars(False))
    assert again.arrays("one", pressed)["a"].tolist() == [0, 1, 2]
    with pytest.raises(KeyboardInterrupt):  # with another seed, nothing is finished
        FinishedStages(tmp_path / "kept", {"seed": 2}, Bars(False)).arrays("one", pressed)
