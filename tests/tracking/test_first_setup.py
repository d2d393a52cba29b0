"""A first track from scale and frame rate alone, and what a failure leaves behind."""

from __future__ import annotations

import cv2
import numpy as np
import pandas as pd
import pytest
from rock2d_tracking import tracked_film
from rock2d_tracking.command import FirstScale, TrackSettings, track
from rock2d_tracking.setup_file import Setup

from rock2d.errors import InputError

SCALE, FPS = 0.004, 30.0
FALL_PX = 9.81 / SCALE / FPS**2
RADIUS_PX = 11.0


@pytest.fixture(scope="module")
def thrown(tmp_path_factory):
    """A film of a shaded ball that is thrown and bounces once, and its places."""
    path = tmp_path_factory.mktemp("film") / "thrown ball.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, (480, 320))
    rng, places = np.random.default_rng(4), []
    u, v, vu, vv = 30.0, 150.0, 9.0, -14.0
    x, y = np.meshgrid(np.arange(480), np.arange(320))
    wall = 40 + 25 * np.sin(x / 37) * np.cos(y / 23)
    for _ in range(44):
        away = np.hypot(x - u, y - v)
        cover = np.clip(RADIUS_PX + 0.5 - away, 0, 1)
        frame = wall + cover * (150 - 5 * (x - u) - wall)
        noisy = np.clip(frame + rng.normal(0, 1.5, frame.shape), 0, 255).astype(np.uint8)
        writer.write(cv2.cvtColor(noisy, cv2.COLOR_GRAY2BGR))
        places.append((u, v))
        u, v, vv = u + vu, v + vv + 0.5 * FALL_PX, vv + FALL_PX
        if v > 280:
            vv, v = -0.8 * vv, 280 - 0.8 * (v - 280)
    writer.release()
    return path, np.array(places)


def test_scale_and_frame_rate_are_enough(thrown, tmp_path):
    film, places = thrown
    said: list[str] = []
    out = tmp_path / "out"
    track(film, FirstScale(SCALE, FPS), out, TrackSettings(explain=True, report=said.append))
    frames = pd.read_csv(out / "frames.csv")
    seen = frames[frames["reason"].isna()]
    assert len(seen) > 38
    off = seen[["u_px", "v_px"]].to_numpy() - places[seen["frame"]]
    assert np.sqrt((off**2).mean()) < 0.3
    setup = Setup(out / "setup.yaml")
    assert setup.blocks["ball"].size_m / 2 / SCALE == pytest.approx(RADIUS_PX, rel=0.03)
    floor = 280.0 + RADIUS_PX
    assert (319 - setup.cross_section.points_m[0, 1] / SCALE) == pytest.approx(floor, abs=6.0)
    text = (out / "explanation.txt").read_text()
    assert "releases that arcs show: 1" in text
    assert (out / "candidates.webm").stat().st_size > 0 and (out / "candidates.png").stat().st_size > 0
    assert any("set-up file to refine" in line for line in said)


def test_a_wrong_frame_rate_is_named_where_nothing_can_be_tracked(thrown, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"nothing was seen to fall .* camera\.fps"):
        track(thrown[0], FirstScale(SCALE, 4 * FPS), out, TrackSettings())
    assert not out.exists()
    text = (tmp_path / "out_explained" / "explanation.txt").read_text()
    assert "0.25 times the frame rate" in text
    assert text.count("\n1. ") == text.count("\n2. ") == text.count("\n3. ") == 1
    left = {p.name for p in (tmp_path / "out_explained").iterdir()}
    assert left >= {"candidates.png", "candidates.webm", "setup.yaml"}
    Setup(tmp_path / "out_explained" / "setup.yaml")  # a file that can be used


def test_a_block_that_is_followed_but_not_trusted_is_told_with_numbers(thrown, tmp_path, monkeypatch):
    monkeypatch.setattr(tracked_film, "LARGEST_STATED_ERROR_PX", 0.0)
    monkeypatch.setattr(tracked_film, "LARGEST_ERROR_RADII", 0.0)
    with pytest.raises(
        InputError, match=r"followed from frame \d+ to \d+, .*known to .* px .*'unsure'.*camera\.scale"
    ):
        track(thrown[0], FirstScale(SCALE, FPS), tmp_path / "out", TrackSettings())
    left = {p.name for p in (tmp_path / "out_explained").iterdir()}
    assert left >= {"candidates.png", "candidates.webm", "setup.yaml", "overlay.webm", "explanation.txt"}
