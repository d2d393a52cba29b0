"""Blind cases from a real record: releases of it, with known causes put in."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rock2d.blind.case_files import make_trial, read_labels
from rock2d.blind.record_cases import SHARE_OF_RECORDS, Record, records_of_cases, write_record_case
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.detection import Curve
from rock2d.diagnosis.fitting import Convergence, fit
from rock2d.files.experiment import load_experiment
from rock2d.kinematics.flights import load_film
from tests.blind.test_injection import MODEL
from tests.kinematics.synthetic_films import film, world

POSE = ["x_m", "y_m", "theta_rad"]
SEED = np.random.SeedSequence(5)


@pytest.fixture(scope="module")
def record():
    experiment = replace(film(world(), 12, seed=1), name="tests")
    fitted = fit(MODEL, FilmData.of(load_film(experiment), world()), MODEL.start(), convergence=Convergence(rounds=1))
    curves = {"scale_error": Curve(0.01, 3.0, "", 0.01, 1.0, False, 0.1)}
    return Record(experiment, world(), fitted, ["air_drag"], curves)


def films(record, causes, folder, seed=SEED):
    label = write_record_case(record, causes, seed, folder / "fit", folder / "heldout")
    return label, *(load_experiment(folder / name).trajectories for name in ("fit", "heldout"))


def test_a_case_without_cause_is_a_part_of_the_record_divided_by_release(record, tmp_path):
    label, fitted, heldout = films(record, (), tmp_path)
    assert set(fitted["release"]).isdisjoint(heldout["release"])
    assert (label["releases"], label["label"]) == (fitted["release"].nunique(), "none")
    assert (label["base"], label["of_record"]) == ("tests", ["air_drag"])
    both = pd.concat([fitted, heldout]).merge(record.experiment.trajectories, on=["release", "t_s"])
    assert len(both) == len(fitted) + len(heldout)
    for name in POSE:
        np.testing.assert_allclose(both[f"{name}_x"], both[f"{name}_y"], atol=1e-9)


def test_the_label_says_what_was_put_in(record, tmp_path):
    (label, fitted, _), (plain, as_it_is, _) = (
        films(record, causes, tmp_path / str(len(causes))) for causes in (("scale_error",), ())
    )
    (own,) = label["hidden"]
    scale = own["values"]["scale"]
    assert label["releases"] == plain["releases"] and scale != 1.0
    width = [np.ptp(table["x_m"]) for table in (fitted, as_it_is)]
    assert width[0] / width[1] == pytest.approx(scale, rel=1e-3)
    share = np.sqrt(label["releases"] / record.experiment.trajectories["release"].nunique())
    assert own["signal_to_noise"] == pytest.approx(3.0 * abs(scale - 1.0) / 0.01 * share)


def test_a_cause_of_the_motion_is_in_both_films(record, tmp_path):
    """Their releases are pieces of those of the record; none is in both."""
    (label, *both), (_, *as_it_is) = (
        films(record, causes, tmp_path / str(len(causes))) for causes in (("air_drag",), ())
    )
    assert label["hidden"][0]["values"]["drag_per_mass_1_m"] > 0.0
    for own, plain in zip(both, as_it_is, strict=True):
        assert own["release"].nunique() > plain["release"].nunique()
        assert 0.5 * len(plain) < len(own) <= len(plain)
        moved = own[POSE].merge(plain[POSE], how="outer", indicator=True)["_merge"] == "left_only"
        assert moved.any()


def test_a_third_of_the_cases_have_a_record_and_the_others_stay_the_same(record, tmp_path, small):
    causes = [("scale_error",), ("rounded_edges", "wind"), (), ("mirrored_angle",), ("camera_tilt",), ()]
    bases = records_of_cases(causes, 2, SEED)
    assert sum(base is not None for base in bases) == round(SHARE_OF_RECORDS * len(causes))
    assert bases[1] is None and bases[3] is None  # an outside cause, and a choice, cannot be put in
    assert records_of_cases(causes, 0, SEED) == [None] * len(causes)
    for name, records in (("with", [record]), ("without", [])):
        make_trial(2, 3, tmp_path / name, causes=[(), ()], records=records)
    with_record, without = (read_labels(tmp_path / name) for name in ("with", "without"))
    based = [name for name, label in with_record.items() if "base" in label]
    assert len(based) == 1
    (made,) = set(without) - set(based)
    assert with_record[made] == without[made]
