"""Probabilities of the single answers beside those of sets."""

from __future__ import annotations

import numpy as np
import pytest

from rock2d.diagnosis.inclusion import BesideLearnt, explained_away, inclusion, with_groups, with_rest
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


NOTHING_LEFT = {"left_flight_z": 0.0, "left_impact_z": 0.0}


def test_what_is_left_counts_where_the_effect_acts():
    """A drag leaves nothing in flights, whatever impacts depend on; a wrong frame rate nothing anywhere."""
    causes = {name: {"log_gain": 5.0} for name in ("air_drag", "adhesion", "frame_rate_error")}
    causes["magnus_lift"] = {"log_gain": 0.0}
    found = with_rest(
        causes, {"learnt_log": 0.0, "left_log": 0.0}, {"left_flight_z": 5.0, "left_impact_z": 3.0}
    )
    left = {name: (own["flight_left_z"], own["impact_left_z"]) for name, own in found.items()}
    flight, impact = float(np.log1p(5.0 - 2.0)), float(np.log1p(3.0 - 2.0))
    assert left == {
        "air_drag": (flight, 0.0),
        "adhesion": (0.0, impact),
        "frame_rate_error": (flight, impact),
        "magnus_lift": (0.0, 0.0),
    }


def test_a_gain_is_compared_with_the_largest_and_with_what_has_no_name():
    gains = {"air_drag": np.log1p(100.0), "camera_tilt": np.log1p(10.0), "magnus_lift": 0.0}
    causes = {name: {"log_gain": float(own)} for name, own in gains.items()}
    found = with_rest(causes, {"learnt_log": float(np.log1p(1000.0)), "left_log": -3.0}, NOTHING_LEFT)
    assert found["air_drag"]["largest_over"] == 0.0
    assert found["air_drag"]["nameless_over"] == pytest.approx(np.log(1001 / 101))
    assert found["camera_tilt"]["largest_over"] == pytest.approx(np.log(101 / 11))
    assert found["magnus_lift"]["largest_over"] == found["magnus_lift"]["nameless_over"] == 0.0


NOTHING_LARGER = {"learnt_log": 0.0, "left_log": 0.0}, NOTHING_LEFT


def own_statistics(z, gain):
    return {"z": z, "log_gain": float(np.log1p(gain)), "beside_learnt_z": z, "scatter": 0.0}


def included(ahead_z, rivals, together_z=15.0, gain=300.0):
    """Inclusion of a scale error that gains much, but is little ahead of others; with a drag that has no rival."""
    causes = dict.fromkeys(("frame_rate_error", "lens_distortion"), own_statistics(-ahead_z, 0.0))
    causes |= {"scale_error": own_statistics(ahead_z, ahead_z), "air_drag": own_statistics(9.0, 50.0)}
    together = causes | {"scale_error": own_statistics(together_z, gain)}
    return inclusion(
        with_groups(
            with_rest(causes, *NOTHING_LARGER),
            with_rest(together, *NOTHING_LARGER),
            {"scale_error": rivals, "air_drag": []},
        )
    )


def test_two_effects_that_can_stand_for_each_other_share_what_is_beyond_doubt():
    alone, tied = included(0.0, []), included(0.0, ["frame_rate_error"])
    assert alone["scale_error"] < 0.1
    assert tied["scale_error"] == pytest.approx(tied["frame_rate_error"])
    assert tied["scale_error"] + tied["frame_rate_error"] > 0.9
    assert tied["air_drag"] == alone["air_drag"] > 0.9


def test_the_effect_ahead_has_the_larger_share_and_more_rivals_have_less_each():
    ahead = included(2.0, ["frame_rate_error"])
    assert 0.8 < ahead["scale_error"] < 0.9 and ahead["frame_rate_error"] < 0.15
    three = included(0.0, ["frame_rate_error", "lens_distortion"])
    assert three["scale_error"] == pytest.approx(three["lens_distortion"])
    assert 0.3 < three["scale_error"] < 0.34


def test_a_group_that_gains_little_is_not_sure_either():
    assert included(0.0, ["frame_rate_error"], 1.0, 1.0)["scale_error"] < 0.1
