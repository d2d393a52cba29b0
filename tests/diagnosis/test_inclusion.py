"""Probabilities of the single answers beside those of sets."""

from __future__ import annotations

import numpy as np
import pytest

from rock2d.diagnosis.inclusion import BesideLearnt, explained_away, with_rivals
from rock2d.diagnosis.significance import Gain

CHANCES = {"geometry_error": 0.6, "air_drag": 0.1, "camera_tilt": 0.1, "none": 0.05, "unknown": 0.15}


def test_what_other_effects_explain_gives_its_share_to_them():
    """An effect that gains most alone, but nothing beside the two that are there."""
    found = explained_away(CHANCES, {"geometry_error": 0.02, "air_drag": 0.99, "camera_tilt": 0.49})
    assert found["geometry_error"] < 0.1 and found["air_drag"] / found["camera_tilt"] == pytest.approx(2.0)
    assert sum(found.values()) == pytest.approx(1.0)
    assert (found["none"], found["unknown"]) == (0.05, 0.15)


@pytest.mark.parametrize("same", [0.0, 0.3, 1.0])
def test_equal_inclusion_changes_nothing(same):
    included = dict.fromkeys(("geometry_error", "air_drag", "camera_tilt"), same)
    assert explained_away(CHANCES, included) == pytest.approx(CHANCES)


def gain(total, releases=40):
    return Gain(np.full(releases, total / releases))


@pytest.mark.parametrize(
    ("added", "alone", "instead", "needless"),
    [
        (0.0, 20.0, 100.0, True),  # the learnt change explains it
        (200.0, 50.0, 5000.0, True),  # what a smooth curve misses of a push that begins at a height
        (200.0, 50.0, 300.0, False),  # more than a curve misses
        (200.0, 4000.0, 5000.0, False),  # the learnt change does what the effect does
    ],
)
def test_an_effect_beside_a_learnt_change_must_explain_more_than_that_may_miss(
    added, alone, instead, needless
):
    assert BesideLearnt(gain(added), gain(alone), gain(instead)).needless == needless


def test_a_gain_is_compared_with_the_largest_and_with_what_has_no_name():
    gains = {"air_drag": np.log1p(100.0), "camera_tilt": np.log1p(10.0), "magnus_lift": 0.0}
    causes = {name: {"log_gain": float(own)} for name, own in gains.items()}
    found = with_rivals(causes, {"learnt_log": float(np.log1p(1000.0)), "left_log": -3.0})
    assert found["air_drag"]["largest_over"] == 0.0
    assert found["air_drag"]["nameless_over"] == pytest.approx(np.log(1001 / 101))
    assert found["camera_tilt"]["largest_over"] == pytest.approx(np.log(101 / 11))
    assert found["magnus_lift"]["largest_over"] == found["magnus_lift"]["nameless_over"] == 0.0
