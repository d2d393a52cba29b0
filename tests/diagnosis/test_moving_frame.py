"""A camera that moves differently in each release: it has no mean, but moves all impacts of a release together."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.diagnosis.moving_frame import MOTIONS, frame_of_each_release
from rock2d.diagnosis.significance import outside_probability
from rock2d.files.experiment import Experiment
from tests.kinematics.synthetic_films import base_fit, film, world

RELEASES = 12
SHIFT_M, SLIDE_M_S = 0.002, 0.01  # noise of a pose: 0.0003 m


def moved(experiment: Experiment, shift_m: float, slide_m_s: float) -> Experiment:
    """The film of a camera that is shifted and slides by such amounts, in a random direction in each release."""
    table, rng = experiment.trajectories, np.random.default_rng(np.random.SeedSequence(1))
    amounts = rng.normal(size=(table["release"].max() + 1, 2))[table["release"]]
    motion = (shift_m + slide_m_s * table["t_s"].to_numpy())[:, None] * amounts
    return replace(
        experiment, trajectories=table.assign(x_m=table["x_m"] + motion[:, 0], y_m=table["y_m"] + motion[:, 1])
    )


@pytest.fixture(scope="module")
def steady() -> Experiment:
    return film(world(), RELEASES, seed=3)


@pytest.mark.parametrize("errors", [{}, {"noise_m": 1e-3, "soil": 0.15}], ids=["usual", "large"])
def test_neither_noise_nor_a_soil_that_varies_over_the_releases_is_a_moving_frame(errors):
    data, fitted = base_fit(film(world(), RELEASES, seed=3, **errors))
    assert abs(frame_of_each_release(fitted, data).total) < 3.0


@pytest.mark.parametrize(("shift_m", "slide_m_s"), [(SHIFT_M, 0.0), (0.0, SLIDE_M_S)], ids=["shift", "slide"])
def test_a_camera_that_moves_differently_in_each_release_is_something_outside(steady, shift_m, slide_m_s):
    data, fitted = base_fit(moved(steady, shift_m, slide_m_s))
    found = frame_of_each_release(fitted, data)
    assert found.name == "frame of release" and found.significance > 3.0
    assert outside_probability(found, 0.0, MOTIONS) > 0.9
    half = fitted.model.setup.mean_size_m / 2.0
    unit = half if shift_m else np.sqrt(half * fitted.model.setup.gravity_m_s2)
    # the tried sizes differ by a factor of 1.8
    assert abs(np.log(found.width * unit / (shift_m + slide_m_s))) < np.log(1.8)


def test_a_camera_that_is_moved_alike_in_all_releases_is_another_matter(steady):
    """A constant shift of the picture is a ground at another place; it does not vary over the releases."""
    table = steady.trajectories
    data, fitted = base_fit(replace(steady, trajectories=table.assign(x_m=table["x_m"] + 2 * SHIFT_M)))
    assert frame_of_each_release(fitted, data).total == 0.0


def test_a_law_that_is_not_fitted_shows_no_frame(steady):
    data, fitted = base_fit(steady)
    assert frame_of_each_release(replace(fitted, free=False), data).total == 0.0
