"""Experiments without noise in positions, in angles or in both: a simulation is diagnosed, and the user is told."""

import numpy as np
import pytest

from rock2d.diagnosis.diagnose import CAMERA_NOISE, diagnose, with_camera_noise
from rock2d.diagnosis.diagnosis_content import diagnosis_json
from rock2d.files.diagnosis import diagnosis_text
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import load_film
from tests.diagnosis.test_impact_table_data import impacts, plain_world
from tests.kinematics.synthetic_films import coarse_fits, effects, film, without_angles, world

EFFECTS = effects("air_drag", "camera_tilt", "viscous_damping")


@pytest.mark.parametrize(
    ("noise_m", "noise_rad", "said"),
    [(0.0, 0.0, ["in positions", "in angles"]), (0.0, 0.02, ["in positions"]), (3e-4, 0.0, ["in angles"])],
)
def test_a_simulation_is_diagnosed_with_the_noise_of_a_camera(noise_m, noise_rad, said):
    """A film with both kinds of noise is in `test_attribution.py`."""
    exact = film(world(), 6, seed=1, noise_m=noise_m, noise_rad=noise_rad, soil=0.0)
    with coarse_fits():
        found = diagnose(exact, effects=EFFECTS)
    assert found.verdict == "none"
    (remark,) = [line for line in found.sanity.remarks if "shows no noise" in line]
    assert all(part in remark for part in said)
    assert diagnosis_text(diagnosis_json(found))


def test_what_has_noise_stays_as_it_is():
    for noise in ((3e-4, 0.02), (1e-5, 0.001)):
        seen = film(world(), 4, noise_m=noise[0], noise_rad=noise[1])
        same, remarks = with_camera_noise(seen, FilmSegments.of(load_film(seen), world()).film)
        assert same is seen and not remarks


def test_an_angle_without_marks_stays_unknown():
    exact = without_angles(film(world(), 4, noise_m=0.0, noise_rad=0.0), "sphere", instead=0.0)
    noisy, _ = with_camera_noise(exact, FilmSegments.of(load_film(exact), world()).film)
    spread = noisy.trajectories.groupby("block")["theta_rad"].std()
    assert spread["sphere"] == 0.0 and noisy.angle_noise_rad == CAMERA_NOISE
    assert not np.array_equal(noisy.trajectories["x_m"], exact.trajectories["x_m"])


def test_a_table_of_exact_impacts_is_diagnosed():
    with coarse_fits():
        found = diagnose(impacts(plain_world(), 60, seed=1, noise=0.0), effects=EFFECTS)
    assert found.verdict == "none"
    assert diagnosis_text(diagnosis_json(found))
