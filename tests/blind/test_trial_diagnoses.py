"""How the diagnoses of a trial are compared with films that they did not see."""

import numpy as np

from rock2d.blind.trial_diagnoses import _typical_variance


def test_a_film_without_impacts_has_no_typical_variance_and_no_warning():
    """A warning is an error in these tests."""
    assert np.isnan(_typical_variance(np.empty((0, 3, 3)))).all()
    variance = np.array([[1.0, 2.0], [3.0, 4.0], [2.0, 9.0]])
    assert _typical_variance(variance[:, :, None] * np.eye(2)).tolist() == [2.0, 4.0]
