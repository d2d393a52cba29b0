"""Probabilities of the single answers beside those of sets."""

from __future__ import annotations

import pytest

from rock2d.diagnosis.inclusion import explained_away

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
