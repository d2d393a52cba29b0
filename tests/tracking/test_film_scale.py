"""Scale and frame rate tied by gravity, and what is proposed to a user."""

import pytest
from rock2d_tracking.film_scale import FilmScale, proposal

from rock2d.kinematics.flight_gravity import Measured


def test_of_scale_and_frame_rate_a_fall_gives_the_other():
    whole = FilmScale(0.002, 120.0)
    assert whole.g_px_frame2 == pytest.approx(9.81 / 0.002 / 120.0**2)
    assert FilmScale(0.002, None).completed(whole.g_px_frame2).fps == pytest.approx(120.0)
    assert FilmScale(None, 120.0).completed(whole.g_px_frame2).metres_per_pixel == pytest.approx(0.002)
    assert FilmScale(0.002, None).g_px_frame2 == 0.0 and whole.completed(3.0) == whole


def test_a_film_of_200_frames_per_second_that_is_played_at_30():
    ratio = Measured((30.0 / 201.0) ** 2, 0.02 * (30.0 / 201.0) ** 2)
    would = proposal(FilmScale(0.0015, 30.0), ratio)
    assert would.fps.value == pytest.approx(201.0) and would.fps.error == pytest.approx(2.01)
    assert would.metres_per_pixel.value == pytest.approx(0.0015 * 6.7**2)
    assert would.usual_fps == 200
    said = would.sentence(options=True)
    assert "201 ± 2 frames/s" in said and "`--fps 200`" in said and "`--fps gravity`" in said
    assert "`--metres-per-pixel 0.06734`" in said
    assert "`fps: 200`" in would.sentence(options=False)


def test_a_frame_rate_that_is_not_surely_a_usual_one_is_not_rounded():
    exact = proposal(FilmScale(0.0015, 210.0), Measured(1.0, 0.002))
    rough = proposal(FilmScale(0.0015, 55.0), Measured(1.0, 0.2))  # 50 or 60
    assert exact.usual_fps is None and "`--fps 210`" in exact.sentence(options=True)
    assert rough.usual_fps is None
