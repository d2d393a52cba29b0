"""Experiments without noise in positions, in angles or in both: a simulation is diagnosed, and the user is told."""

from __future__ import annotations

import numpy as np
import pytest

from rock2d.diagnosis.diagnose import diagnose
from rock2d.diagnosis.diagnosis_content import diagnosis_json
from rock2d.effects import catalogue
from rock2d.files.diagnosis import diagnosis_text
from rock2d.kinematics.flights import MODEL_RESOLUTION, load_film
from tests.diagnosis.test_impact_table_data import impacts, plain_world
from tests.kinematics.synthetic_films import BLOCKS, film, world

NAMES = ("air_drag", "camera_tilt", "viscous_damping")


@pytest.mark.parametrize(
    ("noise_m", "noise_rad", "said"),
    [
        (0.0, 0.0, ["of positions", "of angles"]),
        (0.0, 0.02, ["of positions"]),
        (3e-4, 0.0, ["of angles"]),
        (3e-4, 0.02, []),
    ],
)
def test_a_simulation_has_the_noise_that_the_law_can_resolve(noise_m, noise_rad, said):
    exact = film(world(), 10, seed=1, noise_m=noise_m, noise_rad=noise_rad, soil=0.0)
    found = diagnose(exact, effects={name: catalogue()[name] for name in NAMES})
    assert found.verdict == "none"
    remarks = [line for line in found.sanity.remarks if "noise" in line]
    assert len(remarks) == bool(said) and all(part in line for line in remarks for part in said)
    assert diagnosis_text(diagnosis_json(found))


def test_the_noise_of_a_camera_is_that_of_its_film():
    least = MODEL_RESOLUTION * min(block.radius_m for block in BLOCKS.values())
    exact, seen = (load_film(film(world(), 4, noise_m=noise)) for noise in (0.0, 1e-5))
    assert exact.noise[:2] == pytest.approx([least, least])
    assert np.all(seen.noise[:2] > 5e-6)  # no floor changes what a camera shows


def test_a_table_of_exact_impacts_is_diagnosed():
    found = diagnose(
        impacts(plain_world(), 60, seed=1, noise=0.0), effects={n: catalogue()[n] for n in NAMES}
    )
    assert found.verdict == "none"
    assert diagnosis_text(diagnosis_json(found))
