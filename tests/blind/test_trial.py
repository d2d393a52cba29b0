"""Blind trials: what is sealed stays sealed, is the same from the same seed, and the score says what it should."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from rock2d.blind import case_files, command, reality
from rock2d.blind.case_files import KIND, make_trial, read_index, read_labels
from rock2d.blind.cases import SHARE_OUTSIDE, SHARE_WITHOUT_CAUSE, assign_causes, draw_case
from rock2d.blind.scoring import auroc, calibration_error, chance_error, scored_cases
from rock2d.blind.signal_to_noise import signals_to_noise
from rock2d.cluster import Workers
from rock2d.effects import catalogue
from rock2d.errors import InputError
from rock2d.files.experiment import load_experiment
from rock2d.files.folders import RESULT_MARKER
from tests.blind.test_scoring import write_trial
from tests.kinematics.synthetic_films import coarse_fits
from tests.programs import cluster, commanded


def test_every_effect_and_enough_other_cases_are_assigned():
    causes = assign_causes(200, np.random.SeedSequence(1))
    outside = [own for own in causes if set(own) & set(reality.OUTSIDE)]
    assert len(causes) == 200
    assert causes.count(()) >= 0.2 * 200 <= SHARE_WITHOUT_CAUSE * 200
    assert len(outside) >= SHARE_OUTSIDE * 200 >= 0.15 * 200
    assert {name for own in outside for name in own} - set(catalogue()) == set(reality.OUTSIDE)
    assert sum(len(own) == 1 for own in outside) == len(outside) / 2
    effects = [set(own) & set(catalogue()) for own in causes]
    assert all(len(own) == len(set(own)) for own in causes) and max(map(len, effects)) == 4
    assert sum(len(own) >= 2 for own in effects) >= 0.35 * 200
    turns = [sum(name in own for own in effects) for name in catalogue()]
    assert max(turns) - min(turns) <= 2  # every effect has its turn
    assert causes == assign_causes(200, np.random.SeedSequence(1))


def test_the_reality_knows_every_effect_of_the_catalogue_in_two_forms():
    missing, extra = set(catalogue()) - set(reality.FORMS), set(reality.FORMS) - set(catalogue())
    assert not missing, f"reality/known/ has no file for {sorted(missing)}"
    assert not extra, f"the catalogue has no effect for {sorted(extra)} of reality/known/"
    assert min(reality.FORMS.values()) >= 2
    assert len(reality.OUTSIDE) >= 6


def test_a_trial_is_the_same_from_the_same_seed_and_reads_as_experiments(tmp_path, small):
    causes = [("air_drag",), (), ("late_angle",)]
    digests = [make_trial(3, 7, tmp_path / name, causes=causes) for name in "ab"]
    assert digests[0] == digests[1]
    for path in sorted((tmp_path / "a").rglob("*.csv")):
        assert path.read_bytes() == (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes()
    assert [v["label"] for v in read_labels(tmp_path / "a").values()] == ["air_drag", "none", "unknown"]
    for part in ("fit", "heldout"):
        assert load_experiment(tmp_path / "a" / "cases" / "000" / part).trajectories is not None
    public = (tmp_path / "a" / "cases.json").read_text() + "".join(
        p.read_text() for p in (tmp_path / "a" / "cases").rglob("experiment.yaml")
    )
    assert "air_drag" not in public and "late_angle" not in public


def test_twins_are_the_same_releases_without_the_causes(tmp_path, monkeypatch):
    """Those of a case without causes that was drawn with the same seed; of a case without causes, its own films."""
    monkeypatch.setattr(case_files, "signals_to_noise", lambda case: (0.0, [0.0] * len(case.hidden)))  # nobody asks
    causes = [(), ("camera_tilt", "frame_rate_error", "spin_kick"), ("air_drag", "sliding_camera")]
    for number, own in enumerate(causes):
        case = draw_case(own, np.random.SeedSequence(3), smallest=True)
        case_files.write_case(case, tmp_path / str(number) / "000")
    without = tmp_path / "0" / "000"
    for number, own in enumerate(causes):
        for film, twin in (("fit", "twin_fit"), ("heldout", "twin")):
            folder = tmp_path / str(number) / "000"
            for name in ("trajectories.csv", "experiment.yaml"):
                assert (folder / twin / name).read_bytes() == (without / film / name).read_bytes()
            seen, clean = (load_experiment(folder / part).trajectories for part in (film, twin))
            assert seen.equals(clean) == (not own)


def test_each_film_of_a_case_is_a_series_of_its_own():
    """A file numbers the releases of a block in their order, and the soil remembers only those of its own file."""
    case = draw_case(("soil_compaction",), np.random.SeedSequence(5))
    for heldout in (False, True):
        for block in np.unique(case.releases.block_ids):
            own = case.releases.order[(case.releases.block_ids == block) & (case.heldout == heldout)]
            assert own.tolist() == list(range(len(own))) and len(own) > 1


def test_labels_that_were_changed_are_refused(tmp_path, small):
    make_trial(1, 3, tmp_path / "t", causes=[()])
    path = tmp_path / "t" / "labels.json"
    path.write_text(path.read_text().replace("none", "air_drag"))
    with pytest.raises(InputError, match="SHA-256"):
        read_labels(tmp_path / "t")


def test_a_trial_with_diagnoses_is_not_made_again(tmp_path):
    write_trial(tmp_path, {"000": ({}, {"verdict": "none"})})
    (tmp_path / RESULT_MARKER).write_text(json.dumps({"kind": KIND}))
    done = commanded("blind", "make", "--cases", 1, "--seed", 1, "--out", tmp_path, "--quiet")
    assert isinstance(done.exception, InputError) and "holds diagnoses" in str(done.exception)
    assert (tmp_path / "results" / "000.json").is_file()


def test_signal_to_noise_grows_with_what_is_hidden_and_falls_with_the_noise():
    seed = np.random.SeedSequence(5)
    case = draw_case(("camera_tilt",), seed, smallest=True)
    case.hidden = [reality.Hidden("camera_tilt", 0, case.hidden[0].values | {"turn_rad": 0.0005})]
    one, _ = signals_to_noise(case)
    case.hidden = [reality.Hidden("camera_tilt", 0, case.hidden[0].values | {"turn_rad": 0.001})]
    two, _ = signals_to_noise(case)
    assert two == pytest.approx(2 * one, rel=0.1)  # while no block lands on another corner
    noise = {"position_noise_m": 3 * case.camera.position_noise_m, "angle_noise_rad": 3 * case.camera.angle_noise_rad}
    case.camera = replace(case.camera, **noise)
    assert signals_to_noise(case)[0] < two


def test_a_strong_cause_does_not_make_the_signal_of_a_weak_one_larger():
    """A mirrored axis moves many statistics beyond their limit. The others can only imitate a part of the weak one."""
    case = draw_case(("soil_compaction", "mirrored_axis"), np.random.SeedSequence(5), smallest=True)
    _, each = signals_to_noise(case)
    for cause, beside in zip(case.hidden, each, strict=True):
        case.hidden = [cause]
        assert beside <= signals_to_noise(case)[0] * (1.0 + 1e-9)


@pytest.mark.parametrize("seed", [0, 3])
def test_a_cause_that_is_another_law_has_hardly_a_signal(seed):
    """A soil that was 15 % stiffer in every release is the soil of another law: a fit removes all of its signal. It is
    15 to 50 times smaller than what this change of stiffness is, compared with the scatter of the soil alone. The fit
    is not exact, because blocks that land on another corner answer to any small change."""
    case = draw_case(("soil_compaction",), np.random.SeedSequence(seed))
    growth, order = 0.05, np.full_like(case.releases.order, 20)
    case.hidden = [reality.Hidden("soil_compaction", 0, {"growth": growth, "blows": 0.0})]
    case.releases = replace(case.releases, order=order)
    stiffer = np.log1p(growth * np.log1p(order[0]))
    known_law = stiffer / case.soil_sd[0] * np.sqrt((~case.heldout).sum())
    assert signals_to_noise(case)[0] < 0.15 * known_law


def test_calibration_error_of_known_cases():
    p = np.full(100, 0.7)
    right = np.arange(100) % 10 < 7
    assert calibration_error(p, right.astype(float)) == pytest.approx(0.0, abs=1e-12)
    assert calibration_error(p, np.zeros(100)) == pytest.approx(0.7)
    # 200 forecasts of 0.7 that hold: ten bins of 20, each off by 0.8 standard deviations of 0.10
    assert chance_error(np.full(200, 0.7)) == pytest.approx(0.8 * np.sqrt(0.7 * 0.3 / 20), rel=0.1)
    assert auroc(np.array([0.1, 0.4, 0.35, 0.8]), np.array([0, 0, 1, 1])) == 0.75


def test_cases_are_diagnosed_without_their_labels_and_on_a_scheduler_to_the_same_bytes(tmp_path, small, monkeypatch):
    def written(trial, workers: Workers) -> str:
        make_trial(1, 3, trial, causes=[()])
        labels = (trial / "labels.json").rename(tmp_path / "labels.json")
        with coarse_fits():
            command.run(trial, workers=workers, progress=False, report=lambda line: None)
        text = (trial / "results" / "000.json").read_text()
        with pytest.raises(InputError, match="sealed elsewhere"):
            scored_cases(trial)
        labels.rename(trial / "labels.json")
        assert len(scored_cases(trial)) == 1
        assert [path.name for path in trial.glob(".*")] == []
        return re.sub(r'"seconds": [^,]*', "", text)

    few = {"camera_tilt": catalogue()["camera_tilt"]}
    monkeypatch.setattr("rock2d.diagnosis.diagnose.catalogue", lambda: few)
    here = written(tmp_path / "process", Workers(1))
    result = json.loads((tmp_path / "process" / "results" / "000.json").read_text())
    assert sum(result["diagnosis"]["probabilities"].values()) == pytest.approx(1.0)
    with cluster(1) as dask:
        assert written(tmp_path / "scheduler", Workers(scheduler=dask.scheduler_address)) == here
        assert dask.workers[0].state.executed_count == 1


def test_a_case_that_a_dead_worker_began_is_made_again(tmp_path):
    case = draw_case((), np.random.SeedSequence(1), smallest=True)
    label = case_files.write_case(case, tmp_path / "000")
    whole = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    for path in whole:
        path.write_bytes(b"half")
    assert case_files.write_case(case, tmp_path / "000") == label
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == whole


@pytest.mark.parametrize("damage", ["[" * 100_000, "[]", '{"diagnosis": {"probabilities": 3}}'])
def test_a_damaged_result_is_refused_with_its_file(tmp_path, damage):
    write_trial(tmp_path, {"000": ({"label": "none"}, {})})
    (tmp_path / "results" / "000.json").write_text(damage)
    with pytest.raises(InputError, match=r"000\.json"):
        scored_cases(tmp_path)


@pytest.mark.parametrize("index", ["[]", '{"count": "1", "seed": 1, "labels_sha256": ""}', "\x00"])
def test_a_damaged_index_of_a_trial_is_refused(tmp_path, index):
    (tmp_path / "cases.json").write_text(index)
    with pytest.raises(InputError, match=r"cases\.json"):
        read_index(tmp_path)
